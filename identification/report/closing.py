"""The ends of a page: what to do next, what the data cannot tell, and where the report comes from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from truepose.identification.diagnosis.naming import CERTAIN
from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.identification.fit.estimated import Estimate
from truepose.identification.identifiability.observability import Knowledge, unseen
from truepose.identification.recording.recording import Recording
from truepose.identification.report.finding_words import separating_experiment
from truepose.identification.report.identifiability_words import grouped, meaning
from truepose.identification.report.phrases import measure, several
from truepose.identification.report.verdict import left_words
from truepose.models.effects.common import OF_ROWS
from truepose.models.machine.machine import Machine
from truepose.shown.document import Block, Command, Items, Section, Table, Text
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


def diagnosis_steps(
    diagnosis: Diagnosis, output: Path | None, *, calibrated: bool, checked: bool
) -> list[Command | Text]:
    """What decides between explanations, what uses the result, or what to look at first.

    output: the folder of the results, None for a page, which names files alone. checked: whether ``check`` looked at them.
    """
    machine = machine_name(diagnosis.nominal, whole=output is not None)
    folder = output or Path()
    if not calibrated:
        return [_look(diagnosis, machine, checked)]
    out: list[Command | Text] = []
    undecided = [f for f in diagnosis.findings if _is_open(f)]
    if undecided:
        first = next(f for f in diagnosis.findings if _has_rivals(f))
        one = undecided[0]
        picked = "" if first is one else f" --discriminate {one.effect}@{'+'.join(one.place)}"
        rows = f"-n 40 -o poses.csv --diagnosis {folder / 'diagnosis.json'}{picked}"
        out.append(Command(f"truepose plan {machine} {rows}", "tell explanations apart:"))
        experiment = separating_experiment(one)
        out += [Text(f"or: {experiment}")] if experiment else []
    elif diagnosis.verdict == "unknown":
        out.append(_look(diagnosis, machine, checked))
    applied = diagnosis.applied
    if diagnosis.verdict == "adequate" or (applied is not None and applied.model != "plain"):
        out.append(_use(folder / "improved.yaml"))
    return out


def calibration_steps(
    machine: Machine, files: Sequence[str], output: Path | None, *, calibrated: bool, doubtful: bool
) -> list[Command | Text]:
    """What uses the result, and before that what tells why it does not fit."""
    own = f"{machine_name(machine, whole=output is not None)} {recording_names(files, whole=output is not None)}"
    use = _use((output or Path()) / "calibrated.yaml")
    if not calibrated:
        return [_check(own)]
    find = Command(f"truepose diagnose {own} -o diagnosis", "find what is missing:")
    return [find, use] if doubtful else [use]


def machine_name(machine: Machine, *, whole: bool = False) -> str:
    """The machine's file, without its folder unless the ``whole`` path is asked for."""
    if machine.file is None:
        return "MACHINE"
    return str(machine.file.path) if whole else Path(machine.file.path).name


def recording_names(files: Sequence[str], *, whole: bool = False) -> str:
    """Names of files as on a command line, without their folders unless ``whole``."""
    return " ".join((name if whole else Path(name).name).replace(" ", "\\ ") for name in files)


def _is_open(finding: Finding) -> bool:
    """Whether a name has rivals with a name, and is not certain against them."""
    named = not finding.nameless and finding.effect not in OF_ROWS
    return named and _has_rivals(finding) and finding.probability < CERTAIN


def _has_rivals(finding: Finding) -> bool:
    return any(not other.nameless and other.tested for other in finding.equivalents)


def _look(diagnosis: Diagnosis, machine: str, checked: bool) -> Command | Text:
    if checked:
        return Text(f"compare with the source: {left_words(diagnosis)}")
    return _check(f"{machine} {recording_names(diagnosis.recording.files)}")


def _check(files: str) -> Command:
    return Command(f"truepose check {files}", "look for wrong units, signs, orders and frames:")


def _use(file: Path) -> Command:
    return Command(f"truepose codegen {file} -o controller", "apply it, as C:")
