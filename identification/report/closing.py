"""The ends of a page: what to do next, how well the tool is known, what data cannot tell, where the report comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from truepose.errors import TrueposeError
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.repeatability import pose_test
from truepose.identification.fit.tool_pose import (
    EXPLANATIONS,
    READINGS,
    TOLERANCES,
    UNEXPLAINED,
    ToolSpread,
    tool_spread,
)
from truepose.identification.identifiability.observability import Knowledge, unseen
from truepose.identification.recording.recording import Recording
from truepose.identification.report.experiments import plan_command, questions
from truepose.identification.report.finding_words import separating_experiment
from truepose.identification.report.identifiability_words import grouped, meaning
from truepose.identification.report.phrases import measure, several
from truepose.identification.report.scene import thinned
from truepose.identification.report.verdict import left_words
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
    undecided = questions(diagnosis.findings)
    if undecided:
        one, question = undecided[0]
        files = [name if output else Path(name).name for name in diagnosis.recording.files]
        command = plan_command(question, folder / "improved.yaml", files)
        out.append(Command(command, "tell explanations apart:"))
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


def _look(diagnosis: Diagnosis, machine: str, checked: bool) -> Command | Text:
    if checked:
        return Text(f"compare with the source: {left_words(diagnosis)}")
    return _check(f"{machine} {recording_names(diagnosis.recording.files)}")


def _check(files: str) -> Command:
    return Command(f"truepose check {files}", "look for wrong units, signs, orders and frames:")


def _use(file: Path) -> Command:
    return Command(f"truepose codegen {file} -o controller", "apply it, as C:")


ROWS = 300
COVERAGE = 2.0
"""Coverage factor: an interval of about 95 %."""
_SOURCES: Mapping[str, tuple[str, str]] = {
    READINGS: ("noise of the readings, as it went through the fit", "A"),
    TOLERANCES: ("what the readings leave to the drawing's tolerances", "B"),
    EXPLANATIONS: ("explanations that the readings cannot tell apart", "B"),
    UNEXPLAINED: ("what the model leaves unexplained beyond the instrument's noise", "A"),
}


def uncertainty_section(fit: Estimate, recording: Recording, before: Estimate | None) -> Section:
    """Return the budget at the recorded poses, and ISO 9283 where the recording allows it.

    ``before``: the fit to compare the standard's figures with, None for a calibration alone.
    """
    good = np.flatnonzero(np.isfinite(fit.residual).all(axis=1))
    if not len(good) or not len(fit.prior.free):
        said = "Nothing was estimated, so there is no uncertainty to tell."
        return Section("uncertainty", "How well the tool's position is known", [Text(said)])
    try:
        blocks: list[Block] = [_budget(tool_spread(fit, recording, thinned(good, ROWS)))]
    except TrueposeError as exc:
        blocks = [Text(f"The uncertainty of the tool could not be evaluated: {exc}")]
    blocks.append(_iso_9283(fit, recording, before))
    return Section("uncertainty", "How well the tool's position is known", blocks)


def _budget(spread: ToolSpread) -> Table:
    """Sources, their standard uncertainties and shares, combined and expanded."""
    mean = {source: float(np.mean(v)) for source, v in spread.variance.items()}
    whole = sum(mean.values())
    rows = [
        [*_SOURCES[source], measure(float(np.sqrt(v)), "mm"), f"{100 * v / whole:.0f} %" if whole else "-"]
        for source, v in mean.items()
    ]
    combined = float(np.sqrt(whole))
    rows.append(["combined standard uncertainty", "", measure(combined, "mm"), "100 %"])
    rows.append([f"expanded uncertainty, k = {COVERAGE:g}", "", measure(COVERAGE * combined, "mm"), ""])
    caption = (
        "Uncertainty of the tool's position in the sensor's frame, root of the mean over the recorded poses, after the GUM"
        " (JCGM 100:2008). Type A comes from the scatter of readings, type B from other knowledge. It is that of the model:"
        " a single reading has the instrument's noise beside it, and an error that the instrument makes in all readings is"
        " not in it."
    )
    head = ["source", "type", "standard uncertainty", "share of variance"]
    return Table(head, rows, caption, text_columns=2)


def _iso_9283(fit: Estimate, recording: Recording, before: Estimate | None) -> Block:
    """Return AP and RP of mean and worst pose, before and after; where poses were visited too rarely, what is needed."""
    now, was = pose_test(fit, recording), pose_test(before or fit, recording)
    if now is None or was is None:
        needs = (
            "ISO 9283 (pose accuracy and repeatability) needs poses that are visited three times and more under one number"
            " in the column `pose`. This recording has none."
        )
        return Text(needs, "muted")
    figures = {
        "pose accuracy AP, before": was.accuracy if before else None,
        "pose accuracy AP, with this model": now.accuracy,
        "pose repeatability RP": now.repeatability,
    }
    rows = [
        [name, measure(float(np.mean(values)), "mm"), measure(float(np.max(values)), "mm")]
        for name, values in figures.items()
        if values is not None
    ]
    visits = f"{int(now.visits.min())} to {int(now.visits.max())}"
    caption = (
        f"After ISO 9283, of {len(now.visits)} poses with {visits} visits each; the standard asks for 30 visits of five poses."
        " AP: from the model's position to the mean of the readings. RP: mean distance from that mean plus three standard"
        " deviations; no calibration improves it."
    )
    return Table(["", "mean pose", "worst pose"], rows, caption)
