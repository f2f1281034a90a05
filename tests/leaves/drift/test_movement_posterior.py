"""Which movements are believed: evidence against dense Gaussians, probabilities against enumeration, and their prior."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.special import expit, softmax
from scipy.stats import multivariate_normal

from support.drifting_arm import machine_text
from support.stacked_sessions import KINDS, SIGMA_STEPS, covariance_of, likeliest_of, plain, stacked
from truepose.identification.fit.problem import Prior, prior_of
from truepose.identification.leaves.drift.sessions import (
    Kinds,
    Linear,
    Stack,
    likeliest,
    movement_posterior,
    movement_problem,
)
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.posterior import sample
from truepose.identification.posterior.spike_slab import Members
from truepose.identification.posterior.state import LOUDER, log_posterior, slot_odds
from truepose.identification.prior import RICHNESS
from truepose.models.load import load_machine


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
    np.testing.assert_allclose(
        np.diff(ours), np.diff(theirs), atol=1e-7
    )  # evidence is known up to a constant


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
            GridPoint((k,), w, 0)
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


def test_frames_are_kinds_and_so_are_like_parts(tmp_path: Path) -> None:
    """What is set up or wears together is drawn from one urn; frames and sensors hold most of the prior."""
    (tmp_path / "arm.yaml").write_text(machine_text(), encoding="utf-8")
    machine = load_machine(tmp_path / "arm.yaml")
    prior = prior_of(machine)
    names = [prior.names[k] for k in prior.free]
    kinds = Kinds.of(machine, prior)
    frames = [name.split(".")[0] in ("base", "tool") for name in names]
    assert kinds.extrinsic.tolist() == frames
    of = dict(zip(names, kinds.names, strict=True))
    assert of["base.x"] == of["base.rz"] == "base" and of["tool.x"] == "tool"
    assert of["q2.d"] == of["q4.d"] not in ("base", "tool")
    n = len(names)
    jacobian = np.random.default_rng(3).standard_normal((2, n + 1, n))
    terms = movement_problem(plain(jacobian, np.zeros((2, n + 1))), kinds).terms
    alone = np.exp(terms.log_first)
    assert alone.sum() == pytest.approx(1.0)
    assert alone[kinds.extrinsic].sum() == pytest.approx(0.9)
    for part in (kinds.extrinsic, ~kinds.extrinsic):
        np.testing.assert_allclose(alone[part], alone[part].mean())
    first = names.index("base.x")
    beside = np.logaddexp.reduce(terms.log_prior([(first, 4)]))
    more = beside - terms.log_first
    assert more[names.index("base.y")] > 0.3 > more[names.index("tool.x")]


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
    assert unknowns.widening[0] == (1.0,) * 3 and unknowns.size.values == (0.0,)  # no smooth remainder


def test_frames_go_first_where_they_explain_as_much() -> None:
    """A part and a frame that show alike: the frame is named, and the part beside it as alike."""
    rng = np.random.default_rng(7)
    jacobian = rng.standard_normal((2, 20, 2))
    jacobian[:, :, 1] = jacobian[:, :, 0] * (1.0 + 1e-3 * rng.standard_normal((2, 20)))
    apart = np.array([-1.0, 1.0])[:, None] * 4.0 * jacobian[:, :, 0] + rng.standard_normal((2, 20))
    stack = plain(jacobian, apart, 10.0)
    for frame in (0, 1):
        kinds = Kinds(("p0", "p1"), np.arange(2) == frame)
        found = movement_posterior(likeliest(stack, kinds), kinds)
        assert found.likeliest.moved == (frame,)
        assert found.probability[frame] == pytest.approx(0.9, abs=0.05)  # as the prior has it
        assert found.together[frame] > 0.95
        assert found.alike[frame].keys() == {1 - frame} and abs(found.alike[frame][1 - frame]) < 3.0
        assert found.noise == pytest.approx(1.0, abs=0.25) and found.log_bayes_factor > 3.0


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


def test_what_no_session_sees_keeps_its_prior() -> None:
    """One session is enough to see a parameter; a column at rounding beside the others' is none."""
    seen = stacked(16, np.array([0.0, 2.0, -1.0, 1.0]))
    jacobian = seen.jacobian.copy()
    jacobian[1:, :, 0] = 0.0
    jacobian[:, :, 2] *= 1e-18
    stack = replace(seen, jacobian=jacobian)
    assert stack.visible.tolist() == [True, True, False]
    found = movement_posterior(likeliest(stack, KINDS), KINDS)
    assert found.likeliest.moved == (1,) and found.gain[1] > 3.0 and found.gain[2] == 0.0
    # its odds are those of a first member: nine in ten of which are of frames, here of this one
    odds = slot_odds(RICHNESS, 0) + np.log(0.9)
    assert found.probability[2] == pytest.approx(expit(odds), rel=1e-6)


def test_tolerances_of_parts_may_be_wrong_and_what_has_none_decides_nothing() -> None:
    """Classes of parts have doubtful tolerances; what has none has its usual movement in steps."""
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
    assert [c.kind for c in stack.classes] == ["length", "length", "frame", "angle"]
    np.testing.assert_allclose(stack.sigma, [0.5, np.inf, 2.0, 0.1])
    np.testing.assert_allclose(stack.unit, [0.05, 0.1, 0.2, 0.01])
    assert stack.n_observations == 18
    np.testing.assert_array_equal(stack.jacobian[1], seen[1].jacobian)
    np.testing.assert_allclose(stack.contrasts.T @ stack.contrasts, np.eye(1), atol=1e-12)
    np.testing.assert_allclose(stack.contrasts.sum(axis=0), 0.0, atol=1e-12)
