"""Laws of predictions that average over sets: moments of one state, mixtures of several, and the fit that is moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from support.linear_problems import SIZES, random_problem, single
from support.searched_arm import PLAY, SCALE, held, searched
from truepose.arrays import Array
from truepose.identification.diagnosis import averaging
from truepose.identification.diagnosis.averaging import WORSE, averaged
from truepose.identification.diagnosis.posterior_summary import LEADING
from truepose.identification.diagnosis.refit import fitted
from truepose.identification.diagnosis.search import Found, chosen
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.spike_slab import SpikeSlab
from truepose.identification.posterior.state import State, moments, typical

# -- moments of a state -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("point", [GridPoint((1, 0), 0), GridPoint((0, 1), 1), GridPoint((2, 1), 2)])
@given(seed=st.integers(0, 10**6))
@hypothesis_settings(max_examples=10, deadline=None)
def test_moments_are_those_of_the_whole_covariance(point: GridPoint, seed: int) -> None:
    """Coefficients c of 1-sigma q given e ~ N(0, V): mean q^2 G'V^-1 e, covariance q^2 - q^2 G'V^-1 G q^2; geometry alike."""
    dense = random_problem(seed)
    spike_slab = SpikeSlab(dense.design, dense.unknowns, single(1, 2, 1, 3), SIZES)
    state = State(((1, 1), (3, 0)), point, 0.0)
    found = moments(spike_slab, state)
    columns, sizes = [1, 2, 4, 5, 6], SIZES.values[[1, 1, 0, 0, 0]].tolist()
    precision = dense.precision(point, columns, sizes)
    sigma = dense.sigma(point)
    known = np.flatnonzero(np.isfinite(sigma))
    design = np.column_stack([dense.a[:, known], dense.g[:, columns]])
    prior = np.concatenate([sigma[known], np.array(sizes)]) ** 2
    at = np.searchsorted(found.at, np.concatenate([known, dense.design.n + np.array(columns)]))
    np.testing.assert_allclose(found.mean[at], prior * (design.T @ precision @ dense.e), atol=1e-7)
    covariance = np.diag(prior) - prior[:, None] * (design.T @ precision @ design) * prior
    np.testing.assert_allclose(found.covariance[np.ix_(at, at)], covariance, atol=1e-7)


def test_states_are_taken_evenly_along_their_shares() -> None:
    states = [
        (State(((k, 0),), GridPoint((0,), 0), 0.0), share)
        for k, share in enumerate([0.5, 0.25, 0.15, 0.06, 0.03, 0.01])
    ]
    few = typical(states, 4)
    assert [(s.members[0][0], w) for s, w in few] == [(0, 0.5), (1, 0.25), (2, 0.25)]
    many = {s.members[0][0]: w for s, w in typical(states, 100)}
    assert many == pytest.approx({0: 0.5, 1: 0.25, 2: 0.15, 3: 0.06, 4: 0.03, 5: 0.01})
    assert sum(w for _, w in typical(states[:1], 7)) == pytest.approx(1.0)


# -- the fit that is moved --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def found() -> Found:
    return searched(PLAY, SCALE)[1]


@pytest.fixture(scope="module")
def likeliest(found: Found) -> Estimate:
    exclude = np.zeros(len(found.fit.used), dtype=np.bool_)
    fit = fitted(found, chosen(found.problem, found.mode), exclude)
    assert fit is not None
    return fit


def holding(found: Found, *states: tuple[State, float]) -> Found:
    return replace(found, posterior=replace(found.posterior, states=states))


def without(state: State, term: int) -> State:
    return replace(state, members=tuple(m for m in state.members if m[0] != term))


def amplitudes(fit: Estimate) -> Array:
    return np.concatenate([e.amplitudes for e in fit.fitted_effects()])


def test_one_state_is_its_own_average(found: Found, likeliest: Estimate) -> None:
    """The fit stays where it is, and knows what it knew."""
    same = averaged(holding(found, (found.mode, 1.0)), likeliest)
    np.testing.assert_allclose(same.p, likeliest.p, rtol=0, atol=1e-12)
    np.testing.assert_allclose(same.covariance, likeliest.covariance, rtol=1e-6, atol=1e-14)
    np.testing.assert_allclose(same.residual, likeliest.residual, atol=1e-7)


def test_what_is_open_has_its_share_of_the_amplitude_and_the_rest_in_its_sigma(
    found: Found, likeliest: Estimate, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mixture of two Gaussians, one at zero: mean p a, variance p s^2 + p (1 - p) a^2."""
    term = found.mode.members[0][0]
    label = found.catalogue.candidates[found.problem.candidates[term]].label
    p = 0.7
    monkeypatch.setattr(
        averaging, "WORSE", np.inf
    )  # readings would contradict the mean: both states are far apart
    sure = averaged(holding(found, (found.mode, 1.0)), likeliest)
    mixed = averaged(holding(found, (found.mode, p), (without(found.mode, term), 1.0 - p)), likeliest)
    at = next(k for k, name in enumerate(mixed.prior.names) if name.startswith(label))
    size = sure.p[at]
    assert mixed.p[at] == pytest.approx(p * size, rel=1e-3)
    assert mixed.std[at] ** 2 == pytest.approx(p * sure.std[at] ** 2 + p * (1.0 - p) * size**2, rel=0.05)


