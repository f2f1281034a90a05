"""What to do after a result: commands to type, and the experiment that would decide what is open."""

from __future__ import annotations

from pathlib import Path

from truepose.identification.diagnosis.naming import CERTAIN
from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.identification.report.diagnosis_words import separating_experiment
from truepose.identification.report.left_words import left_words
from truepose.identification.report.lines import COLUMNS, wrapped
from truepose.models.effects.common import OF_ROWS
from truepose.models.machine.machine import Machine

NEXT = "next: "


def after_diagnosis(
    diagnosis: Diagnosis, output: Path, *, calibrated: bool, checked: bool = False
) -> list[str]:
    """At most three lines: what decides between explanations, what uses the result, or what to look at first.

    ``checked``: whether ``check`` has looked at the files, so that nobody is sent back to it.
    """
    machine = diagnosis.nominal
    if not calibrated:
        return _look(diagnosis, checked)
    out: list[str] = []
    undecided = [f for f in diagnosis.findings if _open(f)]
    if undecided:
        rows = f"-n 40 -o poses.csv --diagnosis {output / 'diagnosis.json'}"
        picked = _which(undecided[0], diagnosis)
        out.append(_command("tell them apart: ", "plan", machine, f"{rows}{picked}", rows))
        experiment = separating_experiment(undecided[0])
        out += wrapped(f"or: {experiment}", most=1) if experiment else []
    elif diagnosis.verdict == "unknown":
        out += _look(diagnosis, checked)
    applied = diagnosis.applied
    if diagnosis.verdict == "adequate" or (applied is not None and applied.model != "plain"):
        out.append(_use(output / "improved.yaml", "then: " if out else NEXT))
    return out


def after_calibration(machine: Machine, output: Path, *, calibrated: bool, doubtful: bool) -> list[str]:
    """One or two lines: what uses the result, and before that what tells why it does not fit."""
    if not calibrated:
        return [_check(machine)]
    if not doubtful:
        return [_use(output / "calibrated.yaml", NEXT)]
    diagnosis = _command("what is missing: ", "diagnose", machine, "RECORDING -o diagnosis")
    return [diagnosis, _use(output / "calibrated.yaml", "or: ")]


def _which(finding: Finding, diagnosis: Diagnosis) -> str:
    """The option that picks a finding, where it is not the one that is taken without."""
    taken = next(f for f in diagnosis.findings if _rivals(f))
    return "" if taken is finding else f" --discriminate {finding.effect}@{'+'.join(finding.place)}"


def _rivals(finding: Finding) -> bool:
    """Whether other explanations have a name and can be tested."""
    return any(not other.nameless and other.tested for other in finding.equivalents)


def _open(finding: Finding) -> bool:
    """Whether a name has rivals with a name, and is not certain against them."""
    named = not finding.nameless and finding.effect not in OF_ROWS
    return named and _rivals(finding) and finding.probability < CERTAIN


def _look(diagnosis: Diagnosis, checked: bool) -> list[str]:
    if not checked:
        return [_check(diagnosis.nominal)]
    return wrapped(f"{NEXT}compare with the source: {left_words(diagnosis)}", indent=0)


def _check(machine: Machine) -> str:
    return _command("units, signs, order, frames: ", "check", machine, "RECORDING")


def _use(file: Path, label: str) -> str:
    return f"{label}truepose codegen {file} -o controller"


def _command(label: str, command: str, machine: Machine, *rests: str) -> str:
    """A command with the machine's file and the first of ``rests`` where they fit on a line; else less of it."""
    own = str(machine.file.path) if machine.file is not None else "MACHINE"
    names = dict.fromkeys((own, "MACHINE"))
    tried = [(rest, said, name) for rest in rests for said in (label, "") for name in names]
    lines = [f"{NEXT}{said}truepose {command} {name} {rest}" for rest, said, name in tried]
    return next((line for line in lines if len(line) <= COLUMNS), lines[-1])


__all__ = ["after_calibration", "after_diagnosis"]
