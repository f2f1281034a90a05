"""``codegen``: C for the controller."""

from __future__ import annotations

from typing import Annotated, Literal, cast

import typer

from truepose.commands.common import (
    DirectoryOption,
    JsonOption,
    MachineArg,
    PluginOption,
    check_directory,
    finish,
    progress,
    reported,
)
from truepose.errors import InputError

RealOption = Annotated[str, typer.Option(help="Type of every number.", metavar="double|float")]


def codegen(
    machine: MachineArg,
    output: DirectoryOption,
    real: RealOption = "double",
    as_json: JsonOption = False,
    plugin: PluginOption = None,
) -> None:
    """C99 for the controller: forward and inverse kinematics, Jacobian, compensation.

    Example: truepose codegen result/calibrated.yaml -o controller
    """
    with reported(plugin):
        from truepose.codegen.c import generate
        from truepose.models.load import load_machine

        check_directory(output)
        if real not in ("double", "float"):
            raise InputError(f"--real: found {real!r}, expected 'double' or 'float'")
        with progress("writing C"):
            loaded = load_machine(machine)
            drawing = loaded.file.nominal if loaded.file else {}
            paths = generate(
                loaded, output, cast('Literal["double", "float"]', real), nominal=drawing or None
            )
        files = sorted(str(path) for path in paths)
        finish(
            {"command": "codegen", "machine": loaded.name, "real": real, "files": files},
            files,
            [],
            as_json=as_json,
        )
