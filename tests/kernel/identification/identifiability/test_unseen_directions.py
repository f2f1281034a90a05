"""Directions that no reading sees, in words, and independent sets of parameters."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support import MACHINES, TESTS
from support.reports import said_of
from support.short_arm import POSITION, arm, status
from truepose.api import calibrate
from truepose.identification.fit.decomposition import Decomposition
from truepose.identification.identifiability.analysis import drawn_poses, identifiability
from truepose.identification.identifiability.observability import (
    Direction,
    Knowledge,
    identifiable,
    nearly_unseen,
    unseen,
)
from truepose.identification.prediction.predictor import Predictor
from truepose.models.load import load_machine


def parts(direction: Direction) -> dict[str, float]:
    return dict(direction.parts)


# -- rank and words ------------------------------------------------------------------------------------


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
    said = " ".join(said_of(found))
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
    assert "hardly seen on a machine as built" in " ".join(said_of(found))
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


# -- independent sets ----------------------------------------------------------------------------------


# -- nothing hangs on rounding ---------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_a_basis_that_is_turned_gives_the_same_directions(seed: int, tmp_path: Path) -> None:
    """Another processor's decomposition has another basis of what is not seen."""
    rng = np.random.default_rng(seed)
    known = identifiability(arm(tmp_path, "q1.r: 0.2", "q1.theta: 0.1", "q4.r: 0.2", "q4.theta: 0.1")).known
    rows = known.decomposition.null_space
    turn, _ = np.linalg.qr(rng.standard_normal((len(rows), len(rows))))
    plain, turned = unseen(known, rows), unseen(known, turn @ rows)
    assert len(plain) == len(rows) and [list(d.parts) for d in plain] == [list(d.parts) for d in turned]
    for one, other in zip(plain, turned, strict=True):
        np.testing.assert_allclose(list(one.parts.values()), list(other.parts.values()), rtol=1e-7)
    assert [len(d.parts) for d in plain] == sorted(len(d.parts) for d in plain)


def test_what_is_identifiable_has_the_sigma_of_the_readings_without_tolerances_too() -> None:
    """Axes that are parallel but for 1e-4 rad let unknown directions move others by a millionth: no 1-sigma of 1e4 rad."""
    folder = TESTS / "golden_diagnoses" / "arm-quiet"
    machine = load_machine(folder / "machine.yaml")
    fits = {e: calibrate(machine, [folder / "recording.csv"], estimator=e).fit for e in ("map", "ols")}
    free = fits["ols"].prior.free
    seen = identifiable(fits["ols"])
    flags = np.array([seen[fits["ols"].prior.names[k]] for k in free])
    std, tolerance = fits["ols"].std[free], fits["map"].prior.sigma[free]
    assert flags.sum() >= 5 and not flags.all()
    assert np.all(std[flags] < tolerance[flags])  # which the readings beat
    assert np.all(std[~flags] > 1e6 * fits["ols"].prior.scale[free][~flags])
    held = flags & np.isfinite(tolerance)
    # tolerances only add; each fit has found its own noise
    assert np.all(fits["map"].std[free][held] <= 1.05 * std[held])


@pytest.mark.parametrize("kind", ["serial", "ups", "pus", "distance"])
def test_the_set_of_a_machine_has_its_rank(kind: str) -> None:
    found = identifiability(load_machine(MACHINES / f"{kind}.yaml"))
    assert len(found.subset.kept) == found.rank_at_drawing
    assert not set(found.subset.kept) & set(found.subset.relations)
    assert set(found.subset.kept) | set(found.subset.relations) == set(found.known.names)
    assert identifiability(load_machine(MACHINES / f"{kind}.yaml")).subset == found.subset
