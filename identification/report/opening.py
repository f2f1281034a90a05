"""The first screen of a report: what it did to the error, how sure it is, what could not be tested, what to do next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from truepose.identification.diagnosis.holdout import ROLE
from truepose.identification.diagnosis.result import WHOLE, Applied, Diagnosis, Finding
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.summary import FitSummary
from truepose.identification.report import diagnosis_words as words
from truepose.identification.report.applied_words import applied_words, rows_words
from truepose.identification.report.before_after import better_baseline, sensor_unit
from truepose.identification.report.calibration_words import figures, nothing_against
from truepose.identification.report.document import Command, Gain, Items, Opening, Text
from truepose.identification.report.fits import stated_noise
from truepose.identification.report.judgement_words import diagnosis_judgement
from truepose.identification.report.left_words import left_words
from truepose.identification.report.level_words import NAMES, SAID, known_words, level_of, spanned
from truepose.identification.report.misfit_words import misfit_clause
from truepose.identification.report.numbers import percent, significant, unit_symbol
from truepose.identification.report.scene.guilt import Guilty
from truepose.identification.report.scene.scene import scene_of
from truepose.identification.report.untestable_words import missing_words, untestable_lines
from truepose.identification.report.verdict_reasons import doubts
from truepose.models.file.machine_file import ExpectedPose
from truepose.models.machine.machine import Machine
from truepose.wording import joined

MOST, DOUBTS = 3, 2
"""Most lines of a list on the first screen, and of what speaks against it."""
GUILTY = 8


def diagnosis_opening(diagnosis: Diagnosis, *, checked: bool = False) -> Opening:
    """Of a diagnosis; ``checked``: whether ``check`` has looked at the files."""
    before, after = better_baseline(diagnosis), diagnosis.fits["after"]
    two = bool(diagnosis.terms)
    ratio = diagnosis.proof.ratio if diagnosis.proof is not None else math.nan
    gains = [
        *_applied_gain(diagnosis.applied),
        *gains_of(diagnosis.nominal, before if two else None, after, diagnosis.noise, ratio),
    ]
    fit = diagnosis.after if two else None
    scene = scene_of(
        diagnosis.before, fit, diagnosis.recording, [_guilty(f) for f in diagnosis.findings[:GUILTY]]
    )
    lists = [Items(_sure(diagnosis), title="How sure")]
    applied = diagnosis.applied
    if diagnosis.verdict != "adequate" and applied is not None and applied.model != WHOLE:
        lists.append(Items(applied_words(applied), title="What improved.yaml holds", tone="warn"))
    against = doubts(diagnosis)
    if against:
        lists.append(Items(_few(against, "part 1", DOUBTS), title="What speaks against it"))
    untested = [
        *missing_words(diagnosis.missing, words.effect_title),
        *untestable_lines(diagnosis.untestable, diagnosis.missing, words.effect_title),
    ]
    if untested:
        lists.append(
            Items(_few(untested, "What the data cannot tell"), title="What could not be tested", tone="warn")
        )
    return Opening(gains, lists, _steps(diagnosis, checked), scene)


def gains_of(
    machine: Machine,
    before: FitSummary | None,
    after: FitSummary,
    noise: float = 1.0,
    ratio: float = math.nan,
) -> list[Gain]:
    """Before and after by kind of reading, on validation rows where there are any.

    noise: found, in stated sigmas; ratio: of rms, after over before, on rows held out in turn, told where there are no others.
    """
    first = after if before is None else before
    held = first.validation_rms is not None and after.validation_rms is not None
    old, new = (first.validation_rms, after.validation_rms) if held else (first.rms, after.rms)
    floors, units = stated_noise(machine), machine.residual_units
    where = "on rows that were not fitted" if held else "on the fitted rows"
    if not held and math.isfinite(ratio):
        where += f"; on rows held out in turn it falls to {100 * ratio:.0f} %"
    return [
        _gain(
            kind,
            (old or {})[kind] if before is not None else None,
            value,
            floors[kind],
            units[kind],
            where,
            noise,
        )
        for kind, value in (new or {}).items()
    ]


def _gain(
    kind: str, before: float | None, after: float, floor: float, unit: str, where: str, noise: float
) -> Gain:
    sizes = [abs(v) for v in (before, after) if v is not None and math.isfinite(v)]
    factor, name = sensor_unit(max(sizes, default=0.0), unit)
    largest = max([*sizes, floor]) or 1.0

    def told(value: float) -> str:
        return f"{significant(value * factor)} {unit_symbol(name)}".rstrip()

    shares = (0.0 if before is None else before / largest, after / largest, floor / largest)
    noisy = (
        f" by its stated sigma, {significant(noise, 2)} times that by its scatter"
        if not 0.8 < noise < 1.25
        else ""
    )
    return Gain(
        f"{kind} error, rms",
        "" if before is None else told(before),
        told(after),
        f"the instrument alone (dashed): {told(floor)}{noisy}",
        _explained(before, after, floor),
        where,
        tuple(s if math.isfinite(s) else 0.0 for s in shares),  # type: ignore[arg-type]
    )


def _explained(before: float | None, after: float, floor: float) -> str:
    """How much of what lies above the instrument's floor is gone, in squares, as errors add."""
    if before is None or not before > floor or not math.isfinite(before * after):
        return ""
    share = (before**2 - after**2) / (before**2 - floor**2)
    if share <= 0.0:
        return "none of the error beyond it is explained"
    if share >= 1.0:
        return "all of the error beyond it is explained"
    told = f"{100 * share:.0f} %" if 0.005 <= share < 0.995 else percent(share)
    return f"{told} of the squared error beyond it is explained"


