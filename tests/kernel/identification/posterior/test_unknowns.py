"""The grid of what is not known, designs that are cut and turned, and what is remembered of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.linear_problems import (
    RICHNESS,
    UNKNOWNS,
    catalogue_problem,
    points,
    random_problem,
    single,
    spike_slab,
)
from truepose.identification.posterior import spike_slab as remembering
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.halves import cholesky, half_log_det, solved, taken
from truepose.identification.posterior.spike_slab import Memory
from truepose.identification.posterior.state import State, best_point, log_posterior, slot_odds, supports
from truepose.identification.prior import RATIO_DOUBT

# -- the grid -----------------------------------------------------------------------------------------------------


def test_a_grid_holds_its_points_and_no_others() -> None:
    every = points(UNKNOWNS)
    assert len(every) == len(set(every)) == 3 * 2 * 3
    for noise in range(-1, 4):
        for at in range(-1, 4):
            for point in (GridPoint((noise, 1), at), GridPoint((1, noise), at)):
                assert UNKNOWNS.holds(point) == (point in every)


def test_a_point_of_another_grid_is_moved_onto_this_one() -> None:
    """No farther than it must be: what is on the grid stays."""
    for point in points(UNKNOWNS):
        assert UNKNOWNS.nearest(point) == point
    assert UNKNOWNS.nearest(GridPoint((7, 7), 9)) == GridPoint((2, 1), 2)
    assert UNKNOWNS.nearest(GridPoint((7, 0), 1)) == GridPoint((2, 0), 1)
    assert UNKNOWNS.nearest(GridPoint((0, 5), 9)) == GridPoint((0, 1), 2)
    assert UNKNOWNS.all_at(2) == GridPoint((2, 1), 0)  # an axis that is shorter ends earlier
    assert UNKNOWNS.all_at(0, 1) == GridPoint((0, 0), 1)


def test_all_widenings_of_a_point_are_those_that_differ_from_it_in_nothing_else() -> None:
    for point in points(UNKNOWNS):
        found = UNKNOWNS.all_widenings(point)
        assert found == [p for p in points(UNKNOWNS) if p.noise == point.noise]
        assert found[point.widening] == point == point.widened(point.widening)


def test_the_first_noise_pays_for_itself_and_others_for_what_they_differ_by() -> None:
    for point in points(UNKNOWNS):
        first, second = np.log(UNKNOWNS.scales(point))
        own = UNKNOWNS.noise[0].log_prior[point.noise[0]] + float(RATIO_DOUBT.log_prior(second - first))
        own += UNKNOWNS.log_widening[point.widening]
        assert UNKNOWNS.log_prior(point) == pytest.approx(own)


# -- designs ------------------------------------------------------------------------------------------------------


def test_a_design_of_some_columns_or_of_combinations_is_that_of_such_readings() -> None:
    dense = random_problem(3)
    design, some = dense.design, np.array([4, 1, 6])
    part = design.restricted(some)
    turn = np.random.default_rng(1).standard_normal((3, 2))
    turned = design.turned(some, turn)
    for kind in (0, 1):
        own = dense.kind == kind
        a, g, e = dense.a[own], dense.g[own][:, some], dense.e[own]
        for found, columns in ((part, g), (turned, g @ turn)):
            rows = np.column_stack([a, columns, e])
            np.testing.assert_allclose(found.grams[kind], rows.T @ rows, atol=1e-9)
            assert (found.n, found.width) == (design.n, columns.shape[1])
            assert found.counts == design.counts
    assert part.seen.all() and design.seen.all()


@pytest.mark.parametrize(("left", "seen"), [(1e-3, True), (1e-6, False), (0.0, False)])
def test_a_column_that_is_all_but_one_without_a_prior_is_not_seen(left: float, seen: bool) -> None:
    """Where less than a billionth of its square is left; nor is a column of nothing."""
    dense = random_problem(5)
    flat = int(np.flatnonzero(~np.isfinite(dense.always.sigma))[0])
    g = dense.g.copy()
    g[:, 2] = 1e4 * (dense.a[:, flat] + left * g[:, 3])
    g[:, 5] = 0.0
    found = replace(dense, g=g).design.seen
    assert found.tolist() == [True, True, seen, True, True, False, True]


# -- triangular factors -------------------------------------------------------------------------------------------


def test_factors_solve_and_weigh_as_dense_algebra_does() -> None:
    rng = np.random.default_rng(2)
    rows = rng.standard_normal((9, 4))
    among, scores, sizes = rows.T @ rows, rng.standard_normal(4), rng.uniform(0.2, 2.0, 4)
    inside = np.eye(4) + sizes[:, None] * among * sizes
    factor, turned, gain = taken(among.copy(), scores, sizes)
    np.testing.assert_allclose(np.tril(factor) @ np.tril(factor).T, inside)
    np.testing.assert_allclose(np.tril(factor) @ turned, sizes * scores)
    t = sizes * scores
    expected = 0.5 * t @ np.linalg.solve(inside, t) - 0.5 * np.linalg.slogdet(inside)[1]
    assert gain == pytest.approx(expected)
    assert half_log_det(factor) == pytest.approx(0.5 * np.linalg.slogdet(inside)[1])
    right = rng.standard_normal((4, 3))
    np.testing.assert_allclose(np.tril(factor) @ solved(factor, right), right, atol=1e-12)
    assert solved(factor, np.zeros((4, 0))).shape == (4, 0)
    with pytest.raises(np.linalg.LinAlgError, match="pivot 2 is not positive"):
        cholesky(np.array([[1.0, 2.0], [2.0, 1.0]]))


# -- states -------------------------------------------------------------------------------------------------------


def test_the_likeliest_noise_without_any_term_is_the_best_point() -> None:
    for seed in range(5):
        problem = spike_slab(catalogue_problem(seed))
        found = best_point(problem)
        assert found.widening == 0
        evidence = [problem.root(GridPoint((k,), 0)).log_evidence for k in range(3)]
        assert found.noise[0] == int(np.argmax(evidence))


def test_support_is_what_is_lost_without_columns_at_the_noise_that_suits_each() -> None:
    """Dense evidence with and without, over the noises around."""
    dense = catalogue_problem(1, strength=2.0)
    problem = spike_slab(dense)
    members = ((0, 1), (3, 0), (4, 1))
    state = State(members, GridPoint((1,), 0), 0.0)
    sizes = [1.0, 0.3, 1.0]

    def best(kept: list[int]) -> float:
        return max(
            dense.log_evidence(GridPoint((k,), 0), [(0, 3, 4)[i] for i in kept], [sizes[i] for i in kept])
            for k in range(3)
        )

    found = supports(problem, state, [np.array([0]), np.array([1, 2]), np.array([0, 1, 2])])
    expected = [best([0, 1, 2]) - best(rest) for rest in ([1, 2], [0], [])]
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_the_posterior_of_a_state_is_its_evidence_and_the_priors_of_its_members_and_of_their_number() -> None:
    dense = catalogue_problem(2)
    problem = spike_slab(dense, single(*[1] * 6))
    for members in ((), ((1, 1),), ((1, 1), (4, 0))):
        point = GridPoint((1,), 0)
        own = dense.log_evidence(point, [t for t, _ in members], [(0.3, 1.0)[s] for _, s in members])
        number = sum(slot_odds(RICHNESS, k) for k in range(len(members)))
        found = log_posterior(problem, RICHNESS, members, point)
        empty = log_posterior(problem, RICHNESS, (), point) - dense.log_evidence(point)
        assert found - own == pytest.approx(number + problem.log_prior(members) + empty, abs=1e-6)
    given = problem.conditioned([(0, 1)])
    both = log_posterior(problem, RICHNESS, ((0, 1), (2, 1)), point) - log_posterior(
        problem, RICHNESS, ((0, 1),), point
    )
    beside = log_posterior(given, RICHNESS, ((2, 1),), point) - log_posterior(given, RICHNESS, (), point)
    assert beside == pytest.approx(both, abs=1e-6)


# -- what is remembered -------------------------------------------------------------------------------------------


def test_several_values_are_made_at_once_where_they_are_not_there() -> None:
    memory, asked = Memory[str](4), list[list[int]]()

    def make(new: object) -> list[str]:
        asked.append(list(new))  # type: ignore[call-overload]
        return [f"new {k}" for k in asked[-1]]

    assert memory.get_all(["a", "b"], make) == ["new 0", "new 1"]
    assert memory.get_all(["a", "c", "b", "d"], make) == ["new 0", "new 1", "new 1", "new 3"]
    assert asked == [[0, 1], [1, 3]]
    assert memory.get_all(["a", "b"], make) == ["new 0", "new 1"] and len(asked) == 2


def test_no_more_is_kept_than_fits_into_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """By what values take when they are asked for; what is asked for stays, however large."""
    monkeypatch.setattr(remembering, "REMEMBERED", 100)
    sizes, made = {"a": 40, "b": 40, "c": 10, "d": 500}, list[str]()
    memory = Memory[str](10, lambda key: sizes[key])

    def ask(key: str) -> None:
        def make() -> str:
            made.append(key)
            return key

        assert memory.get_or(key, make) == key

    for key in "abcabc":
        ask(key)
    assert made == ["a", "b", "c"]
    sizes["b"] = 80  # grown: 'a', which was asked for last but one before it, goes
    ask("b")
    ask("b")
    ask("c")
    assert made == ["a", "b", "c"]
    ask("a")
    assert made == ["a", "b", "c", "a"]
    ask("d")
    ask("d")
    assert made == ["a", "b", "c", "a", "d"]
