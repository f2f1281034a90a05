"""Laws of terms and the grid together: where noise or tolerances stand in for a term, and what is plausible."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from support.linear_problems import (
    RICHNESS,
    UNKNOWNS,
    Dense,
    Enumerated,
    axis,
    catalogue_problem,
    enumerated,
    points,
    random_problem,
    single,
    spike_slab,
)
from truepose.identification.posterior import posterior as chains
from truepose.identification.posterior.design import Always, Axis, GridPoint, Term, Terms, Unknowns
from truepose.identification.posterior.posterior import sample
from truepose.identification.posterior.sampler import CERTAIN, HOPELESS, Chain, Plausible, plausible
from truepose.identification.posterior.spike_slab import Members, SpikeSlab
from truepose.identification.posterior.state import State, log_posterior, nearest_top, tops
from truepose.identification.prior import Richness, Sizes

FOUR = Richness((0.25,), (0.0,), 4)
ONE = Sizes(np.array([1.0]), np.array([0.0]))
READINGS, WIDE = 40, 5
RIVALS = ("noise", "widening")
HERE, THERE = (((0, 0),), 0), ((), 1)
"""Members, and the index on the rival's axis, of the two states that explain the readings."""


# -- rivals -----------------------------------------------------------------------------------------------------


def all_of(unknowns: Unknowns) -> range:
    """Every widening of a grid."""
    return range(len(unknowns.widening))


def rivals(name: str) -> tuple[SpikeSlab, Dense]:
    """Term 0, or the second value of an axis, explains a signal; either takes columns along for which both pay.

    So both at once, or neither, is out of the question, and the term is about as likely as its rival. Term 1 is a bystander.
    """
    rng = np.random.default_rng(1)
    signal, *rest = np.linalg.qr(rng.standard_normal((READINGS, 2 * WIDE - 1)))[0].T
    own = np.column_stack([20.0 * signal, *(99.0 * x for x in rest[: WIDE - 1])])
    other = np.column_stack([20.0 * signal, *(99.0 * x for x in rest[WIDE - 1 :])])
    base = Unknowns((axis(1.0),), ((1.0,),), (0.0,))
    always = Always(np.full(WIDE, 1e-3), np.zeros(WIDE, dtype=np.intp))
    noise = rng.standard_normal(READINGS)
    e = noise / np.std(noise) + 13.0 * signal
    if name == "noise":
        unknowns = replace(base, noise=(axis(1.0, 3.0),))
    else:
        unknowns = replace(base, widening=((1.0,), (1e3,)), log_widening=(-float(np.log(2.0)),) * 2)
    g = np.column_stack([own, rng.standard_normal(READINGS)])
    dense = Dense(e, np.zeros(READINGS, dtype=np.intp), other, g, always, unknowns)
    here, there = (GridPoint((k,), 0) if name == "noise" else GridPoint((0,), k) for k in (0, 1))
    even = log_posterior(_problem(dense, 0.0), FOUR, (), there)
    even -= log_posterior(_problem(dense, 0.0), FOUR, ((0, 0),), here)
    return _problem(dense, even + 0.5), dense


def _problem(dense: Dense, log_prior: float) -> SpikeSlab:
    """A wide term of some log prior, if nothing else is there, and a rare one; each a kind that is half of the prior."""
    half, urn = float(np.log(2.0)), single(1, 1, sizes=ONE).urn
    own = Term(tuple(range(WIDE)), 0, 0, log_prior + half, (-np.inf,) * WIDE, (np.inf,) * WIDE)
    bystander = Term((WIDE,), 1, 1, half - 3.0, (-np.inf,), (np.inf,))
    return SpikeSlab(dense.design, dense.unknowns, Terms([own, bystander], urn), ONE)


def on_axis(name: str, point: GridPoint) -> int:
    return point.noise[0] if name == "noise" else point.widening


def between(exact: Enumerated, name: str) -> float:
    """Probability of a state with both the term and its rival, or neither."""
    return sum(p for (m, point), p in exact.states.items() if (0 in dict(m)) == bool(on_axis(name, point)))


