"""When a movement between sessions is believed, how large it is, and what it hides: against Gaussians written out in full."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from drifting_arm.arm import HOUR, SIGMA, TURN_SIGMA, machine_text, write_sequence
from numpy.typing import NDArray
from scipy import stats
from scipy.linalg import block_diag
from scipy.special import expit

from support import MACHINES
from truepose.identification.drift.analysis import drift, unseen_by_all
from truepose.identification.drift.movement_evidence import Stack, grid_for, solve, weigh
from truepose.identification.drift.movement_selection import Candidate, Selection, candidates_of, select
from truepose.identification.drift.scales import Scales
from truepose.identification.drift.sessions import Linear, linearised, sessions_of
from truepose.identification.drift.sizes import joint_parameters, movements, straight_line
from truepose.identification.fit.problem import Prior, prior_of
from truepose.identification.recording.load import load_recording
from truepose.identification.report.drift_words import drift_notes
from truepose.models.load import load_machine

Array = NDArray[np.float64]


def test_a_movement_is_believed_from_a_probability_of_095() -> None:
    """One parameter that may move, or not, as likely as each other: its log Bayes factor is its log odds."""
    rng = np.random.default_rng(1)
    rows = 30
    jacobian = rng.standard_normal((2, rows, 1))
    points, only = [Scales(1.0, (1.0,), 0.0)], Candidate("q1.d", (0,), False)
    believed: list[float] = []
    doubted: list[float] = []
    for size in np.linspace(0.0, 1.5, 61):
        apart = np.array([-size / 2, size / 2])[:, None] * jacobian[:, :, 0]
        stack = Stack(jacobian, apart, 2 * rows, np.ones(1), np.zeros(1, dtype=bool))
        gain = float(weigh(stack, [solve(stack, {}, points[0])], [(0,)]).gain[0])
        found = select(stack, [only], points)
        (believed if found.accepted else doubted).append(float(expit(gain)))
    assert max(doubted) < 0.96 and min(believed) > 0.94
    assert max(doubted) > 0.8 and min(believed) < 0.99  # near enough to the limit to tell


SESSIONS, ROWS = 4, 9
SCALE = np.array([0.5, 2.0, 10.0])
WEIGHT = np.array([1.0, 0.5, 2.0])
PRIOR = Prior(
    ("a", "fixed", "b", "c"),
    np.array([1.0, 9.0, 2.0, 3.0]),
    np.array([0.5, 0, 4, 5]),
    np.insert(SCALE, 1, 1.0),
    ("length", "length", "angle", "frame"),
)
TIMES = (100.0, 160.0, 340.0, 400.0)


def stacked(seed: int, moving: Array | None = None) -> Stack:
    """Sessions seen at random; ``moving`` (K,) is what the second parameter does, in steps."""
    rng = np.random.default_rng(seed)
    jacobian = 3.0 * rng.standard_normal((SESSIONS, ROWS, 3))
    offset = rng.standard_normal((SESSIONS, ROWS)) - jacobian @ (rng.standard_normal(3) / WEIGHT)
    if moving is not None:
        offset = offset - jacobian[:, :, 1] * moving[:, None]
    return Stack(jacobian, offset, SESSIONS * ROWS, WEIGHT, np.array([True, False, False]))


def dense(stack: Stack, point: Scales, moving: dict[int, float]) -> tuple[Array, Array]:
    """Posterior mean and covariance of all sessions' parameters (K n), by conditioning one Gaussian on the readings."""
    k, _, n = stack.jacobian.shape
    tolerance = np.where(stack.inflated, point.inflation[0], 1.0) / stack.weight
    prior = np.kron(np.ones((k, k)), np.diag(tolerance**2))
    for i, size in moving.items():
        one = np.zeros((n, n))
        one[i, i] = size**2
        prior += np.kron(np.eye(k) - 1.0 / k, one)
    seen = block_diag(*stack.jacobian)
    gain = prior @ seen.T @ np.linalg.inv(seen @ prior @ seen.T + point.noise**2 * np.eye(k * ROWS))
    mean, covariance = gain @ -stack.offset.ravel(), prior - gain @ seen @ prior
    return np.asarray(mean, dtype=np.float64), np.asarray(covariance, dtype=np.float64)


def chosen(stack: Stack, point: Scales, moving: dict[int, float], log_odds: Array) -> Selection:
    """What moves, said rather than found."""
    found = (solve(stack, moving, point),)
    return Selection(
        moving,
        2.0 * log_odds,
        log_odds,
        {i: {2: 1.5} for i in moving},
        found,
        0.0,
        np.array([False, False, True]),
    )


