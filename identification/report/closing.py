"""The ends of a page: what the data cannot tell, and where the report comes from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from truepose.identification.fit.estimated import Estimate
from truepose.identification.identifiability.observability import Knowledge, unseen
from truepose.identification.recording.recording import Recording
from truepose.identification.report.naming import several
from truepose.identification.report.numbers import measure
from truepose.identification.report.steps import machine_name, recording_names
from truepose.identification.report.unseen_words import grouped, meaning
from truepose.models.machine.machine import Machine
from truepose.shown.document import Block, Items, Section, Table
from truepose.version import VERSION
from truepose.wording import shortened

UNTOUCHED = 0.9
"""Share of a tolerance above which a 1-sigma says that the readings told next to nothing."""
MOST = 14
NOT_A_FILE = "not a file"


def limits_section(fit: Estimate, notes: Sequence[str]) -> Section:
    """Return what the data cannot tell of the geometry: blind directions, weakly known constants; and notes."""
    blocks: list[Block] = [Items(geometry_words(fit), title="Geometry")]
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
