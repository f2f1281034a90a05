"""Rank, unseen directions, expected 1-sigma and independent sets: what they owe the Jacobian and the machine."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from truepose.cli import app
from truepose.errors import InputError
from truepose.identification.decomposition import Decomposition
from truepose.identification.estimate import estimate
from truepose.identification.identifiability.analysis import Identifiability, drawn_poses, identifiability
from truepose.identification.identifiability.patterns import patterns
from truepose.identification.identifiability.subset import (
    Columns,
    independent_subset,
    sequential_subset,
    spectral_reduction,
)
from truepose.identification.identifiability.words import identifiability_lines, unseen_sentences
from truepose.identification.load import load_recording
from truepose.identification.observability import Direction, Knowledge, identifiable, nearly_unseen
from truepose.identification.prediction import Predictor
from truepose.identification.simulate import simulate
from truepose.models.load import load_machine
from truepose.models.machine import Machine

Array = NDArray[np.float64]
MACHINES = Path(__file__).parent / "machines"
HEAD = "schema: truepose/machine/1\nname: arm\n"
JOINTS = """mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: -90, d: 50, range: [-120, 120]}
    - {name: q3, kind: revolute, d: 400, range: [-120, 120]}
    - {name: q4, kind: revolute, alpha: -90, r: 350, range: [-120, 120]}
"""
FRAMES = """frames:
  base: {tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [20, 30, 80], tolerance: {xyz: 1, rpy: 1}}
