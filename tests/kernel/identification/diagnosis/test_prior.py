"""Laws of the prior of a catalogue: terms and causes, shares, like goes with like, and no order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from support.linear_models import catalogue_of, linear
from truepose.identification import prior
from truepose.identification.diagnosis.selection_problem import SelectionProblem, selection_problem
from truepose.identification.fit.estimate import estimate
from truepose.identification.posterior.spike_slab import Member
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue, catalogue
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def listed(recorded: tuple[Machine, Recording]) -> tuple[Catalogue, SelectionProblem]:
    """All that a recording of an arm could speak of."""
    machine, recording = recorded
    cat = catalogue(machine, recording)
    lin = Signatures(machine, recording, cat.candidates).linearise(estimate(machine, recording))
    return cat, selection_problem(lin, cat, 1.5)


def logs(problem: SelectionProblem, *present: Member) -> Array:
    """(s, c) log prior of every term at every size beside some."""
    return problem.spike_slab.terms.log_prior(present)


def kind_of(cat: Catalogue, index: int) -> tuple[str, ...]:
    """Names go by their effect and how many parts are in it together; what has none by its place."""
    slug, place = cat.cause(index)
    return (slug, str(len(place))) if cat.named(index) else ("", *place)


def test_every_candidate_that_is_not_stated_is_a_term_of_its_own(
    shifts: tuple[PlacedEffect, ...], listed: tuple[Catalogue, SelectionProblem]
) -> None:
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


def test_terms_of_one_cause_stand_together_where_they_add(listed: tuple[Catalogue, SelectionProblem]) -> None:
    """Harmonics, and forms without a name; of any other effect a place has one setting only."""
    cat, problem = listed
    excludes, cause = problem.spike_slab.terms.excludes, problem.spike_slab.terms.cause
    add = [cat.candidates[i].effect.settings_add or not cat.named(i) for i in problem.candidates]
    same = cause[:, None] == cause[None, :]
    alone = same & ~np.array(add)[:, None] | np.eye(len(cause), dtype=bool)
    np.testing.assert_array_equal(excludes, alone)


def test_prior_shares_of_all_terms_add_up_to_one(
    shifts: tuple[PlacedEffect, ...], listed: tuple[Catalogue, SelectionProblem]
) -> None:
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


def test_names_and_what_has_none_share_as_the_prior_says(listed: tuple[Catalogue, SelectionProblem]) -> None:
    """Whatever their number; names among each other as the catalogue has it."""
    cat, problem = listed
    first = problem.spike_slab.terms.log_first
    nameless = np.array([not cat.named(i) for i in problem.candidates])
    assert np.sum(np.exp(first[nameless])) == pytest.approx(prior.UNNAMED_SHARE)
    own = np.array([cat.log_prior[i] for i in problem.candidates])
    for part in (nameless, ~nameless):
        np.testing.assert_allclose((first - own)[part], (first - own)[part][0], atol=1e-9)


def test_one_kind_is_one_effect_at_all_its_places_and_a_nameless_place_by_itself(
    listed: tuple[Catalogue, SelectionProblem],
) -> None:
    cat, problem = listed
    terms = problem.spike_slab.terms
    kinds = [kind_of(cat, i) for i in problem.candidates]
    assert len(set(zip(kinds, terms.kind.tolist(), strict=True))) == len(set(kinds)) == len(terms.urn.share)
    for kind in set(kinds):
        k = int(terms.kind[kinds.index(kind)])
        places = {cat.cause(i) for i in problem.candidates if kind_of(cat, i) == kind}
        assert terms.urn.number[k] == len(places) and (len(places) == 1 or kind[0])


@pytest.mark.parametrize("size", [0, 4, 8])
@pytest.mark.parametrize(
    "slug", ["transmission-error", "encoder-eccentricity", "axis-wobble", "wrong-constant"]
)
def test_where_one_joint_errs_others_may_and_likeliest_alike(
    listed: tuple[Catalogue, SelectionProblem], slug: str, size: int
) -> None:
    """A second place of an effect, by the urns written out: of the kind, and in it of settings and of sizes."""
    cat, problem = listed
    cause, sizes = problem.spike_slab.terms.cause, problem.spike_slab.sizes
    own = [k for k, i in enumerate(problem.candidates) if cat.cause(i).effect == slug]
    placed = {k: cat.candidates[problem.candidates[k]] for k in own}
    told = {k: e.effect.told(e.settings_map) for k, e in placed.items()}
    before, first = logs(problem), own[0]
    beside = logs(problem, (first, size))
    share = {k: float(np.exp(problem.spike_slab.terms.log_first[k])) for k in own}
    b, n, w, a = sum(share.values()), len({e.place for e in placed.values()}), prior.URN, prior.ALIKE
    urn = problem.spike_slab.terms.urn
    grown = float(urn.share[urn.number > 1].sum())  # of all kinds that have more than one place
    kind = (w * b + grown) / (w + 1.0) / b * n / (n - 1.0)
    others = {int(cause[k]) for k in own} - {int(cause[first])}
    assert len(others) == n - 1
    for other in others:
        terms = [k for k in own if cause[k] == other]
        assert np.logaddexp.reduce(beside[:, terms], axis=None) > np.logaddexp.reduce(
            before[:, terms], axis=None
        )
        for k in terms:
            f = sum(share[j] for j in own if told[j] == told[k]) / b
            setting = (a * f + (told[k] == told[first])) / (a + 1.0) / f
            large = (a * np.exp(sizes.log_prior) + np.eye(len(sizes.values))[size]) / (a + 1.0)
            np.testing.assert_allclose(beside[:, k], np.log(share[k] * kind * setting * large), atol=1e-9)
        alike = [k for k in terms if told[k] == told[first]]
        if alike:
            best = np.unravel_index(int(np.argmax(beside[:, terms])), (len(sizes.values), len(terms)))
            assert (int(best[0]), terms[int(best[1])]) == (size, alike[0])


def test_what_has_no_name_makes_no_other_place_likelier(listed: tuple[Catalogue, SelectionProblem]) -> None:
    """Nor one likelier than another: what else there is keeps its proportions, whatever its size."""
    cat, problem = listed
    cause, before = problem.spike_slab.terms.cause, logs(problem)
    nameless = [k for k, i in enumerate(problem.candidates) if not cat.named(i)]
    assert len({int(cause[k]) for k in nameless}) > 3
    for k in nameless:
        change = (logs(problem, (k, 4)) - before)[:, cause != cause[k]]
        assert change.max() <= 1e-12
        np.testing.assert_allclose(change, change[0, 0], atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_the_order_of_causes_is_nothing_to_the_prior_of_a_set(
    listed: tuple[Catalogue, SelectionProblem], seed: int
) -> None:
    """Taken one after the other or all at once, like ones and further terms of a cause among them."""
    problem, rng = listed[1], np.random.default_rng(seed)
    terms, slab = problem.spike_slab.terms, problem.spike_slab
    kinds = rng.choice(np.flatnonzero(terms.urn.number > 2), 2, replace=False)
    drawn: list[Member] = []
    for kind in (*kinds, *kinds, *kinds, int(np.argmin(terms.urn.number))):
        here = [k for k in np.flatnonzero(terms.kind == kind) if np.isfinite(logs(problem, *drawn)[0, k])]
        fresh = [k for k in here if terms.cause[k] not in terms.cause[[t for t, _ in drawn]]]
        drawn.append((int(rng.choice(fresh)), int(rng.integers(len(slab.sizes.values)))))
    orders: list[list[Member]] = [[drawn[k] for k in rng.permutation(len(drawn))] for _ in range(8)]
    steps = [
        sum(float(logs(problem, *order[:k])[size, term]) for k, (term, size) in enumerate(order))
        for order in orders
    ]
    np.testing.assert_allclose(steps, terms.log_prior_of(drawn), atol=1e-9)
    add = [
        k
        for k, t in enumerate(terms.all)
        if not t.alone and not terms.excludes[k, [m for m, _ in drawn]].any()
    ]
    further = [(int(k), int(rng.integers(len(slab.sizes.values)))) for k in rng.choice(add, 3, replace=False)]
    every = [[*drawn, *further][k] for k in rng.permutation(len(drawn) + len(further))]
    whole = sum(float(logs(problem, *every[:k])[size, term]) for k, (term, size) in enumerate(every))
    assert whole == pytest.approx(terms.log_prior_of([*further, *drawn]), abs=1e-9)
