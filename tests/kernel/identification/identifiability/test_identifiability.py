"""What readings can tell of parameters: one decomposition, what to expect of a fit, and the command."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from support import MACHINES
from support.reports import said_of
from support.short_arm import JOINTS, POSITION, arm, status, written
from support.simulated import observed
from truepose.arrays import Array
from truepose.cli import app
from truepose.errors import InputError
from truepose.identification.fit.decomposition import Decomposition
from truepose.identification.fit.estimate import estimate
from truepose.identification.identifiability.analysis import drawn_poses, identifiability
from truepose.identification.identifiability.observability import identifiable
from truepose.identification.recording.load import load_recording
from truepose.identification.report.identifiability_words import unseen_sentences
from truepose.identification.report.notes import worded
from truepose.models.load import load_machine

# -- one decomposition ---------------------------------------------------------------------------------


def problem(seed: int, rank: int, n: int = 6) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    return rng.standard_normal((20, rank)) @ rng.standard_normal((rank, n)), rng.uniform(0.2, 2.0, n)


@pytest.mark.parametrize("rank", [2, 5, 6])
def test_covariance_is_the_inverse_of_the_information(rank: int) -> None:
    jacobian, weight = problem(rank, rank)
    known = Decomposition.of(jacobian, weight)
    information = jacobian.T @ jacobian + np.diag(weight**2)
    np.testing.assert_allclose(known.root @ known.root.T, np.linalg.inv(information), rtol=1e-9, atol=1e-12)
    used = np.trace(np.linalg.solve(information, jacobian.T @ jacobian))
    assert known.effective == pytest.approx(used, rel=1e-9)
    assert (known.rank, len(known.null_space), len(known.unknown)) == (rank, 6 - rank, 0)
    np.testing.assert_allclose(jacobian @ known.null_space.T, 0.0, atol=1e-12)


def test_every_parameter_of_an_unknown_direction_is_unknown() -> None:
    """Two pairs of which only the sums show, of the second pair another part: each pair is unknown by itself."""
    jacobian = np.zeros((6, 5))
    jacobian[:2, :2], jacobian[2:4, 2:4] = [[3.0, 3.0], [1.0, 1.0]], [[2.0, 4.0], [1.0, 2.0]]
    jacobian[4:, 4] = [1.0, 2.0]
    found = Decomposition.of(jacobian, np.zeros(5))
    assert len(found.unknown) == 2
    assert np.isinf(found.std).tolist() == [True] * 4 + [False]
    assert found.std[4] == pytest.approx(5.0**-0.5)
    one = Decomposition.of(jacobian, np.array([0.0, 0.0, 0.5, 0.0, 0.0]))
    assert np.isinf(one.std).tolist() == [True, True, False, False, False]


def test_what_neither_readings_nor_prior_hold_is_unknown_and_nothing_else() -> None:
    """Two columns that only their sum shows; the prior holds neither, or one of them."""
    jacobian = np.array([[1.0, 1.0, 0.0], [2.0, 2.0, 1.0], [0.0, 0.0, 3.0]])
    loose = Decomposition.of(jacobian, np.zeros(3))
    np.testing.assert_allclose(np.abs(loose.unknown), [[np.sqrt(0.5), np.sqrt(0.5), 0.0]], atol=1e-12)
    assert loose.std[:2].tolist() == [np.inf, np.inf]
    assert loose.std[2] == pytest.approx(np.linalg.inv(jacobian[:, 1:].T @ jacobian[:, 1:])[1, 1] ** 0.5)
    held = Decomposition.of(jacobian, np.array([2.0, 0.0, 0.0]))
    assert held.rank == loose.rank == 2
    assert len(held.unknown) == 0
    assert held.std[0] == pytest.approx(0.5)
    assert held.effective == pytest.approx(2.0)


def test_observability_indices_of_a_diagonal_problem() -> None:
    found = Decomposition.of(np.diag([8.0, 4.0, 2.0, 0.0]), np.ones(4)).observability(16)
    assert found.o1 == pytest.approx(4.0 / 4.0)
    assert found.o2 == pytest.approx(0.25)
    assert found.o3 == pytest.approx(2.0)
    assert found.o4 == pytest.approx(0.5)
    assert found.o5 == pytest.approx(1.0 / (1 / 8 + 1 / 4 + 1 / 2))
    assert found.condition == pytest.approx(4.0)


# -- what to expect ------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["serial", "ups"])
def test_expected_sigmas_are_those_of_the_fit_to_come(kind: str) -> None:
    machine = load_machine(MACHINES / f"{kind}.yaml")
    if kind == "ups":  # its base may be anywhere: a fit needs to be near
        frames = tuple(replace(p, tolerance=min(p.tolerance, 1.0)) for p in machine.frames)
        machine = replace(machine, frames=frames)
    poses = drawn_poses(machine, 40)
    found = identifiability(machine, poses)
    fit = estimate(machine, observed(machine, poses, seed=4))
    at_drawing = np.array([p.std_at_drawing for p in found.parameters])
    # the fit is a few tolerances' thousandths away from the drawing
    np.testing.assert_allclose(at_drawing, np.sqrt(np.diag(fit.posterior)), rtol=0.02)
    agree = [
        (status(found)[name] == "determined") == flag or 0.6 < p.std / p.tolerance < 0.8
        for p, (name, flag) in zip(found.parameters, identifiable(fit).items(), strict=True)
    ]
    assert all(agree)


def test_the_order_of_poses_and_their_repeats(tmp_path: Path) -> None:
    """Shuffled rows say the same; every row four times halves what the readings leave."""
    machine = arm(tmp_path, "q3.d: .inf", "q2.alpha: .inf", frames="", sensor=POSITION)
    poses = drawn_poses(machine, 15)
    one = identifiability(machine, poses)
    shuffled = identifiability(machine, poses.subset(np.random.default_rng(1).permutation(15)))
    fourfold = identifiability(machine, poses.subset(np.tile(np.arange(15), 4)))
    std = np.array([p.std_at_drawing for p in one.parameters])
    np.testing.assert_allclose([p.std_at_drawing for p in shuffled.parameters], std, rtol=1e-9)
    np.testing.assert_allclose([p.std_at_drawing for p in fourfold.parameters], std / 2, rtol=1e-9)
    assert fourfold.indices.o3 == pytest.approx(2 * one.indices.o3)
    assert fourfold.indices.o1 == pytest.approx(one.indices.o1)  # O1 is by root of the readings


def test_without_any_tolerance_nothing_decides(tmp_path: Path) -> None:
    machine = arm(
        tmp_path, "q1.r: .inf", "q2.r: 0.1", frames="frames: {base: {tolerance: {xyz: .inf, rpy: 0}}}\n"
    )
    found = identifiability(machine)
    assert status(found) == {
        "q1.r": "nothing decides",
        "q2.r": "determined",
        "base.x": "determined",
        "base.y": "determined",
        "base.z": "nothing decides",
    }
    said = " ".join(said_of(found))
    assert "nothing decides, they stay at the drawing" in said


def test_rows_that_cannot_be_assembled_are_noted() -> None:
    machine = load_machine(MACHINES / "ups.yaml")
    poses = drawn_poses(machine, 20)
    q = poses.q.copy()
    q[3, 2] = 500.0  # turns: one leg of 2.8 m
    found = identifiability(machine, replace(poses, q=q))
    assert found.poses == 19
    assert worded(found.notes) == [
        "drawn poses: row 4: the mechanism cannot be assembled there; the row was left out",
    ]


# -- refusals and the command --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            (", range: [-120, 120]", ""),
            r"joint q2: found no range to draw poses from, expected 'range: \[low, high\]'",
        ),
        (("  q3.d: 0.2\n", ""), "found no free parameter, expected a tolerance above 0"),
    ],
)
def test_what_cannot_be_looked_at_is_refused(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    text = JOINTS + POSITION + "tolerances:\n  length: 0\n  angle: 0\n  q3.d: 0.2\n"
    machine = written(tmp_path, text.replace(*change))
    with pytest.raises(InputError, match=message):
        identifiability(machine)


def run(*arguments: object) -> str:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_the_command_speaks_and_writes(tmp_path: Path) -> None:
    machine = MACHINES / "distance.yaml"
    lines = run("identifiability", machine)
    assert "100 poses drawn over the joints' ranges (seed 20)" in lines
    said = " ".join(lines.split())
    assert "x.r, beam.y and beam.rz, each alone: no reading changes when one of them moves" in said
    assert "30 poses drawn" in run("identifiability", machine, "-n", 30)
    document: Mapping[str, object] = json.loads(run("identifiability", machine, "--json"))
    assert document["schema"] == "truepose/identifiability/1" and document["rank"] == 9
    run("identifiability", machine, "-o", tmp_path / "one.json")
    one = json.loads((tmp_path / "one.json").read_text("utf-8"))
    assert one["parameters"] == document["parameters"]


def test_a_step_of_another_size_changes_no_rank_and_no_sigma() -> None:
    jacobian, weight = problem(9, 4)
    steps = np.array([1e-3, 1.0, 10.0, 1e3, 0.1, 5.0])
    one, other = Decomposition.of(jacobian, weight), Decomposition.of(jacobian * steps, weight * steps)
    assert other.rank == one.rank
    np.testing.assert_allclose(other.std * steps, one.std, rtol=1e-7)


def test_readings_are_not_needed_and_change_nothing(tmp_path: Path) -> None:
    machine = load_machine(MACHINES / "serial.yaml")
    rng = np.random.default_rng(5)
    low, high = np.array([a.range for a in machine.mechanism.actuators], dtype=float).T
    q = pd.DataFrame(rng.uniform(low, high, (20, 3)), columns=["q1 [mm]", "q2 [rad]", "q3 [rad]"])
    q.to_csv(tmp_path / "poses.csv", index=False)
    run("simulate", MACHINES / "serial.yaml", tmp_path / "poses.csv", "-o", tmp_path / "read.csv")
    bare, read = (
        identifiability(machine, load_recording(machine, [tmp_path / name], need_observations=False))
        for name in ("poses.csv", "read.csv")
    )
    assert (
        (bare.poses, bare.n_observations, bare.rank)
        == (read.poses, read.n_observations, read.rank)
        == (20, 60, 13)
    )
    np.testing.assert_allclose([p.std for p in bare.parameters], [p.std for p in read.parameters], rtol=1e-9)
    assert unseen_sentences(bare.unseen) == unseen_sentences(read.unseen)
