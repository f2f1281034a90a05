"""Laws of the C of machines that meet a part of the pose: it agrees with numpy, and 0 means what it says. mm, rad."""

from __future__ import annotations

import ctypes
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from support.generated_c import COMPILER, WARNINGS, needs_compiler
from support.partial_machines import PARTIAL, as_built, partial_machine, readings
from support.recordings import rows_of
from truepose.codegen.c import generate
from truepose.codegen.printer import Real
from truepose.errors import InputError
from truepose.identification.compensation.compensate import compensate, twists_between
from truepose.identification.compensation.inverse import PoseSolver, base_frame
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
CASES = [(name, real) for real in ("double", "float") for name in PARTIAL]
ROWS = 25


@dataclass(frozen=True)
class Built:
    """A machine as built, and its C."""

    machine: Machine
    library: ctypes.CDLL
    directory: Path
    real: Real

    def call(self, function: str, *inputs: Array, size: int) -> tuple[int, Array]:
        dtype = np.float64 if self.real == "double" else np.float32
        arrays = [
            None,
            None,
            *(np.ascontiguousarray(v, dtype=dtype) for v in inputs),
            np.full(size, -7.0, dtype=dtype),
        ]
        code = getattr(self.library, f"{self.machine.name}_{function}")(
            *(None if a is None else a.ctypes.data_as(ctypes.c_void_p) for a in arrays)
        )
        return int(code), np.asarray(arrays[-1], dtype=float)


@cache
def built(where: Path, name: str, real: Real) -> Built:
    assert COMPILER is not None
    machine = as_built(partial_machine(where, name), 6)
    assert machine.file
    directory = where / f"{name}_{real}"
    generate(machine, directory, real, nominal=machine.file.nominal)
    sources = [f"{name}_kin.c", f"{name}_batch.c"]
    command = [COMPILER, *WARNINGS, "-O1"]
    subprocess.run([*command, "-shared", "-fPIC", *sources, "-lm", "-o", "lib.so"], cwd=directory, check=True)
    subprocess.run([*command, "example.c", *sources, "-lm", "-o", "example"], cwd=directory, check=True)
    return Built(machine, ctypes.CDLL(str(directory / "lib.so")), directory, real)


@pytest.fixture
def made(root_directory: Path, request: pytest.FixtureRequest) -> Built:
    name, real = request.param
    return built(root_directory, name, real)


DAY = [pytest.param(case, id="-".join(case)) for case in CASES if case[1] == "double"]
NIGHT = [
    pytest.param(case, id="-".join(case), marks=pytest.mark.nightly) for case in CASES if case[1] == "float"
]
every = pytest.mark.parametrize("made", [*DAY, *NIGHT], indirect=True)


def left(made: Built, solver: PoseSolver, goals: Array, q: Array) -> Array:
    """Return twists (n, 6) from goals (n, 4, 4) to the tools at readings (n, nq), of which the task counts."""
    poses, assembled = solver.forward(q)
    assert assembled.all()
    return solver.task.counted(twists_between(goals, poses), goals, base_frame(made.machine)[:3, :3])


@needs_compiler
@every
def test_its_own_example_passes(made: Built) -> None:
    done = subprocess.run([made.directory / "example"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


@needs_compiler
@every
def test_solved_means_that_the_task_is_met(made: Built) -> None:
    """Poses of another machine of the kind, whole ones that no readings meet: numpy and C meet what counts of them."""
    solver, base = PoseSolver(made.machine), base_frame(made.machine)
    q = readings(made.machine, ROWS, 7)
    goals = base @ PoseSolver(partial_machine(made.directory, made.machine.name)).forward(q)[0]
    found = [
        made.call("ik", (np.linalg.inv(base) @ goal)[:3].ravel(), row, size=q.shape[1])
        for goal, row in zip(goals, q, strict=True)
    ]
    solved = np.array([code == 0 for code, _ in found])
    own = solver.inverse(goals, q)
    assert (solved | ~own.solved).all()  # float: the same
    assert solved.mean() > 0.8
    twists = left(made, solver, goals[solved], np.array([row for _, row in found])[solved])
    single = 4e-6 if made.real == "float" else 0.0
    assert np.max(np.abs(twists[:, :3])) < max(1e-6, single * 2e3)
    assert np.max(np.abs(twists[:, 3:])) < max(1e-9, single)


@needs_compiler
@every
def test_commands_are_those_of_numpy(made: Built) -> None:
    q = readings(made.machine, ROWS, 8)
    found = compensate(made.machine, rows_of(q, joints=made.machine.mechanism.readings))
    assert np.mean(found.eased) < 0.2
    for row, expected in zip(q[~found.eased], found.command[~found.eased], strict=True):
        code, command = made.call("compensate", row, size=len(row))
        assert code == 0
        if len(row) == len(found.task.rows):  # of several commands that meet the task, each is right
            np.testing.assert_allclose(
                command, expected, rtol=0, atol=1e-6 if made.real == "double" else 1e-1
            )


def test_all_branches_are_refused_where_poses_are_met_in_part(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="that meets whole poses"):
        generate(partial_machine(tmp_path, "drill"), tmp_path / "c", features="warm,branches")
