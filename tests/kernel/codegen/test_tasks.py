"""Laws of the C of machines that meet a part of the pose: it agrees with numpy, and 0 means what it says. mm, rad."""

from __future__ import annotations

import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from support.examples import by_day
from support.generated_c import COMPILER, WARNINGS, Built, built_of, needs_compiler, run_example
from support.partial_machines import PARTIAL, as_built, partial_machine, readings
from support.recordings import rows_of
from truepose.codegen.c import generate
from truepose.codegen.printer import Real
from truepose.errors import InputError
from truepose.identification.compensation.compensate import compensate, twists_between
from truepose.identification.compensation.inverse import PoseSolver, base_frame

Array = NDArray[np.float64]
CASES = [(name, real) for real in ("double", "float") for name in PARTIAL]
ROWS = 25


@cache
def compiled(where: Path, name: str, real: Real) -> Built:
    """A machine as built, and its C."""
    machine = as_built(partial_machine(where, name), 6)
    assert machine.file
    return built_of(machine, where / f"partial_{name}_{real}", real, nominal=machine.file.nominal)


@pytest.fixture
def made(root_directory: Path, request: pytest.FixtureRequest) -> Built:
    return compiled(root_directory, *request.param)


every = pytest.mark.parametrize(
    "made",
    [pytest.param(c, id="-".join(c), marks=pytest.mark.nightly if c[1] == "float" else ()) for c in CASES],
    indirect=True,
)


def left(made: Built, solver: PoseSolver, goals: Array, q: Array) -> Array:
    """Return twists (n, 6) from goals (n, 4, 4) to the tools at readings (n, nq), of which the task counts."""
    poses, assembled = solver.forward(q)
    assert assembled.all()
    return solver.task.counted(twists_between(goals, poses), goals, base_frame(made.machine)[:3, :3])


@needs_compiler
@every
def test_its_own_example_passes(made: Built) -> None:
    run_example(made.directory, "-O1")


@needs_compiler
@every
def test_solved_means_that_the_task_is_met(made: Built) -> None:
    """Poses of another machine of the kind, whole ones that no readings meet: numpy and C meet what counts of them."""
    solver, base = PoseSolver(made.machine), base_frame(made.machine)
    q = readings(made.machine, ROWS, 7)
    goals = base @ PoseSolver(partial_machine(made.directory, made.machine.name)).forward(q)[0]
    found = [
        made.ik((np.linalg.inv(base) @ goal)[:3].ravel(), row) for goal, row in zip(goals, q, strict=True)
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
        code, command = made.call("compensate", row, out=np.zeros(len(row)))
        assert code == 0
        if len(row) == len(found.task.rows):  # of several commands that meet the task, each is right
            np.testing.assert_allclose(
                command, expected, rtol=0, atol=1e-6 if made.real == "double" else 1e-1
            )


def test_all_branches_are_refused_where_poses_are_met_in_part(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="that meets whole poses"):
        generate(partial_machine(tmp_path, "drill"), tmp_path / "c", features="warm,branches")


@needs_compiler
@pytest.mark.parametrize("features", ["warm", "warm,cold,p,batch,state"])
@pytest.mark.parametrize("name", by_day(["mill", "delta", "planar2", "tube"], "mill"))
def test_every_list_of_features_compiles(name: str, features: str, tmp_path: Path) -> None:
    """Nothing is left without use, and the example passes."""
    generate(partial_machine(tmp_path, name), tmp_path / "c", features=features)
    sources = [path.name for path in (tmp_path / "c").glob("*.c")]
    subprocess.run(
        [str(COMPILER), *WARNINGS, "-O0", *sources, "-lm", "-o", "example"], cwd=tmp_path / "c", check=True
    )
    subprocess.run([tmp_path / "c" / "example"], capture_output=True, check=True)