@pytest.mark.parametrize("name", RIVALS)
@pytest.mark.parametrize("start", [HERE, THERE])
def test_a_term_and_its_rival_on_the_grid_change_places(name: str, start: tuple[Members, int]) -> None:
    """All ways by a slot alone or an axis alone lead through states that have no mass to speak of: the joint draw has none
    of them to pass. 1-sigma of the share over seeds is 0.02 with 4,000 sweeps.
    """
    problem, dense = rivals(name)
    exact = enumerated(problem, FOUR, dense)
    assert 0.3 < exact.terms[0] < 0.7 and between(exact, name) < 1e-5
    members, at = start
    (point,) = (p for p in points(dense.unknowns) if on_axis(name, p) == at)
    sweeps = list(Chain(problem, FOUR, all_of(dense.unknowns), point, members, 1).sweeps(4000))
    held = [0 in dict(s.members) for s in sweeps]
    assert np.mean(held) == pytest.approx(exact.terms[0], abs=0.08)
    assert np.sum(np.diff(held)) > 100  # here and there in turn
    assert np.mean([1 in dict(s.members) for s in sweeps]) == pytest.approx(exact.terms[1], abs=0.02)
    assert np.mean([(0 in dict(s.members)) == bool(on_axis(name, s.point)) for s in sweeps]) < 0.01


# -- values that a draw chooses from ----------------------------------------------------------------------------


def chosen(chain: Chain, point: GridPoint, draw: str, number: int = 3000) -> Counter[frozenset[object]]:
    """How often each set of values is drawn from a point."""
    chain.point = point
    few: list[frozenset[object]] = []
    for _ in range(number):
        found = chain.noises() if draw == "noise" else chain.some_of(range(8), point.widening)
        assert len(set(found)) == len(found)
        few.append(frozenset(found))
    return Counter(few)


@pytest.mark.parametrize("draw", ["noise", "widening"])
def test_values_are_as_likely_chosen_from_each_of_them(draw: str) -> None:
    """So that what is drawn among them keeps the posterior. 1-sigma of a difference of counts is 40 at most."""
    eight = tuple((1.0 + k, 1.0) for k in range(8))
    noise = tuple(Axis(tuple(1.2**k for k in range(n)), (0.0,) * n) for n in (5, 3))
    unknowns = replace(UNKNOWNS, noise=noise, widening=eight, log_widening=(0.0,) * 8)
    dense = replace(random_problem(0), unknowns=unknowns)
    chain = Chain(spike_slab(dense), RICHNESS, all_of(unknowns), GridPoint((0, 0), 0), (), 1)
    ways = [p for p in points(unknowns) if p.widening == 0 or draw == "widening"]
    ways = [p for p in ways if p.noise == (0, 0) or draw == "noise"]
    counts = {p if draw == "noise" else p.widening: chosen(chain, p, draw) for p in ways}
    several = {few for found in counts.values() for few in found if len(few) > 1}
    assert len(several) >= 15
    for few in several:
        own = [counts[value][few] for value in few]  # type: ignore[index]
        assert min(own) > 0 and max(own) - min(own) < 200
    for value, found in counts.items():
        assert all(value in few for few in found)  # the present one is always among them


# -- ascents on the grid ------------------------------------------------------------------------------------------


def neighbours(unknowns: Unknowns, point: GridPoint) -> list[GridPoint]:
    """A step of all noises or of one, and any widening."""
    steps = [point.louder(k) for k in (-1, 1)]
    steps += [
        point.with_noise(kind, point.noise[kind] + k) for kind in range(len(point.noise)) for k in (-1, 1)
    ]
    steps += unknowns.all_widenings(point)
    return [p for p in steps if unknowns.holds(p)]


@pytest.mark.parametrize("seed", range(6))
def test_an_ascent_ends_where_no_coordinate_gains(seed: int) -> None:
    noise = tuple(Axis(tuple(0.5 * 1.15**k for k in range(n)), (0.0,) * n) for n in (14, 12))
    dense = replace(random_problem(seed), unknowns=replace(UNKNOWNS, noise=noise))
    problem, ends = spike_slab(dense), set[GridPoint]()
    for members in ((), ((0, 1),), ((0, 0), (3, 1))):
        for start in (GridPoint((0, 0), 0), GridPoint((13, 11), 2), GridPoint((2, 9), 1)):
            end = nearest_top(problem, start, members)
            here = problem.log_evidence(end, members)
            near = [problem.log_evidence(p, members) for p in neighbours(dense.unknowns, end)]
            assert here >= max(near) and here > problem.log_evidence(start, members)
            quick = nearest_top(problem, start, members, thorough=False)
            assert problem.log_evidence(quick, members) >= problem.log_evidence(start, members)
            assert quick.widening == start.widening
            ends.add(end)
    assert len(ends) > 1  # members tell


