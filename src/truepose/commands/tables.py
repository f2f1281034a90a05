"""``predict`` and ``simulate``: from rows to rows."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.commands.common import (
    FileOption,
    JsonOption,
    MachineArg,
    RecordingArg,
    ShuffledOption,
    check_file,
    finish,
    progress,
)
from truepose.files import write_table

if TYPE_CHECKING:
    import pandas as pd

PosesArg = Annotated[
    Path,
    typer.Argument(metavar="POSES", help="Joint readings, row by row; the sensor's columns may be missing."),
]
EffectOption = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="SLUG@PLACE:name=value[unit],...",
        help="Physics to add; several places: q3+q2; repeatable.",
    ),
]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of the sensor's noise.")]


def predict(
    machine: MachineArg,
    recording: RecordingArg,
    output: FileOption,
    shuffled: ShuffledOption = False,
    as_json: JsonOption = False,
) -> None:
    """What the sensor should have read, one row for each row: its columns, <column>.std, and the tool's pose.

    Units are those of the machine file. <column>.std is the model's 1-sigma, without the sensor's noise. A
    row in which the mechanism cannot be assembled stays empty.

    Example: truepose predict result/improved.yaml recording.csv -o predicted.csv
    """
    from truepose.identification.prediction import predict as prediction
    from truepose.identification.recording.load import load_recording
    from truepose.models.load import load_machine

    check_file(output, machine, recording)
    with progress("predicting"):
        loaded = load_machine(machine)
        rows = load_recording(loaded, [recording], need_observations=False, shuffled=shuffled)
        frame = prediction.predict(loaded, rows)
        write_table(output, frame)
    unknown = [*prediction.unknown_frames(loaded, rows), *prediction.unheard(loaded, rows)]
    lost = prediction.unassembled(rows, frame)
    notes = [*rows.notes, *unknown, *prediction.notes_outside(loaded, rows), *lost]
    _finish("predict", frame, output, notes, as_json)


def simulate(
    machine: MachineArg,
    poses: PosesArg,
    output: FileOption,
    effect: EffectOption = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """A recording with the machine file's effects, the ones named, and the sensor's noise.

    Example: truepose simulate machine.yaml poses.csv -o out.csv --effect "actuator-scale@rho4:s=8e-4"

    Example: truepose simulate machine.yaml poses.csv -o out.csv --effect "axis-coupling@q3+q2:k=1e-4"
    """
    from truepose.identification.prediction import predict as simulation
    from truepose.identification.prediction.predict import unheard
    from truepose.identification.recording.load import load_recording
    from truepose.identification.recording.table import read_table
    from truepose.models.effect_text import parse_effect
    from truepose.models.load import load_machine

    check_file(output, machine, poses)
    with progress("simulating"):
        loaded = load_machine(machine)
        extra = [parse_effect(text, loaded, stated=True) for text in effect or ()]
        whole = loaded.with_effects((*loaded.effects, *extra))
        table = read_table(poses, loaded.mechanism.readings)
        rows = load_recording(loaded, [table], need_observations=False)
        frame = simulation.with_inputs(table, simulation.simulate(whole, rows, seed=seed))
        write_table(output, frame)
    notes = [*rows.notes, *unheard(whole, rows)]
    _finish("simulate", frame, output, notes, as_json)


def _finish(command: str, frame: pd.DataFrame, output: Path, notes: list[str], as_json: bool) -> None:
    summary = {
        "command": command,
        "rows": len(frame),
        "columns": [str(c) for c in frame.columns],
        "files": [str(output)],
    }
    finish(summary, [f"{output}: {len(frame)} rows"], notes, as_json=as_json)
