"""Which movements between sessions are believed, how large they are and what they hide: against Gaussians and all sets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import block_diag
from scipy.special import softmax
from scipy.stats import multivariate_normal

from support import MACHINES
from support.stacked_sessions import (
    CLASSES,
    KINDS,
    PRIOR,
    ROWS,
    SCALE,
    SESSIONS,
    SIGMA_STEPS,
    TIMES,
    UNITS,
    covariance_of,
    dense,
    distance_rows,
    likeliest_of,
    plain,
    said,
    stacked,
)
from truepose.identification.fit.problem import prior_of
from truepose.identification.leaves.drift.analysis import unseen_by_all
from truepose.identification.leaves.drift.movement_problem import Kinds, Stack, movement_problem
from truepose.identification.leaves.drift.movements import likeliest, movement_posterior
from truepose.identification.leaves.drift.sessions import linearised, sessions_of
from truepose.identification.leaves.drift.sizes import joint_parameters, movements, straight_line
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.posterior import sample
from truepose.identification.posterior.spike_slab import Members
from truepose.identification.posterior.state import LOUDER, log_posterior
from truepose.identification.prior import RICHNESS
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine


@pytest.mark.parametrize(("noise", "widening"), [(1.0, 0), (1.7, 2)])
def test_movements_are_those_of_the_joint_gaussian(noise: float, widening: int) -> None:
    """Changes since the first session, their 1-sigma, and what would stay hidden of the others."""
    stack = stacked(2, np.array([0.0, 0.6, -0.3, 1.0]))
    top = likeliest_of(stack, {1: 3.0}, noise, widening)
    mean, covariance = dense(top)
    every = PRIOR.mean + np.zeros((SESSIONS, 4))
    every[:, PRIOR.free] += SCALE * mean.reshape(SESSIONS, 3)
    np.testing.assert_allclose(joint_parameters(top, PRIOR), every, atol=1e-7)

    still, own, other = movements(said(top, (0.02, 0.99, 0.6)), PRIOR, UNITS, TIMES)
    since = np.kron(np.eye(SESSIONS) - np.eye(SESSIONS)[0], np.eye(3)[1]) * SCALE[1]
    np.testing.assert_allclose(own.change, since @ mean, atol=1e-7)
    spread = since @ covariance @ since.T
    np.testing.assert_allclose(own.std, np.sqrt(np.diag(spread).clip(0.0)), atol=1e-7)
    elapsed, inverse = np.array(TIMES[1:]) - TIMES[0], np.linalg.inv(spread[1:, 1:])
    rate = elapsed @ inverse @ (since @ mean)[1:] / (elapsed @ inverse @ elapsed)
    off = (since @ mean)[1:] - rate * elapsed
    chi2 = float(off @ inverse @ off)
    assert own.rate == pytest.approx(rate)
    widened = max(1.0, np.sqrt(chi2 / 2.0))  # three changes less one rate
    assert own.rate_std == pytest.approx(widened * (elapsed @ inverse @ elapsed) ** -0.5)
    assert own.steady is bool(stats.chi2.sf(chi2, 2) > 0.01)
    for place, movement in ((0, still), (2, other)):
        # a movement of any size: what the readings alone say of it
        _, wide = dense(likeliest_of(stack, {1: 3.0, place: 100.0}, noise, widening))
        apart = np.zeros(3 * SESSIONS)
        apart[place], apart[place - 3] = -SCALE[place], SCALE[place]
        assert movement.hidden == pytest.approx(float(np.sqrt(apart @ wide @ apart)), rel=1e-2)
        assert movement.change == () and movement.rate is None
    assert [m.status for m in (still, own, other)] == ["still", "moved", "perhaps"]
    assert [m.name for m in (still, own, other)] == ["a", "b", "c"] and own.alike == {"c": 1.5}
    assert [m.unit for m in (still, own, other)] == ["mm", "rad", "mm"]
    assert [m.extrinsic for m in (still, own, other)] == [False, False, True]
    assert [m.probability for m in (still, own, other)] == [0.02, 0.99, 0.6]


def test_a_movement_is_believed_from_a_probability_of_095() -> None:
    """Of itself, or of itself and the few that stand in for it."""
    top = likeliest_of(stacked(2), {1: 3.0})
    for own, together, status in ((0.94, 0.94, "perhaps"), (0.96, 0.96, "moved"), (0.6, 0.97, "moved")):
        found = replace(said(top, (0.1, own, 0.1)), together=np.array([0.1, together, 0.1]))
        assert movements(found, PRIOR, UNITS, TIMES)[1].status == status


@pytest.mark.parametrize(("time", "length"), [(1.0, 1.0), (1e-6, 1.0), (1.0, 1e6), (1e5, 1e-7)])
def test_a_rate_has_the_unit_of_its_change_over_that_of_its_time(time: float, length: float) -> None:
    rng = np.random.default_rng(13)
    elapsed, change = np.array([0.0, 60.0, 240.0, 300.0]), np.array([0.0, 1.0, 3.0, 9.0])
    root = np.vstack([np.zeros(3), rng.standard_normal((3, 3))])
    for sessions in (4, 2):
        spread = (root @ root.T)[:sessions, :sessions]
        one = straight_line(elapsed[:sessions], change[:sessions], spread)
        other = straight_line(time * elapsed[:sessions], length * change[:sessions], length**2 * spread)
        assert one is not None and other is not None
        assert other == pytest.approx((one[0] * length / time, one[1] * length / time, one[2]), rel=1e-9)
        assert (one[2] == 1.0) is (sessions == 2)  # a line through two points always fits
    assert straight_line(0.0 * elapsed, change, root @ root.T) is None  # no time passed


def test_unseen_is_what_the_session_that_sees_most_does_not_see() -> None:
    machine = load_machine(MACHINES / "distance.yaml")
    prior = prior_of(machine)
    n = len(prior.free)
    jacobian = np.random.default_rng(14).standard_normal((3, n + 1, n))
    jacobian[:, :, 4] = 0.0
    for best in range(3):
        blind = jacobian.copy()
        blind[np.arange(3) != best, :, 7] = 0.0
        blind[(best + 1) % 3, :, 9] = 0.0
        stack = plain(blind, np.zeros((3, n + 1)))
        (own,) = unseen_by_all(machine, stack, prior, np.tile(prior.mean, (3, 1))).directions
        assert set(own.parts) == {prior.names[prior.free[4]]}


def test_what_no_session_sees_is_unseen_and_what_a_movement_hides_is_masked() -> None:
    stack = stacked(4)
    blind = stack.jacobian.copy()
    blind[:, :, 0] = 0.0
    blind[:, :, 2] = blind[:, :, 1] * (
        1.0 + 1e-4 * np.random.default_rng(5).standard_normal((SESSIONS, ROWS))
    )
    hard = Stack(blind, stack.offset, stack.n_observations, np.array([1.0, 1e3, 1e3]), CLASSES)
    found = said(likeliest_of(hard, {1: 1.0}), (0.02, 0.99, 0.02))
    unseen, moved, masked = movements(found, PRIOR, UNITS, None)
    assert (unseen.status, moved.status, masked.status) == ("unseen", "moved", "masked")
    assert np.isinf(unseen.hidden)


@pytest.mark.parametrize(("unseen", "hidden"), [((1, 2), False), ((2, 3), True), ((0, 1), True)])
def test_a_movement_is_hidden_where_first_or_last_cannot_be_told(
    unseen: tuple[int, ...], hidden: bool
) -> None:
    """What sessions between do not see of a parameter hides nothing of its way from the first to the last."""
    stack = stacked(5, np.arange(SESSIONS, dtype=float))
    jacobian = stack.jacobian.copy()
    jacobian[list(unseen), :, 0] = 0.0
    top = likeliest_of(replace(stack, jacobian=jacobian), {1: 10.0})
    still, moved, _ = movements(said(top, (0.05, 0.99, 0.05)), PRIOR, UNITS, None)
    assert bool(np.isinf(still.hidden)) is hidden
    assert still.status == ("unseen" if hidden else "still")
    assert moved.status == "moved" and moved.hidden == 0.0
    if not hidden:
        assert 0.05 < still.hidden < 1.0  # of its step of half a mm


def test_a_reading_that_counts_from_itself_is_none(tmp_path: Path) -> None:
    """The noise is judged by readings that can err: the first of each session counts from itself, and reads 0."""
    n = 24
    rows, origin = distance_rows(n, 2, np.random.default_rng(8))
    rows.assign(dL=np.where(origin == np.arange(n), 0.0, 1e-3)).to_csv(tmp_path / "rows.csv", index=False)
    machine = load_machine(MACHINES / "distance.yaml")
    sessions, notes = sessions_of(machine, load_recording(machine, [tmp_path / "rows.csv"]))
    prior = prior_of(machine)
    assert not notes
    assert [linearised(s, prior, prior.mean).n_observations for s in sessions] == [n // 2 - 1] * 2


def test_a_session_of_validation_rows_alone_is_left_out_and_said(tmp_path: Path) -> None:
    rows, _ = distance_rows(24, 3, np.random.default_rng(9))
    role = np.where(rows["session"] == 1, "validation", "calibration")
    rows.assign(dL=1e-3, role=role).to_csv(tmp_path / "rows.csv", index=False)
    machine = load_machine(MACHINES / "distance.yaml")
    sessions, notes = sessions_of(machine, load_recording(machine, [tmp_path / "rows.csv"]))
    assert [one.label for one in sessions] == ["session 0", "session 2"]
    assert [(note.kind, note.about) for note in notes] == [("validation", "session 1")]


def test_evidence_is_that_of_the_dense_gaussian() -> None:
    """Of sets of movements at sizes, at any noise and widening of tolerances, against covariances written out in full."""
    stack, ours, theirs = stacked(81), list[float](), list[float]()
    for moving in ({}, {1: 0.3}, {0: 3.0}, {0: 0.1, 2: 10.0}, {0: 1.0, 1: 30.0, 2: 0.01}):
        for noise, widening in ((0.8, 0), (2.0, 1), (1.0, 3)):
            top = likeliest_of(stack, moving, noise, widening)
            seen, point = block_diag(*stack.jacobian), top.state.point
            cov = seen @ covariance_of(top) @ seen.T + top.noise**2 * np.eye(len(seen))
            ours.append(top.spike_slab.log_evidence(point, top.state.members))
            theirs.append(
                float(multivariate_normal.logpdf(stack.offset.ravel(), cov=cov))
                + top.spike_slab.unknowns.log_prior(point)
            )
    # evidence is known up to a constant
    np.testing.assert_allclose(np.diff(ours), np.diff(theirs), atol=1e-7)


def test_probabilities_are_those_of_all_sets_at_all_sizes_and_points() -> None:
    """Two parameters, one of which moves by about what can be seen: sampled against enumerated."""
    rng = np.random.default_rng(1)
    jacobian = rng.standard_normal((2, 40, 2))
    kinds = Kinds(("a", "c"), np.array([False, True]))
    undecided = 0
    for size in (1.0, 1.1, 1.15):
        apart = np.array([-size / 2, size / 2])[:, None] * jacobian[:, :, 0]
        stack = plain(jacobian, apart + rng.standard_normal((2, 40)), 3.0)
        top = likeliest(stack, kinds)
        problem = top.spike_slab
        found = [sample(problem, RICHNESS, seed=seed, known=[top.state]).causes for seed in range(1, 5)]
        points = [
            GridPoint((k,), w)
            for k in range(len(problem.unknowns.noise[0].values))
            for w in range(len(problem.unknowns.widening))
        ]
        sizes = range(len(problem.sizes.values))
        ones = [((i, s),) for i in (0, 1) for s in sizes]
        sets: list[Members] = [(), *ones, *(((0, s), (1, t)) for s in sizes for t in sizes)]
        logs = [np.logaddexp.reduce([log_posterior(problem, RICHNESS, m, p) for p in points]) for m in sets]
        share = softmax(logs)
        own = [sum(p for p, m in zip(share, sets, strict=True) if i in dict(m)) for i in (0, 1)]
        np.testing.assert_allclose(np.mean(found, axis=0), own, atol=0.06)  # chains end as soon as two agree
        undecided += any(0.1 < p < 0.9 for p in own)
    assert undecided


def test_alike_is_what_would_be_believed_in_its_place_with_odds_that_are_not_hopeless() -> None:
    """Log odds of 3 for a movement of its own, and no more than 12 against it."""
    rng, rows = np.random.default_rng(15), 40
    jacobian = rng.standard_normal((2, rows, 5))
    moving = jacobian[:, :, 2]
    for k, share in ((1, 0.1), (3, 0.4), (4, 1.2)):  # nearly the same, less so, hardly
        jacobian[:, :, k] = moving + share * jacobian[:, :, k]
    apart = np.array([-0.5, 0.5])[:, None] * 2.6 * moving + rng.standard_normal((2, rows))
    stack = plain(jacobian, apart, 5.0)
    kinds = Kinds(tuple(f"p{k}" for k in range(5)), np.arange(5) == 2)
    found = movement_posterior(likeliest(stack, kinds), kinds)
    assert found.likeliest.moved == (2,)
    problem, centre = found.likeliest.spike_slab, found.likeliest.state.point
    points = [p for step in LOUDER if problem.unknowns.holds(p := centre.louder(step))]
    with_size = list(enumerate(problem.sizes.log_prior.tolist()))

    def gain(k: int) -> float:
        there = [problem.log_evidence(p, [(k, s)]) + log for p in points for s, log in with_size]
        return float(
            np.logaddexp.reduce(there) - np.logaddexp.reduce([problem.log_evidence(p, []) for p in points])
        )

    alone = [gain(k) for k in range(5)]
    against = {k: alone[2] - alone[k] for k in (0, 1, 3, 4) if alone[k] > 3.0 and alone[2] - alone[k] < 12.0}
    assert found.alike[2] == pytest.approx(against)
    assert list(found.alike[2]) == sorted(against, key=lambda k: against[k])
    assert set(against) == {1, 3} and alone[4] > 3.0 > alone[0]
    assert found.gain[2] == pytest.approx(alone[2])


@pytest.mark.parametrize("rms", [0.5, 1.0, 8.0])
def test_the_grid_holds_the_stated_noise_and_what_is_left_when_nothing_moves(rms: float) -> None:
    stack = stacked(6)
    whole = np.vstack([stack.jacobian.reshape(-1, 3), np.diag(1.0 / SIGMA_STEPS)])
    right = np.append(stack.offset.ravel(), np.zeros(3))
    still = right - whole @ np.linalg.lstsq(whole, right)[0]
    scaled = replace(stack, offset=stack.offset * rms * np.sqrt(stack.n_observations) / np.linalg.norm(still))
    unknowns = movement_problem(scaled, KINDS).unknowns
    noise = np.log(unknowns.noise[0].values)
    assert np.min(np.abs(noise)) < 0.05 and noise[0] < -0.4 and noise[-1] > np.log(max(2.0, 1.3 * rms))
    np.testing.assert_allclose(np.diff(noise), 0.1)
    assert unknowns.widening[0] == (1.0,) * 3


def test_of_two_movements_each_has_its_own_change_and_spread() -> None:
    top = likeliest_of(stacked(2, np.array([0.0, 0.6, -0.3, 1.0])), {2: 30.0, 1: 3.0})
    mean, covariance = dense(top)
    _, *both = movements(said(top, (0.02, 0.99, 0.99)), PRIOR, UNITS, TIMES)
    for place, own in enumerate(both, start=1):
        since = np.kron(np.eye(SESSIONS) - np.eye(SESSIONS)[0], np.eye(3)[place]) * SCALE[place]
        np.testing.assert_allclose(own.change, since @ mean, atol=1e-7)
        spread = np.diag(since @ covariance @ since.T).clip(0.0)
        np.testing.assert_allclose(own.std, np.sqrt(spread), atol=1e-7)


def test_a_steady_movement_has_its_rate_and_an_unsteady_one_says_so() -> None:
    for way, steady in (((0.0, 0.6, 2.4, 3.0), True), ((0.0, 3.0, 0.0, 3.0), False)):
        stack = stacked(3, np.array(way))
        found = said(likeliest_of(stack, {1: 10.0}), (0.02, 0.99, 0.02))
        _, own, _ = movements(found, PRIOR, UNITS, TIMES)
        assert own.steady is steady and own.rate is not None and own.rate_std is not None
        if steady:
            assert abs(own.rate - SCALE[1] * 0.01) < 4.0 * own.rate_std
        (_, unclocked, _) = movements(found, PRIOR, UNITS, None)
        assert unclocked.rate is not None and unclocked.change == own.change
    two = Stack(stack.jacobian[:2], stack.offset[:2], 2 * ROWS, SIGMA_STEPS, CLASSES)
    found = said(likeliest_of(two, {1: 10.0}), (0.02, 0.99, 0.02))
    _, line, _ = movements(found, PRIOR, UNITS, (0.0, 50.0))
    assert line.steady and line.rate == pytest.approx(line.change[1] / 50.0)
    assert line.rate_std == pytest.approx(line.std[1] / 50.0)