def test_rare_ones_have_no_part(found: Found, likeliest: Estimate) -> None:
    """Below ``LEADING`` a candidate beside the likeliest set is left out, and geometry does not move for it."""
    used = {term for term, _ in found.mode.members}
    term = next(k for k in range(len(found.problem.candidates)) if k not in used)
    more = replace(found.mode, members=(*found.mode.members, (term, 0)))
    rare = averaged(holding(found, (found.mode, 1.0 - LEADING / 2), (more, LEADING / 2)), likeliest)
    np.testing.assert_allclose(rare.p, likeliest.p, rtol=0, atol=1e-12)
    often = averaged(holding(found, (found.mode, 1.0 - 2 * LEADING), (more, 2 * LEADING)), likeliest)
    assert len(often.effects) > len(rare.effects) == len(likeliest.effects)


def test_a_mean_that_readings_contradict_is_not_used_but_widens(found: Found, likeliest: Estimate) -> None:
    """Both effects are large: the mean of states with and without one fits nothing."""
    term = found.mode.members[0][0]
    mixed = averaged(holding(found, (found.mode, 0.5), (without(found.mode, term), 0.5)), likeliest)
    assert mixed.chi2 <= (1.0 + WORSE) * likeliest.chi2
    assert np.all(mixed.std >= likeliest.std * (1.0 - 1e-9))
    assert np.max(mixed.std / np.maximum(likeliest.std, 1e-300)) > 5.0


# -- what has a part in it ----------------------------------------------------------------------------------------


def beside(found: Found, state: State, label: str, size: int) -> State:
    """A state with one candidate more."""
    number = next(i for i, c in enumerate(found.catalogue.candidates) if c.label.startswith(label))
    return replace(state, members=(*state.members, (found.problem.candidates.index(number), size)))


def test_what_may_be_there_is_carried_with_its_largest_size() -> None:
    """Names alone, from a tenth of the states on, the likeliest first; what bounds left nothing of stays out."""
    case, found = held(PLAY, SCALE)
    mode, values = found.mode, found.problem.spike_slab.sizes.values
    form = next(c.label for i, c in enumerate(case.cat.candidates) if not case.cat.named(i))
    shares = [
        (mode, 0.3),
        (beside(found, mode, "backlash@q1", 4), 0.15),
        (beside(found, mode, "backlash@q1", 6), 0.05),
        (beside(found, mode, "actuator-scale@q2", 5), 0.3),
        (beside(found, mode, "friction-hysteresis@q1", 5), 0.09),
        (beside(found, mode, form, 5), 0.11),
    ]
    after = averaged(holding(found, *shares), found.fit)
    told = {e.label: e.spread for e in after.effects[len(found.fit.effects) :]}
    assert told == pytest.approx({"actuator-scale@q2": values[5], "backlash@q1": values[6]})
    assert list(told) == ["actuator-scale@q2", "backlash@q1"]
    assert [e.label for e in after.effects[: len(found.fit.effects)]] == [e.label for e in found.fit.effects]
    only = replace(found.fit, effects=found.fit.effects[:1])
    gone = found.fit.effects[1].label
    less = averaged(holding(found, *shares), estimate(only.nominal, case.signatures.recording, only.effects))
    assert gone not in {e.label for e in less.effects}


def test_states_of_nothing_rare_speak_alone_where_there_are_enough() -> None:
    """From a tenth of the states on; else all speak, less what is rare in them."""
    _, found = held(PLAY, SCALE)
    mode = found.mode
    term = mode.members[0][0]
    rare = [
        beside(found, mode, label, 4)
        for label in ("backlash@q1", "friction-hysteresis@q1", "friction-hysteresis@q2")
    ]
    plain = averaged(holding(found, (mode, 1.0)), found.fit)
    enough = [(mode, 0.8), *((state, 0.06) for state in rare)]
    np.testing.assert_allclose(averaged(holding(found, *enough), found.fit).std, plain.std, rtol=1e-6)
    # states of something rare, which lack what the likeliest one has: alone they would be all that differs
    lacking = [(mode, 0.12), *((without(state, term), 0.08) for state in rare)]
    sure = averaged(holding(found, *lacking), found.fit)
    np.testing.assert_allclose(sure.std, plain.std, rtol=1e-6)
    few = [(mode, 0.03), *((without(state, term), 0.09) for state in rare)]
    open_ = averaged(holding(found, *few), found.fit)
    assert np.max(open_.std / np.maximum(plain.std, 1e-300)) > 3.0
