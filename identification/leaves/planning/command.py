"""``plan``: measurement poses that calibrate a machine best."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.common import FileOption, JsonOption, MachineArg, check_file, finish, progress
from truepose.errors import InputError
from truepose.files import mixture_notes, write_table
from truepose.identification.leaves.planning.discriminate.command import (
    DiagnosisOption,
    DiscriminateOption,
    PayloadOption,
    Request,
    RivalOption,
    TargetOption,
    TemperatureOption,
    VaryOption,
    WithOption,
)
from truepose.identification.leaves.planning.discriminate.command import run as run_discriminate
from truepose.models.file.limits import POSES
from truepose.wording import joined

CountOption = Annotated[
    int, typer.Option("-n", "--poses", metavar="N", min=2, max=POSES, help="How many poses.")
]
MethodOption = Annotated[
    str,
    typer.Option(
        "--method",
        metavar="continuous|exchange|random",
        help="Move all poses at once, exchange them, or draw them (default: continuous; with candidates, exchange).",
    ),
]
CriterionOption = Annotated[
    str,
    typer.Option(
        "--criterion",
        metavar="d|a|o1|o2|o3|o4|o5",
        help="d, a: with the tolerances; o1 to o5: observability indices of the readings alone.",
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of the random candidates.")]
CandidatesOption = Annotated[
    Path | None,
    typer.Option(
        "--candidates",
        metavar="FILE",
        help="Choose among these joint values (free of collisions, say), by exchange.",
    ),
]


def plan(
    machine: MachineArg,
    n: CountOption,
    output: FileOption,
    method: MethodOption = "",
    criterion: CriterionOption = "d",
    seed: SeedOption = 0,
    candidates: CandidatesOption = None,
    discriminate: DiscriminateOption = None,
    rival: RivalOption = None,
    diagnosis: DiagnosisOption = None,
    payload: PayloadOption = "",
    temperature: TemperatureOption = None,
    vary: VaryOption = None,
    recorded: WithOption = None,
    target: TargetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Measurement poses that calibrate best: joint values inside their ranges, before anything is measured.

    With --discriminate: rows (poses, payload, temperatures, sides) that tell explanations apart.

    The constants are those of the machine file that have a tolerance, its effects included. Collisions and
    lines of sight are not known: give --candidates where they matter.

    Example: truepose plan machine.yaml -n 40 -o poses.csv

    Example: truepose plan machine.yaml -n 40 -o poses.csv --diagnosis result/diagnosis.json --payload 0,2.5,5
    """
    asked = Request.of(discriminate, rival, diagnosis, payload, temperature, vary, recorded, target)
    wanted = _Wanted(machine, n, output, candidates, seed, as_json)
    if asked.wanted:
        _check_calibration_options(method, criterion)
        _discriminate(wanted, asked)
    else:
        _calibrate(wanted, method, criterion)


@dataclass(frozen=True)
class _Wanted:
    """What every plan takes: ``n`` rows of a machine file, for ``output``."""

    machine: Path
    n: int
    output: Path
    candidates: Path | None
    seed: int
    as_json: bool


def _calibrate(wanted: _Wanted, method: str, criterion: str) -> None:
    """The poses that calibrate best, written and told."""
    from truepose.identification.leaves.planning.plan import plan as run
    from truepose.identification.leaves.planning.pose_tables import plan_table
    from truepose.identification.leaves.planning.words import plan_json, plan_lines, plan_notes
    from truepose.identification.recording.load import load_recording
    from truepose.models.load import load_machine

    check_file(wanted.output, wanted.machine, wanted.candidates)
    with progress("planning") as say:
        machine = load_machine(wanted.machine)
        files = [] if wanted.candidates is None else [wanted.candidates]
        given = load_recording(machine, files, need_observations=False).q if files else None
        chosen = method or ("continuous" if given is None else "exchange")
        found = run(
            machine,
            wanted.n,
            method=chosen,
            criterion=criterion,
            seed=wanted.seed,
            candidates=given,
            progress=say,
        )
        frame = plan_table(found)
    lines = plan_lines(found)
    head = f"poses of {machine.name} for calibration: {wanted.n}, {chosen}, seed {wanted.seed}"
    write_table(wanted.output, frame, [head, *lines])
    summary = {"command": "plan", **plan_json(found, [str(c) for c in frame.columns])}
    summary["files"] = [str(wanted.output)]
    told = [f"{wanted.output}: {wanted.n} poses", *lines]
    finish(summary, told, plan_notes(found), as_json=wanted.as_json)


def _check_calibration_options(method: str, criterion: str) -> None:
    if method not in ("", "exchange") or criterion != "d":
        raise InputError(
            "--method, --criterion: found with --discriminate, expected neither: rows are exchanged for the expected "
            "log Bayes factor"
        )


def _discriminate(wanted: _Wanted, asked: Request) -> None:
    """The experiment that tells explanations apart, written and told."""
    from truepose.identification.report.notes import worded
    from truepose.models.load import load_machine

    check_file(wanted.output, wanted.machine, wanted.candidates, asked.diagnosis, *asked.recorded)
    with progress("planning") as say:
        machine = load_machine(wanted.machine)
        found, frame, lines, told = run_discriminate(
            machine, wanted.n, asked, wanted.candidates, wanted.seed, say
        )
    names = joined(e.name for e in found.explanations)
    head = f"rows of {machine.name} to tell {names} apart: {wanted.n}, seed {wanted.seed}"
    write_table(wanted.output, frame, [head, *lines])
    summary = {"command": "plan", "machine": machine.name, "seed": wanted.seed, "rows": len(frame)}
    summary |= {"columns": [str(c) for c in frame.columns], **told, "files": [str(wanted.output)]}
    heading = f"{wanted.output}: {len(frame)} rows"
    notes = [*(mixture_notes(asked.diagnosis) if asked.diagnosis else ()), *worded(found.notes)]
    finish(summary, [heading, *lines], notes, as_json=wanted.as_json)


COMMANDS = (plan,)
