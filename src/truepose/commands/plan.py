"""``plan``: measurement poses that calibrate a machine best."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.common import (
    FileOption,
    JsonOption,
    MachineArg,
    PluginOption,
    check_file,
    finish,
    progress,
    reported,
)
from truepose.commands.discriminate import (
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
from truepose.commands.discriminate import run as run_discriminate
from truepose.errors import InputError
from truepose.files import write_table
from truepose.wording import joined

CountOption = Annotated[
    int, typer.Option("-n", "--poses", metavar="N", min=2, help="How many poses.", show_default=False)
]
MethodOption = Annotated[
    str,
    typer.Option(
        "--method",
        metavar="continuous|exchange|random",
        help="Move all poses at once, only exchange them, or draw them (default: continuous; with candidates, exchange).",
        show_default=False,
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
        show_default=False,
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
    plugin: PluginOption = None,
) -> None:
    """Measurement poses that calibrate best: joint values inside their ranges, before anything is measured.

    With --discriminate: rows (poses, payload, temperatures, sides) that tell explanations apart.

    The constants are those of the machine file that have a tolerance, its effects included. Collisions and
    lines of sight are not known: give --candidates where they matter.

    Example: truepose plan machine.yaml -n 40 -o poses.csv

    Example: truepose plan machine.yaml -n 40 -o poses.csv --diagnosis result/diagnosis.json --payload 0,2.5,5
    """
    with reported(plugin):
        asked = Request(
            names=(*(discriminate or ()), *(rival or ())),
            diagnosis=diagnosis,
            payload=payload,
            vary=(*(f"temperature.{text}" for text in temperature or ()), *(vary or ())),
            recorded=tuple(recorded or ()),
            targets=tuple(target or ()),
        )
        if asked.wanted:
            _check_calibration_options(method, criterion)
            _discriminate(machine, n, output, asked, candidates, seed, as_json)
            return
        from truepose.identification.planning.plan import plan as run
        from truepose.identification.recording.load import load_recording
        from truepose.identification.report.plan_words import plan_json, plan_lines, plan_notes
        from truepose.identification.report.pose_tables import plan_table
        from truepose.models.load import load_machine

        check_file(output)
        with progress("planning") as say:
            loaded = load_machine(machine)
            given = (
                None
                if candidates is None
                else load_recording(loaded, [candidates], need_observations=False).q
            )
            chosen = method or ("continuous" if given is None else "exchange")
            found = run(
                loaded, n, method=chosen, criterion=criterion, seed=seed, candidates=given, progress=say
            )
            frame = plan_table(found)
        lines = plan_lines(found)
        write_table(
            output, frame, [f"poses of {loaded.name} for calibration: {n}, {chosen}, seed {seed}", *lines]
        )
        columns = [str(c) for c in frame.columns]
        summary = {"command": "plan", **plan_json(found, columns), "files": [str(output)]}
        finish(summary, [f"{output}: {n} poses", *lines], plan_notes(found), as_json=as_json)


def _check_calibration_options(method: str, criterion: str) -> None:
    if method not in ("", "exchange") or criterion != "d":
        raise InputError(
            "--method, --criterion: found with --discriminate, expected neither: rows are exchanged for the expected "
            "log Bayes factor"
        )


def _discriminate(
    machine: Path, n: int, output: Path, asked: Request, candidates: Path | None, seed: int, as_json: bool
) -> None:
    """The experiment that tells explanations apart, written and told."""
    from truepose.identification.report.notes import worded
    from truepose.models.load import load_machine

    check_file(output)
    with progress("planning") as say:
        loaded = load_machine(machine)
        found, frame, lines, told = run_discriminate(loaded, n, asked, candidates, seed, say)
    names = joined(e.name for e in found.explanations)
    write_table(output, frame, [f"rows of {loaded.name} to tell {names} apart: {n}, seed {seed}", *lines])
    summary = {"command": "plan", "machine": loaded.name, "seed": seed, "rows": len(frame)}
    summary |= {"columns": [str(c) for c in frame.columns], **told, "files": [str(output)]}
    finish(summary, [f"{output}: {len(frame)} rows", *lines], worded(found.notes), as_json=as_json)
