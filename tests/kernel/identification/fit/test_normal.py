"""Large fits by normal equations: the same sums as the rows', the same estimate, and only where rounding allows it."""

from __future__ import annotations

import numpy as np
import pytest

from support.built_machines import Machines, manufactured, simulated
from support.engines import compile_hastily, compile_none
from support.generated_c import needs_compiler
from truepose.arrays import Array
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.problem import Problem, prior_of
from truepose.identification.prediction.predictor import FIT, Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

pytestmark = needs_compiler


@pytest.fixture
def arm(machines: Machines, monkeypatch: pytest.MonkeyPatch) -> Machine:
    compile_hastily(monkeypatch)
    return machines["arm"]


def recorded(machine: Machine, seed: int = 7) -> Recording:
    rng = np.random.default_rng(seed)
    return simulated(machine, manufactured(machine, rng), rng)


def problem(machine: Machine, recording: Recording, sigma: Array | None = None) -> Problem:
    predictor, prior = Predictor(machine, recording, visits=FIT), prior_of(machine)
    prior = prior if sigma is None else prior.with_sigma(sigma)
    used = ~recording.validation & (np.arange(len(recording)) % 5 != 0)
    return Problem(predictor, prior, predictor.model.p_home.copy(), used)


def gram(blocks: list[Array]) -> Array:
    return np.asarray(sum((block.T @ block for block in blocks), np.zeros((blocks[0].shape[1],) * 2)))


def test_few_rows_have_the_sums_of_all(arm: Machine) -> None:
    """With rows left out and rows that count half, at a step from the start."""
    found = problem(arm, recorded(arm))
    found.weights = np.random.default_rng(2).uniform(0.1, 1.0, len(found.used))
    t = np.random.default_rng(3).normal(0, 0.1, len(found.prior.free))
    blocks = [np.asarray(block) for block in found.blocks(t)]
    assert [len(block) for block in blocks] == [len(t) + 1, len(t)]  # sums, tolerances
    one, other = gram(blocks[:1]), gram([np.asarray(block) for block in found.data(found.at(t), found.x)])
    size = np.sqrt(np.outer(np.diag(other), np.diag(other)))
    np.testing.assert_allclose(one / size, other / size, atol=1e-12)


@pytest.mark.parametrize("loss", ["gauss", "huber"])
def test_the_estimate_is_that_of_the_rows(arm: Machine, monkeypatch: pytest.MonkeyPatch, loss: str) -> None:
    recording = recorded(arm)
    fast = estimate(arm, recording, loss=loss)
    compile_none(monkeypatch)
    slow, free = estimate(arm, recording, loss=loss), fast.prior.free
    # a fit ends with 1e-9 of half the sum of squares to gain: 5e-5 of a 1-sigma, and one polishing step beyond that
    np.testing.assert_allclose((fast.p - slow.p)[free] / slow.std[free], 0.0, atol=1e-6)
    np.testing.assert_allclose(fast.std[free], slow.std[free], rtol=1e-6)
    assert fast.rank == slow.rank and fast.solution.status is slow.solution.status


def test_what_tolerances_do_not_hold_is_seen_row_by_row(arm: Machine) -> None:
    """Without a prior, or with one that rounding of the sums would reach: rank is no matter of sums."""
    recording, prior = recorded(arm), prior_of(arm)
    for sigma in (np.where(prior.sigma > 0, np.inf, 0.0), prior.sigma * 1e8):
        found = problem(arm, recording, sigma)
        assert len(np.asarray(next(iter(found.blocks(np.zeros(len(prior.free))))))) > len(prior.free) + 1
