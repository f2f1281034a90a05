"""Hostile input to the generated C under sanitizers: whatever comes in, every promise of the interface is kept."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from support import TESTS
from support.examples import NIGHT, examples
from support.generated_c import CASES, COMPILER, WARNINGS, needs_compiler
from support.generated_machines import machine_of
from truepose.codegen.c import generate
from truepose.codegen.layout import layout_of
from truepose.codegen.printer import Real
from truepose.models.kinematics import symbolic_model

DRIVER = TESTS / "lib" / "support" / "hostile.c"
ROUNDS = examples(120)
"""Of each machine: with fewer, some function meets hostile input that it refuses ten times or less."""
TURN_ABOUT = [case for k, case in enumerate(CASES) if case[0] in ("arm", "rails") or (k % 2 == 0)]
"""An open chain and a closed one in either precision, the other machines in one of them: templates are the same in both."""
TRIED = CASES if NIGHT else TURN_ABOUT
IDS = ["-".join(case) for case in TRIED]


def run(where: Path, command: list[str]) -> None:
    """Run a compiler that must end well."""
    made = subprocess.run(command, cwd=where, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr


def limits(name: str, where: Path, real: Real) -> str:
    """What the driver must know beside the header."""
    machine = machine_of(where, name)
    model = symbolic_model(machine, machine.effects)
    layout = layout_of(model, real)
    header = (where / "out" / f"{name}_kin.h").read_text()

    def array(title: str, values: Iterable[float]) -> str:
        numbers = ", ".join(repr(float(v)) for v in values)
        return f"static const double {title}[] = {{ {numbers} }};\n"

    rounded = np.finfo(np.float32 if real == "float" else np.float64).eps
    return (
        array("LOW", layout.low - rounded * np.abs(layout.low))
        + array("HIGH", layout.high + rounded * np.abs(layout.high))
        + array("START", layout.start)
        + array("WIDTH", layout.width)
        + array("UNIT", layout.unknown[: len(layout.low)])
        + f"#define REACH {layout.reach!r}\n#define POSITION {layout.position!r}\n#define ROTATION {layout.rotation!r}\n"
        + f"#define CLOSED {int(bool(len(model.home)))}\n"
        + f"#define BRANCHES {f'{name}_BRANCHES' if f'{name}_ik_all' in header else 0}\n"
    )


def counted(text: str) -> dict[str, list[int]]:
    """How often each function ended with each code."""
    counts: dict[str, list[int]] = {}
    for line in text.splitlines():
        function, _, number = line.split()
        counts.setdefault(function, []).append(int(number))
    return counts


@needs_compiler
@pytest.mark.parametrize(("name", "real"), TRIED, ids=IDS)
def test_hostile_input_keeps_every_promise(
    tmp_path: Path, sanitizers: list[str], name: str, real: Real
) -> None:
    assert COMPILER is not None
    compiler = [COMPILER, "-O0", *sanitizers]  # nothing that they watch is optimised away
    generate(machine_of(tmp_path, name), tmp_path / "out", real)
    (tmp_path / "out" / "limits.h").write_text(limits(name, tmp_path, real))
    shutil.copy(DRIVER, tmp_path / "out")
    generated = [f"{name}_kin.c", f"{name}_batch.c"]
    run(tmp_path / "out", [*compiler, *WARNINGS, "-c", *generated])
    objects = [source.replace(".c", ".o") for source in generated]
    run(
        tmp_path / "out",
        [*compiler, "-std=c99", f"-DNAME={name}", DRIVER.name, *objects, "-lm", "-o", "hostile"],
    )
    ran = subprocess.run(
        [tmp_path / "out" / "hostile", str(ROUNDS)], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr + ran.stdout
    counts = counted(ran.stdout)
    for function, by_code in counts.items():
        if sum(by_code) == 0:
            assert function == "ik_all" and name not in ("arm", "nano")
            continue
        assert by_code[0] > 10, (function, by_code)
        assert by_code[4] > 10, (function, by_code)
    assert sum(counts["ik"][1:4]) > 5
