"""Generated C, compiled with every warning an error and called through ctypes, beside the Python model."""

from __future__ import annotations

import csv
import ctypes
import re
import shutil
import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import root

from support.examples import NIGHT
from support.generated_machines import BODIES, machine_of
from truepose.arrays import Array
from truepose.codegen.c import generate
from truepose.codegen.printer import Real
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model
from truepose.models.machine.machine import Machine

COMPILER = shutil.which("gcc") or shutil.which("cc")
WARNINGS = [
    "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror",
]  # fmt: skip
LEVEL = "-O2" if NIGHT else "-O0"
"""Of the compiler: it takes a quarter of the time where it need not optimise, and gives the same numbers."""
SANITIZERS = ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"]
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler found")
CASES: list[tuple[str, Real]] = [(name, real) for real in ("double", "float") for name in BODIES]


@dataclass(frozen=True)
class Built:
    """A machine's C, compiled and loaded, beside its model."""

    machine: Machine
    model: SymbolicModel
    real: Real
    directory: Path
    library: ctypes.CDLL

    @property
    def dtype(self) -> type[np.floating]:
        return np.float64 if self.real == "double" else np.float32

    @property
    def n(self) -> int:
        return len(self.model.readings)

    def define(self, name: str) -> int:
        header = (self.directory / f"{self.machine.name}_kin.h").read_text()
        found = re.search(rf"#define {self.machine.name}_{name} (\d+)", header)
        assert found, name
        return int(found.group(1))

    def call(
        self, function: str, *inputs: Array, out: Array, p: Array | None = None, z: Array | None = None
    ) -> tuple[int, Array]:
        """Return code and output, which starts as a copy of ``out``."""
        arguments = [
            None if a is None else np.ascontiguousarray(a, dtype=self.dtype) for a in (p, z, *inputs)
        ]
        result = np.array(out, dtype=self.dtype)
        pointers = [None if a is None else a.ctypes.data_as(ctypes.c_void_p) for a in (*arguments, result)]
        code = getattr(self.library, f"{self.machine.name}_{function}")(*pointers)
        return int(code), result.astype(float)

    def fk(self, q: Array, p: Array | None = None, z: Array | None = None) -> tuple[int, Array]:
        return self.call("fk", q, out=np.full(12, -7.0), p=p, z=z)

    def ik(
        self, pose: Array, guess: Array, p: Array | None = None, z: Array | None = None
    ) -> tuple[int, Array]:
        return self.call("ik", pose, guess, out=np.full(self.n, -7.0), p=p, z=z)

    @cached_property
    def expressions(self) -> tuple[ca.Function, ca.Function]:
        """What the loops lack with its derivative, and the pose, of readings, drivers, parameters and unknowns."""
        model = self.model
        inputs = [model.q, model.z, model.p, model.x]
        loops = [ca.densify(model.closure), ca.densify(ca.jacobian(model.closure, model.x))]
        return ca.Function("g", inputs, loops), ca.Function("T", inputs, [ca.densify(model.pose)])

    def pose(self, q: Array, p: Array | None = None, z: Array | None = None) -> Array:
        """Pose (12,) from the model's expressions, loops closed by scipy."""
        closure, pose_of = self.expressions
        model = self.model
        given = [ca.DM(v) for v in (q, model.z_home if z is None else z, model.p_home if p is None else p)]

        def residual(x: Array) -> tuple[Array, Array]:
            g, by_x = closure(*given, ca.DM(x))
            return g.full().ravel(), by_x.full()

        x = model.home
        if len(x):
            x = root(residual, x, jac=True, tol=1e-13).x
        pose: Array = pose_of(*given, ca.DM(x)).full()
        return pose[:3].ravel()

    def samples(self, count: int = 8) -> Array:
        text = (self.directory / "test_vectors.csv").read_text()
        rows = list(csv.reader(text.splitlines()))[1:]
        assert len(rows) > count
        return np.array([[float(v) for v in row] for row in rows[1 : count + 1]])


def compile_library(folder: Path, sources: Iterable[str], *flags: str, name: str = "lib.so") -> ctypes.CDLL:
    """Compile C in its folder with every warning an error, and load it."""
    assert COMPILER is not None
    command = [COMPILER, *WARNINGS, *flags, "-shared", "-fPIC", *sources, "-lm", "-o", name]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / name))


@cache
def build(where: Path, name: str, real: Real) -> Built:
    return built_of(machine_of(where, name), where / f"{name}_{real}", real)


def built_of(
    machine: Machine, directory: Path, real: Real, nominal: Mapping[str, float] | None = None
) -> Built:
    """A machine's C, generated and compiled in a folder."""
    generate(machine, directory, real, nominal=nominal)
    # some warnings come with optimisation; the C is the same in both
    level = "-O1" if real == "double" else LEVEL
    library = compile_library(directory, [f"{machine.name}_kin.c"], level, name="kin.so")
    return Built(machine, symbolic_model(machine, machine.effects), real, directory, library)


def run_example(directory: Path, *flags: str) -> None:
    """Compile all C of a folder with its example, which must end well and say nothing of errors."""
    assert COMPILER is not None
    sources = [path.name for path in directory.glob("*.c")]
    command = [COMPILER, *WARNINGS, *flags, *sources, "-lm", "-o", "example"]
    subprocess.run(command, cwd=directory, check=True)
    done = subprocess.run([directory / "example"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout + done.stderr


def cases(
    names: tuple[str, ...] = tuple(BODIES), reals: tuple[str, ...] = ("double", "float")
) -> pytest.MarkDecorator:
    """Machines by name in each kind of numbers; by day an arm and a hexapod alone in single precision."""
    chosen = [case for case in CASES if case[0] in names and case[1] in reals]
    day = [case for case in chosen if case[1] == "double" or case[0] in ("arm", "turns")]
    params = [
        pytest.param(case, id="-".join(case), marks=() if case in day else pytest.mark.nightly)
        for case in chosen
    ]
    return pytest.mark.parametrize("built", params, indirect=True)


def has_sanitizers(where: Path) -> bool:
    """Whether the compiler can link them; ``where`` takes an empty program."""
    assert COMPILER is not None
    (where / "empty.c").write_text("int main(void) { return 0; }\n")
    command = [COMPILER, *SANITIZERS, "empty.c", "-o", "empty"]
    return subprocess.run(command, cwd=where, capture_output=True, check=False).returncode == 0