"""
POSE = "sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.005}}\n"
POSITION = "sensor: {type: position, sigma: {xyz: 0.01}}\n"


def written(folder: Path, text: str, name: str = "arm") -> Machine:
    path = folder / f"{name}.yaml"
    path.write_text(HEAD + text, encoding="utf-8")
    return load_machine(path)


def arm(folder: Path, *free: str, sensor: str = POSE, frames: str = FRAMES) -> Machine:
    """The arm with some tolerances, ``q1.r: 0.2`` each."""
    rows = "".join(f"  {item}\n" for item in ("length: 0", "angle: 0", *free))
    return written(folder, JOINTS + frames + sensor + "tolerances:\n" + rows)


def status(found: Identifiability) -> dict[str, str]:
    return {p.name: p.status for p in found.parameters}


def parts(direction: Direction) -> dict[str, float]:
    return dict(direction.parts)


# --- one decomposition ------------------------------------------------------------------------------------


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


def test_a_step_of_another_size_changes_no_rank_and_no_sigma() -> None:
    jacobian, weight = problem(9, 4)
    steps = np.array([1e-3, 1.0, 10.0, 1e3, 0.1, 5.0])
    one, other = Decomposition.of(jacobian, weight), Decomposition.of(jacobian * steps, weight * steps)
    assert other.rank == one.rank
    np.testing.assert_allclose(other.std * steps, one.std, rtol=1e-7)


# --- rank and words ---------------------------------------------------------------------------------------


def test_trades_of_frames_and_end_joints_are_named_with_their_coefficients(tmp_path: Path) -> None:
    machine = arm(tmp_path, "q1.r: 0.2", "q1.theta: 0.1", "q4.r: 0.2", "q4.theta: 0.1", "q3.d: 0.2")
    found = identifiability(machine)
    assert (found.free, found.rank, found.rank_at_drawing) == (17, 13, 13)
    pairs = {frozenset(d.parts): parts(d) for d in found.unseen.directions}
    # the tool's point is off the last axis: turning q4 carries it along
    turning = frozenset(("tool.x", "tool.y", "tool.rz", "q4.theta"))
    two = (("base.z", "q1.r"), ("base.rz", "q1.theta"), ("tool.z", "q4.r"))
    assert set(pairs) == {*(frozenset(pair) for pair in two), turning}
    about = pairs[turning]
    assert about["tool.rz"] / about["q4.theta"] == pytest.approx(-1.0, abs=1e-6)
    # -[z x (20, 30)]: what undoes the turn of a point
    assert about["tool.x"] / about["q4.theta"] == pytest.approx(30.0, rel=1e-6)
    assert about["tool.y"] / about["q4.theta"] == pytest.approx(-20.0, rel=1e-6)
    along = pairs[frozenset(("base.z", "q1.r"))]
    assert along["base.z"] / along["q1.r"] == pytest.approx(-1.0, abs=1e-6)
    said = " ".join(identifiability_lines(found))
    assert re.search(
        "(base.z and q1.r|q1.r and base.z) trade with each other: only one combination of the two is", said
    )
    assert status(found)["q3.d"] == "determined"
    assert status(found)["q1.r"] == "tolerance decides"
    assert status(found)["base.z"] == "partly"  # by the tolerance of q1.r, and no better
    (base,) = [p for p in found.parameters if p.name == "base.z"]
    assert base.partners == ("q1.r",)
    assert base.std == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize("kind", ["serial", "ups", "pus"])
def test_no_reading_changes_along_an_unseen_direction(kind: str) -> None:
    """Finite steps, against the machine itself and not its Jacobian."""
    machine = load_machine(MACHINES / f"{kind}.yaml")
    poses = drawn_poses(machine, 12)
    found = identifiability(machine, poses)
    assert found.unseen.directions
    predictor = Predictor(machine, poses)
    p = predictor.model.p_home
    names = list(predictor.model.names)
    blind = Decomposition.of(found.known.decomposition.null_space, np.zeros(found.free)).seen
    for row in blind:
        change = np.zeros(len(p))
        for name, value, scale in zip(found.known.names, row, found.known.scale, strict=True):
            change[names.index(name)] = value * scale
        shown = []
        for size in (1e-2, 5e-3):
            ends = [
                predictor.columns(p + s * change, predictor.assemble(p + s * change)[0])[1]
                for s in (size, -size)
            ]
            shown.append(np.max(np.abs(ends[0] - ends[1])) / size)
        # central differences of a null direction are of third order: halving the step leaves less than a half
        assert shown[1] < 0.5 * shown[0] or shown[1] < 1e-8


def test_bodies_that_may_be_placed_anywhere_are_said_in_one_sentence_each() -> None:
    found = identifiability(load_machine(MACHINES / "ups.yaml"))
    assert unseen_sentences(found.unseen) == [
        "points leg1..leg6 a move as one body along x, y, z and about x, y, z; "
        "base.x, base.y, base.z, base.rx, base.ry, base.rz would undo it",
        "points leg1..leg6 b move as one body along x, y, z and about x, y, z; "
        "tool.x, tool.y, tool.z, tool.rx, tool.ry, tool.rz would undo it",
    ]


def test_targets_and_platform_without_a_tool_frame_float_together() -> None:
    said = unseen_sentences(identifiability(load_machine(MACHINES / "pus.yaml")).unseen)
    assert any(
        text.startswith("points leg1..leg6 b, P1, P2 and P3 move as one body along x, y, z and about x, y, z")
        and "nobody's measurement" in text
        for text in said
    )


def synthetic(names: tuple[str, ...], value: Array, rows: Array) -> Knowledge:
    units = tuple("mm" for _ in names)
    ones = np.ones(len(names))
    return Knowledge(names, units, value, ones, ones, Decomposition.of(rows, ones))


def test_a_common_factor_and_a_common_shift_are_recognised() -> None:
    """Readings that see every combination but one."""
    names, value = ("a.x", "leg1.offset", "leg2.offset", "leg3.offset"), np.array([3.0, 1.0, 2.0, 5.0])
    for kind, hidden in (("scale", value), ("shift", np.array([0.0, 1.0, 1.0, 1.0]))):
        unit = hidden / np.linalg.norm(hidden)
        known = synthetic(names, value, np.eye(4) - np.outer(unit, unit))
        found = patterns(known, known.decomposition.null_space, dict(zip(names, value, strict=True)), {})
        assert [p.kind for p in found] == [kind]
        cosine = found[0].change @ hidden / np.linalg.norm(found[0].change) / np.linalg.norm(hidden)
        assert abs(cosine) == pytest.approx(1.0)
    known = synthetic(names, value, np.eye(4)[:3])
    assert patterns(known, known.decomposition.null_space, {}, {}) == ()


def test_parallel_axes_hide_an_offset_at_the_drawing_only(tmp_path: Path) -> None:
    """q2 and q3 are parallel: r of both shows as one until alpha, as built, tilts them."""
    free = ("q2.r: 0.2", "q3.r: 0.2", "q3.alpha: 0.1")
    found = identifiability(arm(tmp_path, *free, frames="", sensor=POSITION))
    assert (found.rank_at_drawing, found.rank, found.free) == (2, 3, 3)
    assert not found.unseen.directions
    (hidden,) = found.unseen_at_drawing
    assert set(hidden.parts) == {"q2.r", "q3.r"}
    # a tilt of some 0.1 deg moves 0.2 mm by less than a um, a thirtieth of sigma, in 300 readings
    assert 0.0 < found.as_built_size < 3.0
    assert "hardly seen on a machine as built" in " ".join(identifiability_lines(found))
    assert status(found) == {"q2.r": "partly", "q3.alpha": "determined", "q3.r": "partly"}
    exact = identifiability(arm(tmp_path, *free[:2], frames="", sensor=POSITION))
    assert (exact.rank_at_drawing, exact.rank) == (1, 1)
    assert len(exact.unseen.directions) == 1 and not exact.unseen_at_drawing


def test_what_the_readings_see_worse_than_the_drawing_is_said(tmp_path: Path) -> None:
    """Against the dense generalised problem: poses so few and near that d of two joints nearly agree."""
    machine = arm(tmp_path, "q2.d: 0.5", "q3.d: 0.5", "q4.r: 0.5", sensor=POSITION, frames="")
    rng = np.random.default_rng(3)
    poses = drawn_poses(machine, 12)
    near = replace(poses, q=0.2 + 0.003 * rng.standard_normal(poses.q.shape))
    found = identifiability(machine, near)
    assert found.rank == 3
    jacobian = found.known.decomposition.singular[:, None] * found.known.decomposition.directions
    weak = np.linalg.svd(jacobian, compute_uv=False)
    assert len(found.nearly) == int(np.sum(weak < 1.0)) >= 1
    assert found.nearly[0].size == pytest.approx(weak[-1], rel=0.05)


def test_a_free_companion_is_allowed_for_before_a_direction_counts_as_seen() -> None:
    """x and y show as x + y; y is of infinite tolerance, so that x is not seen at all beyond its own column."""
    names = ("x", "y")
    rows = np.array([[5.0, 5.0], [0.3, 0.0]])
    sigma = np.array([1.0, np.inf])
    known = Knowledge(
        names, ("mm", "mm"), np.zeros(2), sigma, np.ones(2), Decomposition.of(rows, np.array([1.0, 0.0]))
    )
    (weak,) = nearly_unseen(known)
    assert set(weak.parts) == {"x"}
    assert weak.size == pytest.approx(0.3)


# --- what to expect ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["serial", "ups"])
def test_expected_sigmas_are_those_of_the_fit_to_come(kind: str) -> None:
    machine = load_machine(MACHINES / f"{kind}.yaml")
    if kind == "ups":  # its base may be anywhere: a fit needs to be near
        frames = tuple(replace(p, tolerance=min(p.tolerance, 1.0)) for p in machine.frames)
        machine = replace(machine, frames=frames)
    poses = drawn_poses(machine, 40)
    found = identifiability(machine, poses)
    metric = replace(machine, file=None)
    frame = simulate(metric, poses, seed=4)
    units = {name: unit for sensor in machine.sensors for name, unit in sensor.columns.items()}
    turn = {name: np.pi / 180 if unit == "rad" else 1.0 for name, unit in units.items()}
    read = {name: turn[name] * frame[name].to_numpy() for name in map(str, frame)}
    fit = estimate(machine, replace(poses, readings=read))
    at_drawing = np.array([p.std_at_drawing for p in found.parameters])
    # the fit is a few tolerances' thousandths away from the drawing
    np.testing.assert_allclose(at_drawing, fit.std[fit.prior.free], rtol=0.02)
    agree = [
        (status(found)[name] == "determined") == flag or 0.6 < p.std / p.tolerance < 0.8
        for p, (name, flag) in zip(found.parameters, identifiable(fit).items(), strict=True)
    ]
    assert all(agree)


def test_readings_are_not_needed_and_change_nothing(tmp_path: Path) -> None:
    machine = load_machine(MACHINES / "serial.yaml")
    rng = np.random.default_rng(5)
    low, high = np.array([a.range for a in machine.mechanism.actuators], dtype=float).T
    q = pd.DataFrame(rng.uniform(low, high, (20, 3)), columns=["q1 [mm]", "q2 [rad]", "q3 [rad]"])
    q.to_csv(tmp_path / "poses.csv", index=False)
    run("simulate", MACHINES / "serial.yaml", tmp_path / "poses.csv", "-o", tmp_path / "read.csv")
    bare, read = (
        identifiability(machine, load_recording(machine, [tmp_path / name], need_readings=False))
        for name in ("poses.csv", "read.csv")
    )
    assert (bare.poses, bare.readings, bare.rank) == (read.poses, read.readings, read.rank) == (20, 60, 13)
    np.testing.assert_allclose([p.std for p in bare.parameters], [p.std for p in read.parameters], rtol=1e-9)
    assert unseen_sentences(bare.unseen) == unseen_sentences(read.unseen)


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
    said = " ".join(identifiability_lines(found))
    assert "nothing decides, they stay at the drawing" in said


def test_rows_that_cannot_be_assembled_are_noted() -> None:
    machine = load_machine(MACHINES / "ups.yaml")
    poses = drawn_poses(machine, 20)
    q = poses.q.copy()
    q[3, 2] = 500.0  # turns: one leg of 2.8 m
    found = identifiability(machine, replace(poses, q=q))
    assert found.poses == 19
    assert found.notes == (
        "drawn poses: row 4: the mechanism cannot be assembled there; the row was left out",
    )


# --- independent sets -------------------------------------------------------------------------------------


def columns(seed: int = 0) -> Columns:
    """a, b, c independent; d = 2a - b; e nearly c; f unseen."""
    rng = np.random.default_rng(seed)
    a, b, c = rng.standard_normal((3, 30))
    factor = np.column_stack([a, b, c, 2 * a - b, c + 1e-3 * rng.standard_normal(30), np.zeros(30)])
    scale = np.array([1.0, 10.0, 0.1, 1.0, 1.0, 1.0])
    return Columns(tuple("abcdef"), factor * scale, scale)


def test_a_set_is_independent_maximal_and_says_what_the_others_show_like() -> None:
    h = columns()
    found = independent_subset(h)
    assert len(found.kept) == h.rank == 4
    kept = [h.names.index(name) for name in found.kept]
    assert np.linalg.matrix_rank(h.factor[:, kept]) == 4
    for left, terms in found.relations.items():
        k = h.names.index(left)
        shown = sum(
            (value * h.factor[:, h.names.index(n)] / h.scale[h.names.index(n)] for n, value in terms.items()),
            np.zeros(30),
        )
        np.testing.assert_allclose(shown, h.factor[:, k] / h.scale[k], atol=1e-9)
    assert found.relations["f"] == {}
    assert found.condition == pytest.approx(np.linalg.cond(h.factor[:, kept]))


def test_sequential_sets_take_columns_in_order() -> None:
    h = columns()
    assert sequential_subset(h).kept == ("a", "b", "c", "e")
    assert sequential_subset(h, tolerance=0.1).kept == ("a", "b", "c")  # e is new by a thousandth of itself
    assert sequential_subset(h, ("d", "f")).kept == ("d", "a", "c", "e")
    relation = sequential_subset(h).relations["d"]
    assert relation == pytest.approx({"a": 2.0, "b": -1.0})
    assert sequential_subset(h, order="cb").kept == ("c", "b")
    with pytest.raises(InputError, match="found no free parameter 'z'"):
        sequential_subset(h, ("z",))


def test_spectral_reduction_is_of_full_rank_and_loses_nothing() -> None:
    h = columns()
    found = spectral_reduction(h)
    reduced = h.factor @ found.directions.T
    assert reduced.shape[1] == h.rank == 4
    np.testing.assert_allclose(np.diag(reduced.T @ reduced), found.eigenvalues, rtol=1e-8)
    np.testing.assert_allclose(reduced @ found.directions, h.factor, atol=1e-7)


def test_ties_go_to_the_first_and_a_least_size_leaves_the_rest() -> None:
    factor = np.diag([3.0, 3.0 * (1 + 1e-12), 0.5])
    h = Columns(("p", "q", "r"), factor, np.ones(3))
    assert independent_subset(h).kept == ("p", "q", "r")
    assert independent_subset(h, least=1.0).kept == ("p", "q")


@pytest.mark.parametrize("kind", ["serial", "ups", "pus", "distance"])
def test_the_set_of_a_machine_has_its_rank(kind: str) -> None:
    found = identifiability(load_machine(MACHINES / f"{kind}.yaml"))
    assert len(found.subset.kept) == found.rank_at_drawing
    assert not set(found.subset.kept) & set(found.subset.relations)
    assert set(found.subset.kept) | set(found.subset.relations) == set(found.known.names)
    assert identifiability(load_machine(MACHINES / f"{kind}.yaml")).subset == found.subset


# --- refusals and the command -----------------------------------------------------------------------------


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
    assert "x.r, beam.y and beam.rz, each alone: no reading changes when one of them moves" in lines
    assert "30 poses drawn" in run("identifiability", machine, "-n", 30)
    document: Mapping[str, object] = json.loads(run("identifiability", machine, "--json"))
    assert document["schema"] == "truepose/identifiability/1" and document["rank"] == 9
    run("identifiability", machine, "-o", tmp_path / "one.json")
    run("identifiability", machine, "-o", tmp_path / "two")
    one, two = (
        json.loads(p.read_text("utf-8"))
        for p in (tmp_path / "one.json", tmp_path / "two/identifiability.json")
    )
    assert one == two and one["parameters"] == document["parameters"]


def test_every_parameter_is_listed_when_asked_for() -> None:
    machine = MACHINES / "ups.yaml"
    brief, whole = run("identifiability", machine), run("identifiability", machine, "--all")
    assert "--json has the 1-sigma" in brief
    assert all(f"\n  leg{k}.gain " in whole for k in range(1, 7))
    assert len(whole) > len(brief)
