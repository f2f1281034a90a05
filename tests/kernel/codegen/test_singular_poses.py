"""Laws of commands at and next to poses where a joint turns the tool no longer: C and numpy. mm, rad."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from support.examples import by_day
from support.generated_c import needs_compiler, run_example
from support.partial_machines import as_built, partial_machine, readings
from support.recordings import rows_of
from support.wrapped import python_at
from truepose.codegen.c import generate
from truepose.identification.compensation.compensate import Compensation, compensate
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
TILTING = {"mill": "A", "head_and_table": "B", "delta5": "turn_x"}
"""Machines, and the joint at whose zero the tool stands along the axis of another one."""
TILTS = [sign * size for size in (0.0, 1e-6, 1e-4, 1e-3, 1e-2, 0.1) for sign in (1, -1)]
ERRORS = [1e-5, 1e-4, 1e-3]
SEEDS = range(3)
FARTHEST = 0.05
POSITION, TURN = 1e-9, 1e-12


@dataclass(frozen=True)
class Followed:
    """A machine as built, nominal readings (n, nq) at and next to a singular pose, its constants, and commands of numpy."""

    machine: Machine
    q: Array
    p: list[float]
    found: Compensation


@cache
def drawn(where: Path, name: str) -> Machine:
    return partial_machine(where, name)


@cache
def compiled(where: Path, name: str) -> Any:
    """Return the kinematics of the generated C; constants are given to every call."""
    directory = where / f"{name}_singular"
    generate(drawn(where, name), directory)
    return python_at(directory / "wrappers" / f"{name}_kin.py").build(flags=("-O1",))


def followed(where: Path, name: str, error: float, seed: int, tilts: list[float]) -> Followed:
    """Return a machine whose axes are out of square by about ``error``, on a path with these tilts."""
    machine = as_built(drawn(where, name), seed, length=0.01, angle=error)
    joints = machine.mechanism.readings
    q = readings(machine, len(tilts), seed)
    q[:, joints.index(TILTING[name])] = tilts
    found = compensate(machine, rows_of(q, joints=joints))
    return Followed(machine, q, symbolic_model(machine).p_home.tolist(), found)


def turning(machine: Machine) -> list[int]:
    return [k for k, actuator in enumerate(machine.mechanism.actuators) if actuator.unit == "rad"]


every = pytest.mark.parametrize(
    ("name", "error"), [(name, error) for name in TILTING for error in ERRORS], ids=str
)


@needs_compiler
@every
@pytest.mark.parametrize("seed", by_day(SEEDS, 0))
def test_c_and_numpy_put_the_tool_at_the_same_place(
    name: str, error: float, seed: int, root_directory: Path
) -> None:
    kinematics, one = compiled(root_directory, name), followed(root_directory, name, error, seed, TILTS)
    for k, row in enumerate(one.q):
        command, left = kinematics.compensate_near(row, p=one.p)
        np.testing.assert_allclose(command, one.found.command[k], rtol=0, atol=1e-8)
        apart = kinematics.fk(command, p=one.p) - kinematics.fk(one.found.command[k], p=one.p)
        assert np.max(np.abs(apart[:, 3])) < POSITION
        assert np.max(np.abs(apart[:, :3])) < TURN
        assert left == pytest.approx(np.linalg.norm(one.found.after[k, 3:]), abs=TURN)
        assert (left > 0) == one.found.eased[k]


@every
@pytest.mark.parametrize("seed", by_day(SEEDS, 0))
def test_the_position_is_met_and_less_turn_is_left_than_the_machine_errs(
    name: str, error: float, seed: int, root_directory: Path
) -> None:
    """And no turning joint moves farther than it may; what is not said to be met nearly is met."""
    one = followed(root_directory, name, error, seed, TILTS)
    after, before = (np.linalg.norm(t[:, 3:], axis=1) for t in (one.found.after, one.found.before))
    assert np.max(np.abs(one.found.after[:, :3])) < 1e-6
    assert np.all(after <= before + 1e-9)
    assert np.max(after[~one.found.eased], initial=0.0) < 1e-9
    moved = np.abs(one.found.command - one.q)[:, turning(one.machine)]
    assert np.max(moved[one.found.eased], initial=0.0) < FARTHEST + 10 * error


@every
def test_far_from_the_singular_pose_all_is_met(name: str, error: float, root_directory: Path) -> None:
    one = followed(root_directory, name, error, 7, [0.25, -0.25, 0.8, -1.1])
    assert not one.found.eased.any()
    assert np.max(np.abs(one.found.after[:, 3:])) < 1e-9


@pytest.mark.parametrize("name", TILTING)
def test_a_path_through_the_singular_pose_has_no_jumps(name: str, root_directory: Path) -> None:
    """A swing that changes its side would be a jump of twice what a joint may move."""
    machine = as_built(drawn(root_directory, name), 3, length=0.01, angle=1e-3)
    joints = machine.mechanism.readings
    q = np.tile(readings(machine, 1, 3), (4001, 1))
    q[:, joints.index(TILTING[name])] = np.linspace(-0.1, 0.1, len(q))
    found = compensate(machine, rows_of(q, joints=joints))
    correction = (found.command - q)[:, turning(machine)]
    assert found.eased.any() and not found.eased.all()
    assert np.max(np.abs(np.diff(correction, axis=0))) < 0.1 * FARTHEST


@needs_compiler
@pytest.mark.parametrize("name", TILTING)
def test_compensate_refuses_what_is_met_nearly(name: str, root_directory: Path) -> None:
    """Else its command is that of ``compensate_near``."""
    kinematics, one = compiled(root_directory, name), followed(root_directory, name, 1e-4, 11, TILTS)
    refused = []
    for row in one.q:
        near, left = kinematics.compensate_near(row, p=one.p)
        (exact,), (code,) = kinematics.compensate_n(row[None], p=one.p)
        refused.append(code == 1)
        assert code == (1 if left > 0 else 0)
        np.testing.assert_array_equal(exact, near if code == 0 else np.full(len(row), np.nan))
    assert any(refused) and not all(refused)


@needs_compiler
@pytest.mark.parametrize("name", ["mill", "head_and_table", "scara", "gantry", "pan_tilt"])
@pytest.mark.parametrize("real", by_day(["double", "float"], "double"))
def test_the_example_of_a_machine_that_remembers_passes(name: str, real: Any, tmp_path: Path) -> None:
    """It follows a path from the middle of the ranges, which is a singular pose of a mill."""
    machine = as_built(partial_machine(tmp_path, name), 8, angle=2e-4)
    assert machine.file
    directory = tmp_path / "c"
    generate(machine, directory, real, nominal=machine.file.nominal, features="warm,cold,p,batch,state")
    run_example(directory, "-O1")