@pytest.mark.parametrize("point", [Scales(1.0, (1.0,), 0.0), Scales(1.7, (4.0,), 0.0)])
def test_movements_are_those_of_the_joint_gaussian(point: Scales) -> None:
    """Changes since the first session, their 1-sigma, and what would stay hidden of the others."""
    stack, moving = stacked(2, np.array([0.0, 0.6, -0.3, 1.0])), {1: 0.8}
    found = chosen(stack, point, moving, np.array([-4.0, 6.0, 0.5]))
    mean, covariance = dense(stack, point, moving)
    every = PRIOR.mean + np.zeros((SESSIONS, 4))
    every[:, PRIOR.free] += SCALE * mean.reshape(SESSIONS, 3)
    np.testing.assert_allclose(joint_parameters(stack, found, PRIOR), every, atol=1e-8)

    still, own, other = movements(stack, found, PRIOR, {"a": "mm", "b": "rad", "c": "mm"}, TIMES)
    since = np.kron(np.eye(SESSIONS) - np.eye(SESSIONS)[0], np.eye(3)[1]) * SCALE[1]
    np.testing.assert_allclose(own.change, since @ mean, atol=1e-8)
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
        _, wide = dense(stack, point, {**moving, place: 30.0})
        apart = np.zeros(3 * SESSIONS)
        apart[place], apart[place - 3] = -SCALE[place], SCALE[place]
        assert movement.hidden == pytest.approx(float(np.sqrt(apart @ wide @ apart)), rel=1e-3)
        assert movement.change == () and movement.rate is None
    assert [m.status for m in (still, own, other)] == ["still", "moved", "perhaps"]
    assert [m.name for m in (still, own, other)] == ["a", "b", "c"] and own.alike == {"c": 1.5}
    assert [m.unit for m in (still, own, other)] == ["mm", "rad", "mm"]
    assert [m.extrinsic for m in (still, own, other)] == [False, False, True]
    np.testing.assert_allclose([still.probability, own.probability], expit([-4.0, 6.0]))


def test_of_two_movements_each_has_its_own_change_and_spread() -> None:
    stack, moving, point = (
        stacked(2, np.array([0.0, 0.6, -0.3, 1.0])),
        {2: 1.5, 1: 0.8},
        Scales(1.0, (1.0,), 0.0),
    )
    found = chosen(stack, point, moving, np.array([-4.0, 6.0, 6.0]))
    mean, covariance = dense(stack, point, moving)
    _, *both = movements(stack, found, PRIOR, {"a": "mm", "b": "rad", "c": "mm"}, TIMES)
    for place, own in enumerate(both, start=1):
        since = np.kron(np.eye(SESSIONS) - np.eye(SESSIONS)[0], np.eye(3)[place]) * SCALE[place]
        np.testing.assert_allclose(own.change, since @ mean, atol=1e-8)
        spread = np.diag(since @ covariance @ since.T).clip(0.0)
        np.testing.assert_allclose(own.std, np.sqrt(spread), atol=1e-7)


def test_a_steady_movement_has_its_rate_and_an_unsteady_one_says_so() -> None:
    point, units = Scales(0.05, (1.0,), 0.0), {"a": "mm", "b": "rad", "c": "mm"}
    for way, steady in (((0.0, 0.6, 2.4, 3.0), True), ((0.0, 3.0, 0.0, 3.0), False)):
        stack = stacked(3, np.array(way))
        quiet = Stack(stack.jacobian, stack.offset, stack.n_observations, WEIGHT, stack.inflated)
        found = chosen(quiet, Scales(1.0, (1.0,), 0.0), {1: 3.0}, np.array([-4.0, 6.0, -4.0]))
        _, own, _ = movements(quiet, found, PRIOR, units, TIMES)
        assert own.steady is steady and own.rate is not None and own.rate_std is not None
        if steady:
            assert abs(own.rate - SCALE[1] * 0.01) < 4.0 * own.rate_std
        (_, unclocked, _) = movements(quiet, found, PRIOR, units, None)
        assert unclocked.rate is not None and unclocked.change == own.change
    two = Stack(stack.jacobian[:2], stack.offset[:2], 2 * ROWS, WEIGHT, stack.inflated)
    found = chosen(two, point, {1: 3.0}, np.array([-4.0, 6.0, -4.0]))
    _, line, _ = movements(two, found, PRIOR, units, (0.0, 50.0))
    assert line.steady and line.rate == pytest.approx(line.change[1] / 50.0)
    assert line.rate_std == pytest.approx(line.std[1] / 50.0)


