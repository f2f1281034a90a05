"""Laws of how a linearisation becomes a posterior's problem: evidence, units, terms and their shares."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from support.effects import with_effect
from support.linear_models import ANGLE, LENGTH, READINGS, catalogue_of, linear, unit
from truepose.arrays import Array
from truepose.identification import prior
from truepose.identification.diagnosis.posterior_summary import Named
from truepose.identification.diagnosis.proof import WIDENINGS, flip_inflation
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.selection_problem import (
    SelectionProblem,
    selection_problem,
    weighed_alone,
)
from truepose.identification.fit.estimate import estimate
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.spike_slab import Member
from truepose.identification.posterior.state import State, slot_odds
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue, catalogue
from truepose.identification.signatures.linearisation import Linearisation
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine

Listed = tuple[Catalogue, SelectionProblem]

Shifts = tuple[PlacedEffect, ...]

# -- evidence -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("departure", [0.0, 1.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_evidence_is_that_of_readings_at_the_drawing_wherever_the_fit_stands(
    shifts: Shifts, departure: float, seed: int
) -> None:
    lin, j, g, e = linear(shifts[:3], seed, sizes=(0.3,), departure=departure)
    problem = selection_problem(lin, catalogue_of(shifts[:3]), 1.5)
    spike_slab = problem.spike_slab

    def dense(point: GridPoint, size: float) -> float:
        noise = spike_slab.unknowns.noise[0].values[point.noise[0]]
        wide = dict(zip(problem.classes, spike_slab.unknowns.widening[point.widening], strict=True))
        spread = j * np.array([wide[c] for c in lin.parts])
        v = noise**2 * np.eye(READINGS) + spread @ spread.T + size**2 * np.outer(g[:, 0], g[:, 0])
        return float(multivariate_normal.logpdf(e, cov=v))

    at = unit(problem)
    other = at.louder(3).widened(1)
    for point in (at, other):
        term = problem.candidates.index(0)
        odds = spike_slab.log_odds(point, ())[:, term] - spike_slab.terms.log_first[term]
        for s, size in enumerate(spike_slab.sizes.values):
            if not spike_slab.noticeable[s, term]:
                assert odds[s] == -np.inf
                continue
            expected = dense(point, float(size)) - dense(point, 0.0) + spike_slab.sizes.log_prior[s]
            assert odds[s] == pytest.approx(expected, abs=1e-5)
    here, there = (spike_slab.log_evidence(p, ()) - spike_slab.unknowns.log_prior(p) for p in (at, other))
    assert here - there == pytest.approx(dense(at, 0.0) - dense(other, 0.0), abs=1e-5)


def test_units_of_parameters_and_coefficients_are_nothing(shifts: Shifts) -> None:
    """Scales of J go with its tolerances, and the order of rows is not in a Gram matrix."""
    lin, *_ = linear(shifts[:3], 4, sizes=(0.5,), departure=1.0)
    factor = np.array([1e3, 1e-3, 7.0])
    scale = np.concatenate([factor, np.ones(4)])
    other = replace(
        lin,
        grams=(lin.gram * scale[:, None] * scale,),
        departure=lin.departure / scale[:-1],
        weight=lin.weight * factor,
    )
    one, two = (
        weighed_alone(selection_problem(own, catalogue_of(shifts[:3]), 1.5), 3) for own in (lin, other)
    )
    np.testing.assert_allclose(two, one, atol=1e-6)


@pytest.mark.parametrize("away", [0.0, 1e3, -1e6])
def test_a_wrong_constant_where_nothing_is_known_is_never_likely(arm: Machine, away: float) -> None:
    """A frame without a tolerance may be anywhere: a constant of it that is wrong says nothing more, however far it is."""
    wrong = with_effect(arm, "wrong-constant", ("tool.x",))
    shift = with_effect(arm, "zero-shift", ("q2",), {"session": 1.0})
    rng = np.random.default_rng(5)
    j = rng.standard_normal((READINGS, 3))
    g = np.column_stack([50.0 * j[:, 2], rng.standard_normal(READINGS)])
    e = rng.standard_normal(READINGS) + away * j[:, 2]
    rows = np.column_stack([j, g, -e])
    lin = Linearisation(
        (rows.T @ rows,), (READINGS,), 3, (slice(0, 1), slice(1, 2)), np.zeros(5), np.array([1.0, 1.0, 0.0]),
        (LENGTH, LENGTH, ANGLE), (wrong, shift),
    )  # fmt: skip
    alone = weighed_alone(selection_problem(lin, catalogue_of((wrong, shift)), 1.5), 2)
    assert alone[0] == pytest.approx(0.0, abs=1e-6)  # neither for nor against
    known = replace(lin, weight=np.ones(3))
    assert (
        weighed_alone(selection_problem(known, catalogue_of((wrong, shift)), 1.5), 2)[0] < 0.0 or away != 0.0
    )


# -- terms, their urns and their shares ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def listed(recorded: tuple[Machine, Recording]) -> Listed:
    """All that a recording of an arm could speak of."""
    machine, recording = recorded
    cat = catalogue(machine, recording)
    lin = Signatures(machine, recording, cat.candidates).linearise(estimate(machine, recording))
    return cat, selection_problem(lin, cat, 1.5)


def logs(problem: SelectionProblem, *present: Member) -> Array:
    """(s, c) log prior of every term at every size beside some."""
    return problem.spike_slab.terms.log_prior(present)


def kind_of(cat: Catalogue, index: int) -> tuple[str, ...]:
    """Names go by their effect and how many parts are in it together; all that has none is alike."""
    slug, place = cat.cause(index)
    return (slug, str(len(place))) if cat.has_law(index) else ()


def test_every_candidate_that_is_not_stated_is_a_term_of_its_own(shifts: Shifts, listed: Listed) -> None:
    """With its columns; candidates of one effect at one place are one cause."""
    lin, *_ = linear(shifts)
    for stated, own in (((), (0, 1, 2, 3)), ((1,), (0, 2, 3))):
        problem = selection_problem(lin, replace(catalogue_of(shifts), stated=stated), 1.5)
        assert problem.candidates == own
        assert [c.tolist() for c in problem.spike_slab.terms.columns] == [[i] for i in own]
    cat, problem = listed
    blamed = [problem.causes[k] for k in problem.spike_slab.terms.cause]
    assert blamed == [cat.cause(i) for i in problem.candidates]
    assert len(set(problem.causes)) == len(problem.causes)


def test_terms_of_one_cause_stand_together_where_they_add(listed: Listed) -> None:
    """Harmonics, and forms without a name; of any other effect a place has one setting only."""
    cat, problem = listed
    excludes, cause = problem.spike_slab.terms.excludes, problem.spike_slab.terms.cause
    add = [cat.candidates[i].effect.settings_add or not cat.named(i) for i in problem.candidates]
    same = cause[:, None] == cause[None, :]
    alone = same & ~np.array(add)[:, None] | np.eye(len(cause), dtype=bool)
    np.testing.assert_array_equal(excludes, alone)


def test_prior_shares_of_all_terms_add_up_to_one(shifts: Shifts, listed: Listed) -> None:
    """Of kinds, of terms and of settings in their kind; what the machine is said to have gives its share to the others."""
    lin, *_ = linear(shifts)
    some = [selection_problem(lin, replace(catalogue_of(shifts), stated=s), 1.5) for s in ((), (3,), (1,))]
    for terms in (problem.spike_slab.terms for problem in (*some, listed[1])):
        urn, share = terms.urn, np.exp([term.log_share for term in terms.all])
        assert np.sum(np.exp(terms.log_first)) == pytest.approx(1.0, abs=1e-9)
        assert np.sum(np.exp(terms.log_prior(()))) == pytest.approx(1.0, abs=1e-9)
        assert np.sum(urn.share) == pytest.approx(1.0, abs=1e-9)
        np.testing.assert_allclose(np.bincount(terms.kind, weights=share), 1.0)
        np.testing.assert_allclose(np.bincount(urn.feature_kind, weights=urn.feature_share), 1.0)
        np.testing.assert_allclose(np.bincount(terms.feature, weights=share), urn.feature_share)


def test_names_and_what_has_none_share_as_the_prior_says(listed: Listed) -> None:
    """Whatever their number; names among each other as the catalogue has it."""
    cat, problem = listed
    first = problem.spike_slab.terms.log_first
    nameless = np.array([not cat.named(i) for i in problem.candidates])
    assert np.sum(np.exp(first[nameless])) == pytest.approx(prior.UNNAMED_SHARE)
    own = np.array([cat.log_prior[i] for i in problem.candidates])
    for part in (nameless, ~nameless):
        np.testing.assert_allclose((first - own)[part], (first - own)[part][0], atol=1e-9)


def test_one_kind_is_one_effect_at_all_its_places_and_another_all_that_has_no_name(listed: Listed) -> None:
    cat, problem = listed
    terms = problem.spike_slab.terms
    kinds = [kind_of(cat, i) for i in problem.candidates]
    assert len(set(zip(kinds, terms.kind.tolist(), strict=True))) == len(set(kinds)) == len(terms.urn.share)
    for kind in set(kinds):
        k = int(terms.kind[kinds.index(kind)])
        places = {cat.cause(i) for i in problem.candidates if kind_of(cat, i) == kind}
        assert terms.urn.number[k] == len(places)
    bare = np.array(
        [not cat.has_law(i) for i in problem.candidates]
    )  # one kind, exchanged for what is at other parts
    assert len({*terms.group[bare]}) > 1 and {*terms.group[bare]}.isdisjoint(terms.group[~bare])


def test_what_has_no_name_brings_its_like_at_other_places_and_no_names(listed: Listed) -> None:
    """Nor one name rather than another: effects of several places keep their proportions, whatever their size; what is the
    only one of its kind is as likely as ever."""
    cat, problem = listed
    terms, before = problem.spike_slab.terms, logs(problem)
    grows, cause, alike = terms.urn.number[terms.kind] > 1, terms.cause, 0
    nameless = np.array([not cat.has_law(i) for i in problem.candidates])
    assert len(set(cause[nameless].tolist())) > 3
    for k in np.flatnonzero(nameless):
        after = logs(problem, (int(k), 4))
        for some in (~nameless & grows, ~nameless & ~grows):
            change = (after - before)[:, some]
            assert change.max() <= 1e-12
            np.testing.assert_allclose(change, change[0, 0], atol=1e-9)
        like = (terms.feature == terms.feature[k]) & (cause != cause[k])
        alike += bool(like.any())
        assert not like.any() or np.exp(after[:, like]).sum() > np.exp(before[:, like]).sum()
    assert alike > 10


def test_a_name_falls_where_tolerances_are_wide_enough_to_stand_in_for_it(
    shifts: Shifts,
) -> None:
    """The widening told is the first at which the odds of the name, all else as in the mode, are below even."""
    told = []
    for size in (5.0, 12.0, 40.0, 4000.0):
        axes = np.linalg.qr(np.random.default_rng(4).standard_normal((READINGS, 3)))[0]
        along = np.cos(0.2) * axes[:, 0] + np.sin(0.2) * axes[:, 1]
        rows = np.column_stack([2.0 * axes[:, 0], 50.0 * along, -size * axes[:, 0]])
        lin = Linearisation(
            (rows.T @ rows,),
            (READINGS,),
            1,
            (slice(0, 1),),
            np.zeros(2),
            np.ones(1),
            (LENGTH,),
            shifts[:1],
        )
        problem = selection_problem(lin, catalogue_of(shifts[:1]), 1.5)
        values = problem.spike_slab.sizes.values
        state = State(((0, int(np.argmin(np.abs(np.log(values / (size / 50.0)))))),), unit(problem), 0.0)
        name = Named(problem.causes[0], (0,), 1.0, 1.0, (), 9.0)
        flip = flip_inflation(cast(Found, SimpleNamespace(problem=problem, mode=state)), name)
        worth = [_odds(problem, state, axes[:, 0], along, size, w) for w in WIDENINGS]
        needed = [odds > 0.0 for odds in worth]
        expected = None if needed[-1] else WIDENINGS[needed.index(False)]
        assert flip == expected
        told.append(flip)
    assert len(set(told)) > 2  # the sizes tell


def _odds(
    problem: SelectionProblem, state: State, part: Array, along: Array, size: float, width: float
) -> float:
    """Log odds of a term along ``along`` beside a part of this tolerance, in readings of ``size`` along the part."""
    ((term, own),) = state.members
    spread = float(problem.spike_slab.sizes.values[own])
    noise = problem.spike_slab.unknowns.noise[0].values[state.point.noise[0]]
    v = noise**2 * np.eye(READINGS) + (2.0 * width) ** 2 * np.outer(part, part)
    both = v + spread**2 * 50.0**2 * np.outer(along, along)
    gain = multivariate_normal.logpdf(size * part, cov=both) - multivariate_normal.logpdf(size * part, cov=v)
    share = float(problem.spike_slab.terms.log_first[term] + problem.spike_slab.sizes.log_prior[own])
    return float(gain) + share + slot_odds(prior.RICHNESS, 0)