def _guilty(finding: Finding) -> Guilty:
    said, sure = known_words(finding)
    return Guilty(said, "" if finding.nameless else finding.effect, sure, finding.place)


def _sure(diagnosis: Diagnosis) -> list[str]:
    """How sure findings are, alike ones together; and what the misfit says."""
    misfit = misfit_clause(diagnosis).removeprefix(", with ")
    beside = [f"{misfit[0].upper()}{misfit[1:]}."] if misfit else []
    if not diagnosis.findings:
        nothing = (
            "Nothing of the catalogue, and no form without a name, reaches the evidence that a name needs."
        )
        open_ended = "Something is missing; no place and no driver reaches a probability of one half."
        return [nothing if diagnosis.verdict == "adequate" else open_ended, *beside]
    groups: dict[tuple[str, str], list[Finding]] = {}
    for finding in diagnosis.findings:
        groups.setdefault((finding.effect, finding.levels.kind), []).append(finding)
    return [*_few([_alike(group) for group in groups.values()], "part 1"), *beside]


def _alike(group: Sequence[Finding]) -> str:
    """Findings of one effect and driver: how sure their places, driver and law are, and what they could be instead."""
    first = group[0]
    where = joined([", ".join(f.place) or "the whole recording" for f in group])
    rivals = dict.fromkeys(
        o.effect for f in group if f.probability < SAID for o in f.equivalents if not o.nameless
    )
    others = [words.effect_title(slug) for slug in rivals if slug != first.effect][:1]
    same = f" It could also be {others[0]}." if others else ""
    if first.nameless:
        place, driver = (spanned([getattr(f.levels, level) for f in group]) for level in ("place", "driver"))
        return f"Something without a name at {where}: place {place}, driver ({NAMES[first.levels.kind]}) {driver}."
    law = spanned([f.probability for f in group])
    if len(group) == 1 and level_of(first) == "law":
        return f"{law} that it is {words.told(first)}."
    title = words.effect_title(first.effect)
    if not any(f.levels.driver for f in group):
        return f"{title[0].upper()}{title[1:]} at {where}: {law}.{same}"
    place, driver = (spanned([getattr(f.levels, level) for f in group]) for level in ("place", "driver"))
    known = f"place {place}, driver ({NAMES[first.levels.kind]}) {driver}, law {law}"
    return f"{title[0].upper()}{title[1:]} at {where}: {known}.{same}"


def _few(texts: Sequence[str], where: str, most: int = MOST) -> list[str]:
    left = len(texts) - most
    return [*texts[:most], *([f"{left} more below, in {where}."] if left > 0 else [])]


