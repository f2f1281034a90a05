"""The search on a small arm: what is there is found, from wherever one starts, and nothing else is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from support.searched_arm import PLAY, ROWS, SCALE, WRONG_SIGN, Case, held, searched, sums_of
from truepose.errors import ConvergenceError
from truepose.identification import prior
from truepose.identification.diagnosis import search as searching
from truepose.identification.diagnosis.naming import named
from truepose.identification.diagnosis.posterior_summary import Named
from truepose.identification.diagnosis.proof import flip_inflation, replications
from truepose.identification.diagnosis.refit import fitted
from truepose.identification.diagnosis.search import Found, noise_at, start_from
from truepose.identification.diagnosis.selection_problem import (
    SelectionProblem,
    selection_problem,
    weighed_alone,
)
from truepose.identification.fit.estimated import Estimate
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.posterior import Posterior
from truepose.identification.posterior.state import State, slot_odds
from truepose.models.machine.placed import EffectAtPlace


def names(found: Found) -> set[EffectAtPlace]:
    """What the mode holds."""
    return {found.catalogue.cause(i) for i in found.accepted}


TRUE = {EffectAtPlace("backlash", ("q2",)), EffectAtPlace("actuator-scale", ("q1",))}
TWINS = {EffectAtPlace("backlash", ("q2",)): EffectAtPlace("friction-hysteresis", ("q2",))}
"""What is the same function: friction that slips at once."""


@pytest.fixture(scope="module")
def both() -> tuple[Case, Found]:
    return searched(PLAY, SCALE)


def test_what_is_there_is_found_and_nothing_else(both: tuple[Case, Found]) -> None:
    """Each member of the mode is likelier than an empty slot, and none that is not there is."""
    _, found = both
    assert names(found) == TRUE
    said = sums_of(found).inclusion()
    spike_slab, members = found.problem.spike_slab, found.mode.members
    for member in members:
        rest = [m for m in members if m != member]
        odds = spike_slab.log_odds(found.mode.point, rest)[:, member[0]]
        assert np.logaddexp.reduce(odds) + slot_odds(prior.RICHNESS, len(rest)) > 0.0
    more = spike_slab.log_odds(found.mode.point, members) + slot_odds(prior.RICHNESS, len(members))
    assert np.max(np.logaddexp.reduce(more, axis=0)) < 0.0
    assert all(said.places[place] > 0.7 for place in TRUE)
    assert all(said.places[place] + said.places.get(TWINS.get(place, place), 0.0) > 0.9 for place in TRUE)
    assert sum(said.places.get(cause, 0.0) > 0.5 for cause in said.places) == len(TRUE)
    likeliest, share = said.sets[0].effects, said.sets[0].probability
    assert set(likeliest) == TRUE and share > 0.1


def test_a_few_rows_less_end_at_the_same_set(both: tuple[Case, Found]) -> None:
    case, first = both
    some = case.exclude
    some[::10] = True
    again = case.found(some)
    assert names(again) == names(first)
    assert not again.fit.used[some].any()


def test_what_is_not_there_is_not_found() -> None:
    _, found = searched()
    assert not found.accepted and not found.mode.members
    said = sums_of(found).inclusion()
    assert named(found, sums_of(found)) == ()
    assert all(p < 0.5 for p in said.places.values())


def test_play_of_the_wrong_sign_is_no_play() -> None:
    """Physics that only goes one way is not named where readings go the other."""
    _, found = searched(WRONG_SIGN, SCALE)
    assert ("backlash", ("q2",)) not in names(found)
    assert ("actuator-scale", ("q1",)) in names(found)


def test_without_a_minimum_the_search_stays_where_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = Case.of(tmp_path, SCALE)

    def fails(*_: object, **__: object) -> Estimate:
        raise ConvergenceError("no minimum")

    monkeypatch.setattr(searching, "estimate", fails)
    found = case.found()
    assert found.fit is case.null and not found.accepted
    causes = found.problem.spike_slab.terms.cause
    assert {found.problem.causes[causes[t]] for t, _ in found.mode.members} == {("actuator-scale", ("q1",))}


# -- names --------------------------------------------------------------------------------------------------


# -- alone, and by halves -------------------------------------------------------------------------------------


def test_every_candidate_is_weighed_alone(both: tuple[Case, Found]) -> None:
    """The best is a true one; the log Bayes factor of each is that of the evidence with it and without; series that are too
    long for the readings have none."""
    case, found = both
    alone = found.alone
    assert found.catalogue.cause(int(np.argmax(alone))) in TRUE
    count = len(case.cat.candidates)
    assert len(alone) == len(found.catalogue.candidates) >= count
    first = selection_problem(case.signatures.linearise(case.null), case.cat, case.rms)
    held = 3 * np.array([len(c.coefficients) for c in case.cat.candidates]) <= sum(
        first.spike_slab.design.counts
    )
    np.testing.assert_array_equal(np.isfinite(alone[:count]), held)
    np.testing.assert_allclose(alone[:count], weighed_alone(first, count), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("first_row", "agree"), [(0, True), (ROWS // 2, False)])
def test_an_effect_in_one_half_only_is_not_in_the_other(tmp_path: Path, first_row: int, agree: bool) -> None:
    """A scale that is there from some row on, with a model that holds nothing but it."""
    case = Case.of(tmp_path, "actuator-scale@q1:s=2e-3", only_from=first_row)
    lin = case.signatures.linearise(case.null)
    problem = selection_problem(lin, case.cat, case.rms)
    at = next(i for i in range(len(case.cat.candidates)) if case.cat.cause(i) == ("actuator-scale", ("q1",)))
    term = problem.candidates.index(at)
    noise = int(np.argmin(np.abs(np.log(problem.spike_slab.unknowns.noise[0].values))))
    state = State(((term, 4),), GridPoint((noise,), 0), 0.0)
    nothing = cast(Posterior, None)
    found = Found(problem, nothing, state, {}, case.null, lin, case.signatures, case.cat, np.zeros(0), lin)
    name = Named(problem.causes[int(problem.spike_slab.terms.cause[term])], (at,), 1.0, 1.0, (), 9.0)
    (half,) = replications(found, [name], case.rms)
    assert half is not None and half.agree is agree
    assert (min(half.halves) > 0.9) is agree and max(half.halves) > 0.9


def test_play_is_no_matter_of_tolerances() -> None:
    """Play is no geometry: no widening makes it go."""
    _, found = searched(PLAY)
    (play,) = named(found, sums_of(found))
    assert flip_inflation(found, play) is None


def test_amplitudes_of_any_size_are_stepped_in_their_own_spread(both: tuple[Case, Found]) -> None:
    """Seven orders of magnitude between two priors are no rounding: nothing of the fit passes for unknown."""
    case, found = both
    first, *rest = found.accepted
    fit = fitted(found, {first: 1.0, **dict.fromkeys(rest, 1e-7)}, case.exclude)
    assert fit is not None and rest
    amplitudes = fit.prior.free >= len(fit.nominal.parameters)
    np.testing.assert_allclose(fit.prior_weight[amplitudes], fit.noise, rtol=1e-12)
    assert len(fit.known.unknown) == 0


# -- what fits begin with -----------------------------------------------------------------------------------------


def test_a_fit_begins_with_what_another_one_knows() -> None:
    """Parameters and amplitudes, in the order of the new terms; nothing for terms that it has not."""
    case, found = held(PLAY, SCALE)
    known = {e.label: e.amplitudes for e in found.fit.fitted_effects()}
    other = next(c for c in case.cat.candidates if c.label not in known and len(c.coefficients) > 1)
    terms = [other, *found.fit.effects[::-1]]
    start = start_from(found.fit, terms)
    count = len(found.fit.nominal.parameters)
    np.testing.assert_array_equal(start[:count], found.fit.p[:count])
    expected = [*[0.0] * len(other.coefficients), *(float(v) for t in terms[1:] for v in known[t.label])]
    np.testing.assert_array_equal(start[count:], expected)


def test_the_noise_of_several_kinds_is_their_mean_by_readings() -> None:
    """Geometric: twice as noisy and half as noisy is as stated, where there are as many of both."""

    def at(scales: list[float], counts: tuple[int, ...]) -> float:
        slab = SimpleNamespace(
            unknowns=SimpleNamespace(scales=lambda _: np.array(scales)), design=SimpleNamespace(counts=counts)
        )
        problem = cast(SelectionProblem, SimpleNamespace(spike_slab=slab))
        return noise_at(problem, State((), GridPoint((0,), 0), 0.0))

    assert at([1.7], (30,)) == pytest.approx(1.7)
    assert at([2.0, 0.5], (30, 30)) == pytest.approx(1.0)
    assert at([2.0, 0.5], (20, 10)) == pytest.approx(2.0 ** (1 / 3))


def test_halves_of_too_few_readings_say_nothing_of_names() -> None:
    case, found = held(PLAY, SCALE)
    one = Named(EffectAtPlace("backlash", ("q2",)), tuple(found.accepted)[:1], 0.9, 0.9, (), 30.0)
    assert replications(found, (), case.rms) == ()
    both = replications(found, (one, one), case.rms)
    assert len(both) == 2 and both[0] is not None and both[0].agree and min(both[0].halves) > 0.5
    few = np.zeros(len(found.fit.used), dtype=bool)
    few[:8] = True
    short = replace(found, fit=replace(found.fit, used=few))
    assert replications(short, (one, one), case.rms) == (None, None)


def test_an_effect_that_is_there_throughout_is_in_both_halves(both: tuple[Case, Found]) -> None:
    case, found = both
    told = named(found, sums_of(found))
    for half in replications(found, told, case.rms):
        assert half is not None and half.agree
        assert min(half.halves) > 0.5
    assert replications(found, (), case.rms) == ()
