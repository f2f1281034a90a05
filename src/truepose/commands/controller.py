"""``codegen``: C for the controller."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from truepose.commands.common import (
    AnywayOption,
    DirectoryOption,
    JsonOption,
    MachineArg,
    PluginOption,
    finish,
    progress,
    reported,
)
from truepose.commands.results import check_code, check_directory
from truepose.errors import InputError

if TYPE_CHECKING:
    from truepose.codegen.embedded.measure import Measurement

RealOption = Annotated[str, typer.Option(help="Type of every number.", metavar="double|float")]
FeaturesOption = Annotated[
    str | None,
    typer.Option(
        help="What is generated, separated by commas, and small code: warm, cold, branches, p, batch, state; default all.",
        metavar="LIST",
    ),
]
MeasureOption = Annotated[
    bool,
    typer.Option(
        "--measure",
        help="Run it on an emulated Cortex-M7 (float: M4F) and state in README.md what it takes there.",
    ),
]


def codegen(
    machine: MachineArg,
    output: DirectoryOption,
    real: RealOption = "double",
    features: FeaturesOption = None,
    measure: MeasureOption = False,
    anyway: AnywayOption = False,
    as_json: JsonOption = False,
    plugin: PluginOption = None,
) -> None:
    """C99 for the controller: forward and inverse kinematics, Jacobian, compensation.

    Example: truepose codegen fit/calibrated.yaml -o controller

    Example: truepose codegen fit/calibrated.yaml -o small --features warm
    """
    with reported(plugin):
        from truepose.codegen.c import generate
        from truepose.codegen.embedded.section import summary
        from truepose.codegen.embedded.write import generate_measured
        from truepose.codegen.features import ALL, Features
        from truepose.codegen.left_out import left_out, left_out_json, left_out_words
        from truepose.identification.report.applied_words import (
            check_applicable,
            expected_words,
            pose_json,
        )
        from truepose.models.load import load_machine

        check_directory(output)
        if real not in ("double", "float"):
            raise InputError(f"--real: found {real!r}, expected 'double' or 'float'")
        chosen = ALL if features is None else Features.of(features)
        number = cast('Literal["double", "float"]', real)
        with progress("writing C"):
            loaded = load_machine(machine)
            check_code(output, loaded.name)
            if not anyway:
                check_applicable(loaded)
            drawing = (loaded.file.nominal if loaded.file else {}) or None
            measured: list[Measurement] = []
            if measure:
                paths, measured = generate_measured(loaded, output, number, nominal=drawing, features=chosen)
            else:
                paths = generate(loaded, output, number, nominal=drawing, features=chosen)
        files = sorted(str(path) for path in paths)
        held = left_out(loaded, chosen)
        payload: dict[str, object] = {
            "command": "codegen",
            "machine": loaded.name,
            "real": real,
            "features": list(chosen.names),
            "files": files,
            "calibrated": held.calibrated,
            "left_out": left_out_json(held),
            "expected_pose": pose_json(loaded),
        }
        if measured:
            payload["measured"] = [asdict(measurement) for measurement in measured]
        told = [*left_out_words(held), expected_words(loaded), *summary(measured)]
        finish(payload, [*files, *told], [], as_json=as_json)