def _steps(diagnosis: Diagnosis, checked: bool) -> list[Command | Text]:
    """What decides between explanations, what uses the result, or what to look at first."""
    machine = file_name(diagnosis.nominal)
    if not diagnosis_judgement(diagnosis).calibrated:
        return [_look(diagnosis, checked)]
    out: list[Command | Text] = []
    undecided = [f for f in diagnosis.findings if f.equivalents and not f.nameless and f.probability < SAID]
    if undecided:
        plan = f"truepose plan {machine} -n 40 -o poses.csv --diagnosis diagnosis.json"
        out.append(Command(plan, "Measure what tells the explanations apart:"))
        out.append(Text("What to do on the machine itself stands with each finding, in part 1."))
    elif diagnosis.verdict == "unknown":
        out.append(_look(diagnosis, checked))
    applied = diagnosis.applied
    if diagnosis.verdict == "adequate" or (applied is not None and applied.model != "plain"):
        out.append(Command("truepose codegen improved.yaml -o controller", "Apply improved.yaml, as C:"))
        out.append(
            Command("truepose compensate improved.yaml PATH -o commands.csv", "or as corrected commands:")
        )
    return out


def _look(diagnosis: Diagnosis, checked: bool) -> Command | Text:
    if checked:
        return Text(f"Compare with the source: {left_words(diagnosis)}.")
    return _check(diagnosis.nominal, diagnosis.recording.files)


def _check(machine: Machine, files: Sequence[str]) -> Command:
    line = f"truepose check {file_name(machine)} {recording_names(files)}"
    return Command(line, "Look for wrong units, signs, orders and frames:")


def file_name(machine: Machine) -> str:
    """The machine file's name without its folder."""
    return Path(machine.file.path).name if machine.file is not None else "MACHINE"


def recording_names(files: Sequence[str]) -> str:
    """Names of files without their folders, as on a command line."""
    return " ".join(Path(name).name.replace(" ", "\\ ") for name in files)


def calibration_opening(
    calibration: Calibration, summary: FitSummary, pose: ExpectedPose | None, warnings: Sequence[str]
) -> Opening:
    """Of a calibration; the scene is added by the page."""
    fit = calibration.fit
    machine, files = file_name(fit.nominal), recording_names(calibration.recording.files)
    check = _check(fit.nominal, calibration.recording.files)
    apply = Command("truepose codegen calibrated.yaml -o controller", "Apply calibrated.yaml, as C:")
    find = Command(f"truepose diagnose {machine} {files} -o diagnosis", "Find what the model leaves out:")
    good = nothing_against(summary)
    steps = [check] if not calibration.judgement.calibrated else [apply, find] if good else [find, apply]
    sure = [f"{said[0].upper()}{said[1:]}." for said in [figures(summary)]]
    blind = len(fit.null_space)
    if blind:
        free = len(fit.prior.free)
        sure.append(
            f"Of {free} directions of the free constants the readings see {fit.rank}; tolerances hold the others."
        )
    lists = [Items(sure, title="How sure")]
    if warnings:
        lists.append(Items(list(warnings[:MOST]), title="Rows that do not fit", tone="warn"))
    worth = [] if pose is None else [_worth(pose)]
    return Opening([*worth, *gains_of(fit.nominal, None, summary)], lists, steps)


def _applied_gain(applied: Applied | None) -> list[Gain]:
    """The tool's position with improved.yaml, where it was judged on other rows than those of the readings' figures."""
    if applied is None or applied.pose is None or applied.model == "plain" or applied.held_out == ROLE:
        return []
    pose = ExpectedPose("plain calibration", applied.pose.plain, applied.pose.model, rows_words(applied))
    return [_worth(pose, "improved.yaml")]


def _worth(pose: ExpectedPose, name: str = "this calibration") -> Gain:
    """The tool's position by what was before and by the file."""
    largest = max(pose.before, pose.after) or 1.0
    factor, unit = sensor_unit(max(pose.before, pose.after), "mm")
    before, after = (f"{significant(v * factor)} {unit_symbol(unit)}" for v in (pose.before, pose.after))
    where = f"{pose.than} and {name}, on {pose.rows}, base and tool refitted"
    shares = (pose.before / largest, pose.after / largest, 0.0)
    return Gain("the tool's position, rms", before, after, "", "", where, shares)


__all__ = ["calibration_opening", "diagnosis_opening", "file_name", "gains_of", "recording_names"]