@pytest.mark.parametrize(("time", "length"), [(1.0, 1.0), (1e-6, 1.0), (1.0, 1e6), (1e5, 1e-7)])
def test_a_rate_has_the_unit_of_its_change_over_that_of_its_time(time: float, length: float) -> None:
    rng = np.random.default_rng(13)
    elapsed, change = np.array([0.0, 60.0, 240.0, 300.0]), np.array([0.0, 1.0, 3.0, 9.0])
    root = np.vstack([np.zeros(3), rng.standard_normal((3, 3))])
    for sessions in (4, 2):
        plain = straight_line(elapsed[:sessions], change[:sessions], root[:sessions])
        other = straight_line(time * elapsed[:sessions], length * change[:sessions], length * root[:sessions])
        assert plain is not None and other is not None
        assert other == pytest.approx(
            (plain[0] * length / time, plain[1] * length / time, plain[2]), rel=1e-9
        )
        assert (plain[2] == 1.0) is (sessions == 2)  # a line through two points always fits
    assert straight_line(0.0 * elapsed, change, root) is None  # no time passed


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
        stack = Stack(blind, np.zeros((3, n + 1)), 3 * n, np.ones(n), np.zeros(n, dtype=bool))
        (own,) = unseen_by_all(machine, stack, prior, np.tile(prior.mean, (3, 1))).directions
        assert set(own.parts) == {prior.names[prior.free[4]]}


def test_what_no_session_sees_is_unseen_and_what_a_movement_hides_is_masked() -> None:
    stack = stacked(4)
    blind = stack.jacobian.copy()
    blind[:, :, 0] = 0.0
    blind[:, :, 2] = blind[:, :, 1] * (
        1.0 + 1e-4 * np.random.default_rng(5).standard_normal((SESSIONS, ROWS))
    )
    hard = Stack(blind, stack.offset, stack.n_observations, np.array([1.0, 1e-3, 1e-3]), stack.inflated)
    found = chosen(hard, Scales(1.0, (1.0,), 0.0), {1: 100.0}, np.array([-4.0, 6.0, -4.0]))
    unseen, moved, masked = movements(hard, found, PRIOR, {"a": "mm", "b": "rad", "c": "mm"}, None)
    assert (unseen.status, moved.status, masked.status) == ("unseen", "moved", "masked")
    assert np.isinf(unseen.hidden)


def test_frames_and_sensors_may_move_as_a_whole(tmp_path: Path) -> None:
    """Groups of more than one free parameter, all of them together where there are several, and each one alone."""
    (tmp_path / "arm.yaml").write_text(machine_text(), encoding="utf-8")
    machine = load_machine(tmp_path / "arm.yaml")
    prior = prior_of(machine)
    names = [prior.names[k] for k in prior.free]
    found = {c.name: c for c in candidates_of(machine, prior)}
    frames = [k for k, name in enumerate(names) if name.split(".")[0] in ("base", "tool")]
    assert {"base", "tool", "frames and sensors", *names} == set(found)
    assert found["frames and sensors"].members == tuple(frames)
    for name, one in found.items():
        own = [k for k, other in enumerate(names) if other == name or other.startswith(f"{name}.")]
        assert one.extrinsic is (name == "frames and sensors" or own[0] in frames)
        assert name == "frames and sensors" or one.members == tuple(own)
    # a frame of one parameter is no group, and one frame needs no name for all
    outside = np.array([name.split(".")[0] in ("base", "tool") for name in prior.names])
    kept = np.isin(prior.names, ("tool.x", "base.x", "base.y"))
    single = prior.with_sigma(np.where(outside & ~kept, 0.0, prior.sigma))
    some = {c.name: c.members for c in candidates_of(machine, single)}
    assert {name for name in some if "." not in name} == {"base", "frames and sensors"}
    alone = prior.with_sigma(
        np.where(outside & ~np.isin(prior.names, ("base.x", "base.y")), 0.0, prior.sigma)
    )
    assert {c.name for c in candidates_of(machine, alone) if "." not in c.name} == {"base"}


