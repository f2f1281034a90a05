"""What to do after a result: commands to type, and the experiment that would decide what is open."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from truepose.identification.diagnosis.naming import CERTAIN
from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.identification.report.finding_words import separating_experiment
from truepose.identification.report.verdict import left_words
from truepose.models.effects.common import OF_ROWS
from truepose.models.machine.machine import Machine
from truepose.shown.document import Command, Text


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
