"""Generated C with ``hostile.c`` around it, under sanitizers: what every function answered, and what broke a promise."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from support.generated_c import COMPILER, WARNINGS
from truepose.codegen.c import generate
from truepose.codegen.features import ALL, Features
from truepose.codegen.layout import layout_of
from truepose.codegen.printer import Real
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.task import COMPONENTS

DRIVER = Path(__file__).parent / "hostile.c"


@dataclass(frozen=True)
class Answers:
    """How often each function ended with each code (0 to 4), its exit code, and what was said of broken promises."""

    counts: Mapping[str, tuple[int, ...]]
    code: int
    said: str


def hostile_program(
    machine: Machine,
    folder: Path,
    real: Real,
    flags: Sequence[str],
    features: Features | str = ALL,
    changed: tuple[str, str] = ("", ""),
) -> Path:
    """The program that calls all functions of a machine's C, in ``folder``; ``changed``: a text of NAME_kin.c and what stands
    in its place."""
    assert COMPILER is not None
    compiler, name = [COMPILER, *flags], machine.name
    files = generate(machine, folder, real, features=features)
    header = (folder / f"{name}_kin.h").read_text()
    if changed[0]:
        code = folder / f"{name}_kin.c"
        code.write_text(code.read_text().replace(*changed))
    (folder / "limits.h").write_text(_limits(machine, header, real))
    shutil.copy(DRIVER, folder)
    own = [f.name for f in files if re.fullmatch(rf"{name}_\w+\.c", f.name) and f.parent == folder]
    _run(folder, [*compiler, *WARNINGS, "-c", *own])
    objects = [source.replace(".c", ".o") for source in own]
    _run(folder, [*compiler, "-std=c99", f"-DNAME={name}", DRIVER.name, *objects, "-lm", "-o", "hostile"])
    return folder / "hostile"


def answers(program: Path, *numbers: int) -> Answers:
    """What a program says after so many rounds."""
    command = [str(program), *map(str, numbers)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    counts: dict[str, list[int]] = {}
    for line in ran.stdout.splitlines():
        function, _, number = line.split()
        counts.setdefault(function, []).append(int(number))
    return Answers({name: tuple(found) for name, found in counts.items()}, ran.returncode, ran.stderr)


def functions(program: Path) -> set[str]:
    """Functions that are declared in the headers beside a program, as they are called in its answers."""
    text = "".join(path.read_text() for path in program.parent.glob("*_*.h"))
    names = r"fk_from|fk_n|fk|ik_n|ik_all|ik|jac|compensate_n|compensate|point|state_\w+"
    return set(re.findall(rf"^int \w+?_({names})\(", text, re.M))


def _run(where: Path, command: list[str]) -> None:
    """Run a compiler that must end well."""
    made = subprocess.run(command, cwd=where, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr


def _limits(machine: Machine, header: str, real: Real) -> str:
    """What the driver must know beside the header."""
    model = symbolic_model(machine, machine.effects)
    layout = layout_of(model, real)

    def array(title: str, values: Iterable[float]) -> str:
        numbers = ", ".join(repr(float(v)) for v in values)
        return f"static const double {title}[] = {{ {numbers} }};\n"

    rounded = np.finfo(np.float32 if real == "float" else np.float64).eps
    pointing = [sensor.pointed for sensor in machine.sensors if sensor.pointed]
    axis = "xyz".index(pointing[0]) if f"{machine.name}_point(" in header else -1
    return (
        array("ASKED", (float(name in layout.task.components) for name in COMPONENTS))
        + array("LOW", layout.low - rounded * np.abs(layout.low))
        + array("HIGH", layout.high + rounded * np.abs(layout.high))
        + array("START", layout.start)
        + array("WIDTH", layout.width)
        + array("UNIT", layout.unknown[: len(layout.low)])
        + f"#define REACH {layout.reach!r}\n#define POSITION {layout.position!r}\n#define ROTATION {layout.rotation!r}\n"
        + f"#define CLOSED {int(bool(len(model.home)))}\n#define POINTED {axis}\n"
        + f"#define BRANCHES {f'{machine.name}_BRANCHES' if f'{machine.name}_ik_all' in header else 0}\n"
    )