@pytest.mark.parametrize("rms", [0.5, 1.0, 8.0])
def test_the_grid_holds_the_stated_noise_and_what_is_left_when_nothing_moves(rms: float) -> None:
    stack = stacked(6)
    still = solve(stack, {}, Scales(1.0, (1.0,), 0.0)).residual
    stack = replace(stack, offset=stack.offset * rms * np.sqrt(stack.n_observations) / np.linalg.norm(still))
    points = grid_for(stack).points
    noise = sorted({p.noise for p in points})
    assert noise[:2] == [0.8, 1.0] and noise[-1] == pytest.approx(max(1.7, 1.2 * rms))
    assert max(np.diff(np.log(noise))) < 0.5  # no scale is farther than a quarter in the log from one of them
    assert {p.inflation for p in points} == {(1.0,), (2.0,), (4.0,)}
    rigid = replace(stack, inflated=np.zeros(3, dtype=bool))
    assert {p.inflation for p in grid_for(rigid).points} == {(1.0,)}
    at = {(p.noise, *p.inflation): p.log_prior for p in points}
    assert at[1.0, 1.0] > at[1.0, 2.0] > at[1.0, 4.0] and at[1.0, 1.0] > at[0.8, 1.0] > at[noise[-1], 1.0]


def test_frames_go_first_where_they_explain_as_much() -> None:
    """A part and a frame that show alike: the frame is named, and the part beside it as alike."""
    rng = np.random.default_rng(7)
    jacobian = rng.standard_normal((2, 20, 2))
    jacobian[:, :, 1] = jacobian[:, :, 0] * (1.0 + 1e-3 * rng.standard_normal((2, 20)))
    apart = np.array([-1.0, 1.0])[:, None] * 4.0 * jacobian[:, :, 0]
    stack = Stack(jacobian, apart, 40, np.ones(2), np.zeros(2, dtype=bool))
    points = [Scales(1.0, (1.0,), 0.0)]
    for frame in (0, 1):
        both = [Candidate(f"p{k}", (k,), k == frame) for k in (0, 1)]
        found = select(stack, both, points)
        assert set(found.accepted) == {frame}
        assert found.alike[frame].keys() == {1 - frame} and abs(found.alike[frame][1 - frame]) < 3.0
        assert found.extrinsic.tolist() == [k == frame for k in (0, 1)]
        assert found.noise == pytest.approx(1.0) and found.log_bayes_factor > 3.0


def test_alike_is_what_would_be_believed_in_its_place_with_odds_that_are_not_hopeless() -> None:
    """Log odds of 3 for a movement of its own, and no more than 12 against it."""
    rng, rows = np.random.default_rng(15), 40
    jacobian = rng.standard_normal((2, rows, 5))
    moving = jacobian[:, :, 2]
    for k, share in ((1, 0.1), (3, 0.35), (4, 1.0)):  # nearly the same, less so, hardly
        jacobian[:, :, k] = moving + share * jacobian[:, :, k]
    apart = np.array([-0.5, 0.5])[:, None] * 2.2 * moving
    stack = Stack(jacobian, apart, 2 * rows, np.ones(5), np.zeros(5, dtype=bool))
    points = [Scales(1.0, (1.0,), 0.0)]
    found = select(stack, [Candidate(f"p{k}", (k,), k in (0, 4)) for k in range(5)], points)
    assert set(found.accepted) == {2}
    alone = weigh(stack, [solve(stack, {}, points[0])], [(k,) for k in range(5)]).gain
    against = {k: alone[2] - alone[k] for k in (0, 1, 3, 4) if alone[k] > 3.0 and alone[2] - alone[k] < 12.0}
    assert found.alike[2] == pytest.approx(against)
    assert list(found.alike[2]) == sorted(against, key=lambda k: against[k])
    assert set(against) == {1, 3} and alone[4] > 3.0 > alone[0]


