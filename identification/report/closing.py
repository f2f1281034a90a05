"""The ends of a page: what the data cannot tell, where the report comes from, and the truth of a bundled demonstration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.identifiability.observability import Knowledge, unseen
from truepose.identification.recording.recording import Recording
from truepose.identification.report.naming import effect_title, place_words, several
from truepose.identification.report.numbers import measure
from truepose.identification.report.steps import machine_name, recording_names
from truepose.identification.report.unseen_words import grouped, meaning
from truepose.identification.signatures.untestable import Untestable
from truepose.models.machine.machine import Machine
from truepose.shown.document import Block, Items, Section, Table, Text
from truepose.version import VERSION
from truepose.wording import joined, shortened

UNTOUCHED = 0.9
"""Share of a tolerance above which a 1-sigma says that the readings told next to nothing."""
MOST = 14
NOT_A_FILE = "not a file"


def limits_section(fit: Estimate, untestable: Sequence[Untestable], notes: Sequence[str]) -> Section:
    """What the data cannot tell: blind directions, weakly known constants, effects that were not tested; and notes."""
    blocks: list[Block] = [Items(geometry_words(fit), title="Geometry")]
    if untestable:
        rows = [[effect_title(u.effect), u.why] for u in untestable]
        caption = "Effects that this recording cannot speak of. None of them is excluded by the verdict."
        blocks.append(Table(["not testable", "why"], rows, caption, text_columns=2))
    if notes:
        blocks.append(Items(notes, title="Notes"))
    return Section("limits", "What the data cannot tell", blocks)


def geometry_words(fit: Estimate) -> list[str]:
    """The rank, what moves together without changing any reading, and which constants are hardly better known than drawn."""
    free = len(fit.prior.free)
    out = [f"The readings alone determine {fit.rank} of {several(free, 'direction')} of the free parameters."]
    directions = unseen(Knowledge.of(fit))
    out += [f"{said[0].upper()}{said[1:]}." for said in map(meaning, directions[:MOST])]
    if len(directions) > MOST:
        out.append(f"{len(directions) - MOST} more directions are not seen; the JSON has all.")
    sigma, std, known = fit.prior.sigma, fit.std, len(fit.nominal.parameters)
    held = [int(k) for k in fit.prior.free if np.isfinite(sigma[k]) and k < known]
    weak = [fit.prior.names[k] for k in held if std[k] > UNTOUCHED * sigma[k]]
    if not weak:
        return [*out, "Every parameter is known better than its drawing said."]
    return [
        *out,
        f"For {len(weak)} of {several(len(held), 'parameter')} with a tolerance the readings say next to nothing beyond the"
        f" drawing (1-sigma over nine tenths of the tolerance): {shortened(grouped(weak), MOST)}.",
    ]


def origin_section(
    machine: Machine, recording: Recording, command: str, options: Sequence[str] = ()
) -> Section:
    """Version, files with their digests, date, instrument, command."""
    own = machine_name(machine) if machine.file is not None else machine.name
    digest = machine.file.digest if machine.file is not None else ""
    line = " ".join(["truepose", command, machine_name(machine), recording_names(recording.files), *options])
    digests = recording.digests or ("",) * len(recording.files)
    rows = [
        ["truepose", VERSION],
        ["command, or what does the same", line],
        ["machine file", f"{own}, SHA-256 {digest or NOT_A_FILE}"],
        *(
            ["recording", f"{Path(name).name}, SHA-256 {found or NOT_A_FILE}"]
            for name, found in zip(recording.files, digests, strict=True)
        ),
        [
            "recorded on",
            ", ".join(dict.fromkeys(filter(None, recording.dates))) or "not stated in the recording",
        ],
        ["instrument", "; ".join(_instruments(machine)) or "none"],
    ]
    caption = "The same files and the same version give the same report, byte for byte."
    return Section("origin", "Where this report comes from", [Table(["", ""], rows, caption, text_columns=2)])


def _instruments(machine: Machine) -> list[str]:
    """Sensors of the machine file with their stated 1-sigma."""
    out = []
    for sensor in machine.sensors:
        sigmas = dict.fromkeys(f"{c.kind} {measure(c.sigma, c.unit)}" for c in sensor.channels)
        out.append(f"{sensor.type} ({len(sensor.columns)} columns), stated 1 sigma: {', '.join(sigmas)} each")
    return out


def truth_section(diagnosis: Diagnosis, truth: Mapping[str, Any]) -> Section:
    """What the simulated machine of a demonstration really had, beside what was found."""
    stated = truth.get("effects") or ([truth["effect"]] if truth.get("effect") else [])
    real = [
        (str(e.get("effect", "")), tuple(map(str, e.get("place", ()))))
        for e in stated
        if isinstance(e, Mapping)
    ]
    found = {(f.effect, f.place) for f in diagnosis.findings}
    extra = [f"{slug} {place_words(place)}" for slug, place in sorted(found) if (slug, place) not in real]
    missed = [slug for slug, place in real if (slug, place) not in found]
    said = joined([f"{effect_title(slug)} {place_words(place)}".strip() for slug, place in real])
    outcome = "all of it was found" if not missed else f"not found under that name: {joined(missed)}"
    text = (
        "This recording was simulated, so the truth is known (the diagnosis never saw it). Left out of the machine file:"
        f" {said or 'nothing'}; {outcome if real else 'nothing was to be found'}; beyond it: {joined(extra) or 'nothing'}."
    )
    return Section(
        "truth", "Truth against what was found", [Text(text, "warn" if missed or extra else "good")]
    )