# -- what is plausible --------------------------------------------------------------------------------------------


def missed(around: Plausible, exact: Enumerated, unknowns: Unknowns) -> dict[tuple[str, int], float]:
    """Terms and values of the grid that are left out, with their probability where it is above that of hopeless ones."""
    out = {("term", k): float(p) for k, p in enumerate(exact.terms) if not around.terms[k]}
    for k in set(all_of(unknowns)) - set(around.widenings):
        out["widening", k] = sum(p for point, p in exact.points.items() if point.widening == k)
    return out


def log_odds_of(term: int, exact: Enumerated) -> float:
    without = sum(p for (members, _), p in exact.states.items() if term not in dict(members))
    return float(np.log1p(-without) - np.log(without))


def far(seed: int) -> tuple[SpikeSlab, Dense]:
    """Geometry far outside its tolerances, or well inside of the widest ones, so that some values of the grid are out of the
    question; and terms of which each alone is hopeless where the readings do not ask for it."""
    dense = catalogue_problem(seed, strength=2.0, terms=5)
    if seed % 2:
        dense = replace(dense, e=dense.e + 60.0 * dense.a[:, 0])
    wide = replace(dense.unknowns, widening=((1.0,), (4.0,), (4000.0,)), log_widening=(-0.7, -1.4, -1.4))
    dense = replace(dense, unknowns=wide)
    terms = single(*[1] * 5)
    rare = [replace(t, log_share=float(np.log(5.0)) - 5.0) for t in terms.all]
    return spike_slab(dense, Terms(rare, terms.urn)), dense


def test_nothing_plausible_is_left_out() -> None:
    """As conditionals around one state tell it, which are not the whole posterior: what this gives e times as much as
    hopeless things is kept."""
    kinds = set[str]()
    for seed in range(10):
        problem, dense = far(seed)
        exact = enumerated(problem, RICHNESS, dense)
        around = plausible(problem, RICHNESS, [tops(problem, RICHNESS)[0]])
        out = missed(around, exact, dense.unknowns)
        assert max(out.values(), default=0.0) < np.exp(1.0 - HOPELESS)
        assert max((p for (kind, _), p in out.items() if kind != "term"), default=0.0) < np.exp(-CERTAIN / 2)
        kinds |= {kind for kind, _ in out}
    assert kinds == {"term", "widening"}  # something is left out


@pytest.mark.parametrize(("strength", "one_point"), [(4.0, True), (2.0, False)])
def test_what_is_certain_has_no_rival(strength: float, one_point: bool) -> None:
    """All sets with and without it counted, at its point or at every noise, in any tolerances."""
    one = Unknowns((axis(1.0),), ((1.0,),), (0.0,))
    seen = 0
    for seed in range(14):
        dense = catalogue_problem(seed, strength=strength, terms=4)
        if one_point:
            dense = replace(dense, unknowns=one)
        problem = spike_slab(dense)
        exact = enumerated(problem, RICHNESS, dense)
        for term, _ in plausible(problem, RICHNESS, [tops(problem, RICHNESS)[0]]).certain:
            assert log_odds_of(term, exact) > CERTAIN
            seen += 1
    assert seen > 5 or not one_point


@pytest.mark.parametrize("name", RIVALS)
@pytest.mark.parametrize("start", [HERE, THERE])
def test_the_posterior_knows_a_term_and_its_rival(
    monkeypatch: pytest.MonkeyPatch, name: str, start: tuple[Members, int]
) -> None:
    """Whichever of both is known at first; both are plausible around either."""
    monkeypatch.setattr(chains, "AGREED", -1.0)
    problem, dense = rivals(name)
    exact = enumerated(problem, FOUR, dense)
    (point,) = (p for p in points(dense.unknowns) if on_axis(name, p) == start[1])
    known = [State(start[0], point, 0.0)]
    around = plausible(problem, FOUR, known)
    assert not around.certain
    assert max(missed(around, exact, dense.unknowns).values(), default=0.0) < np.exp(1.0 - HOPELESS)
    found = sample(problem, FOUR, seed=1, known=known, rounds=20)
    assert found.terms.get(0, 0.0) == pytest.approx(exact.terms[0], abs=0.08)