def test_a_reading_that_counts_from_itself_is_none(tmp_path: Path) -> None:
    """The noise is judged by readings that can err: the first of each session counts from itself, and reads 0."""
    n = 24
    rows = pd.DataFrame(np.random.default_rng(8).uniform(-3.0, 3.0, (n, 3)), columns=["x", "y", "t"])
    origin = np.where(np.arange(n) % (n // 2) == 0, np.arange(n), np.arange(n) - 1)
    rows = rows.assign(pose=np.arange(n), **{"from": origin}, session=np.arange(n) // (n // 2))
    rows.assign(dL=np.where(origin == np.arange(n), 0.0, 1e-3)).to_csv(tmp_path / "rows.csv", index=False)
    machine = load_machine(MACHINES / "distance.yaml")
    sessions, notes = sessions_of(machine, load_recording(machine, [tmp_path / "rows.csv"]))
    prior = prior_of(machine)
    assert not notes
    assert [linearised(s, prior, prior.mean).n_observations for s in sessions] == [n // 2 - 1] * 2


def test_what_no_session_sees_says_nothing_and_adds_nothing_to_what_moves_with_it() -> None:
    """One session is enough to see a parameter; a column at rounding beside the others' is none."""
    plain = stacked(16, np.array([0.0, 2.0, -1.0, 1.0]))
    jacobian = plain.jacobian.copy()
    jacobian[1:, :, 0] = 0.0
    jacobian[:, :, 2] *= 1e-18
    stack = replace(plain, jacobian=jacobian)
    assert stack.visible.tolist() == [True, True, False]
    states = [solve(stack, {}, Scales(1.0, (1.0,), 0.0))]
    found = weigh(stack, states, [(2,), (1,), (1, 2), (0, 1, 2), (0, 1)])
    assert (found.gain[0], found.size[0]) == (0.0, 0.0)
    assert found.gain[1] > 3.0 and found.gain[2] == pytest.approx(found.gain[1])
    assert found.gain[3] == pytest.approx(found.gain[4]) and found.size[3] == found.size[4]


def test_tolerances_of_parts_may_be_wrong_and_what_has_none_decides_nothing() -> None:
    """Lengths and angles of the mechanism have doubtful tolerances; frames', and infinite ones, are what they are."""
    prior = Prior(
        ("a", "b", "c", "d", "fixed"),
        np.zeros(5),
        np.array([0.5, np.inf, 4.0, 0.1, 0.0]),
        np.array([1.0, 1.0, 2.0, 1.0, 1.0]),
        ("length", "length", "frame", "angle", "length"),
    )
    rng = np.random.default_rng(9)
    seen = [Linear(rng.standard_normal((5, 4)), rng.standard_normal(5), count) for count in (7, 11)]
    stack = Stack.of(seen, prior)
    assert stack.inflated.tolist() == [True, False, False, True]
    np.testing.assert_allclose(stack.weight[[0, 2, 3]], [2.0, 0.5, 10.0])
    assert 0.0 < stack.weight[1] < 1e-3
    assert stack.n_observations == 18
    np.testing.assert_array_equal(stack.jacobian[1], seen[1].jacobian)
    np.testing.assert_allclose(stack.contrasts.T @ stack.contrasts, np.eye(1), atol=1e-12)
    np.testing.assert_allclose(stack.contrasts.sum(axis=0), 0.0, atol=1e-12)
    known, unknown = stack.sizes([0]), stack.sizes([0, 1])
    for sizes, log in (known, unknown):
        assert np.sum(np.exp(log)) == pytest.approx(1.0) and np.all(np.diff(sizes) > 0.0)
    # movements beyond a tenth of a tolerance are rarer as they are larger; of what has none, all are alike
    assert known[1][0] - known[1][-1] == pytest.approx(np.log(known[0][-1] / 0.1), rel=1e-3)
    assert np.ptp(unknown[1]) < 1e-12


def test_checks_of_an_older_calibration_do_not_hang_on_the_stated_sigma(tmp_path: Path) -> None:
    """Readings tell the noise: with a quarter of the true sigma stated, all is four times as far off, and nothing changes."""
    moves = {"tool.x": [0.0, 0.05], "q4.d": [0.0, 0.02]}
    path, files = write_sequence(tmp_path, 91, moves, sessions=2, every=HOUR, n=20)
    checks = []
    for share in (1.0, 0.25):
        stated = f"xyz: {SIGMA!r}, rot: {TURN_SIGMA}"
        text = machine_text()
        assert stated in text
        path.write_text(
            text.replace(stated, f"xyz: {share * SIGMA}, rot: {share * TURN_SIGMA}"), encoding="utf-8"
        )
        machine = load_machine(path)
        whole = drift(machine, load_recording(machine, files))
        assert ("times the stated noise" in " ".join(drift_notes(whole))) is (share < 0.5)
        found = whole.durability
        assert found.noise == pytest.approx(1.0 / share, rel=0.2)
        checks.append((found.carried[0], found.frames[0], found.full[0]))
    for right, wrong in zip(*checks, strict=True):
        assert right is not None and wrong is not None
        assert right.holds is wrong.holds
        assert wrong.p == pytest.approx(right.p, rel=0.2, abs=1e-3)
        for kind in ("position", "rotation"):
            assert wrong.rms[kind] == pytest.approx(right.rms[kind], rel=0.05)
            assert wrong.expected[kind] == pytest.approx(right.expected[kind], rel=0.1)
    carried, frames, full = checks[0]
    assert carried is not None and frames is not None
    # what is fitted anew can only come nearer, and expects no less than all fitted anew leaves
    assert carried.rms["position"] > frames.rms["position"] >= 0.99 * full.rms["position"]
    assert carried.p < frames.p
