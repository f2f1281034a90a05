"""Laws of the places of a family: what each is worth, and what may stand in for it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from support.effect_machines import read_machines
from support.effects import with_effect
from support.linear_models import READINGS, catalogue_of, linear, shifts_of, unit
from truepose.identification.diagnosis import prior
from truepose.identification.diagnosis.places import at_places
from truepose.identification.diagnosis.weighed import Cause, weighed
from truepose.identification.posterior.mode import State, slot_odds
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine import Machine


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    folder: Path = tmp_path_factory.getbasetemp() / "weighed_laws"
    return read_machines(folder)["arm"]


@pytest.fixture(scope="module")
def shifts(arm: Machine) -> tuple[PlacedEffect, ...]:
    return shifts_of(arm)


@pytest.mark.parametrize("sizes", [(0.6, 0.5, 0.0), (0.6, 0.15, 0.2), (0.0, 0.0, 0.6)])
def test_places_of_a_family_are_worth_the_ratio_of_densities_with_and_without(
    shifts: tuple[PlacedEffect, ...], sizes: tuple[float, ...]
) -> None:
    """By Savage and Dickey, against the evidence of the family with and without the place, counted in full."""
    lin, j, g, e = linear(shifts[:3], 6, sizes=sizes)
    problem = weighed(lin, catalogue_of(shifts[:3]), 1.5)
    term = problem.candidates.index((0, 1, 2))
    point, size = unit(problem), int(np.argmin(np.abs(problem.weighing.sizes.values - 0.3)))
    number = int(problem.weighing.terms.cause[term])
    found = at_places(problem, State(((term, size),), point, 0.0), number)
    noise = problem.weighing.unknowns.noise[0].values[point[0]]
    spread = float(problem.weighing.sizes.values[size])

    def dense(present: list[int]) -> float:
        v = noise**2 * np.eye(READINGS) + j @ j.T + spread**2 * g[:, present] @ g[:, present].T
        return float(multivariate_normal.logpdf(e, cov=v))

    for k, joint in enumerate(("q1", "q2", "q3")):
        rest = [i for i in range(3) if i != k]
        odds = np.exp(dense([0, 1, 2]) - dense(rest)) * prior.IN_FAMILY / (1.0 - prior.IN_FAMILY)
        assert found["zero-shift", (joint,)].probability == pytest.approx(odds / (1.0 + odds), abs=1e-6)
        assert not found["zero-shift", (joint,)].rivals


@pytest.mark.parametrize("size", [0.6, 0.3])
def test_what_may_stand_in_for_a_place_of_a_family_takes_its_share(
    arm: Machine, shifts: tuple[PlacedEffect, ...], size: float
) -> None:
    """Every set of the family with or without its place, and with or without one other cause, counted in full."""
    placed = (*shifts[:3], with_effect(arm, "actuator-scale", ("q1",)))
    lin, j, g, e = linear(placed, 6, sizes=(size, 0.5, 0.0))
    g[:, 3] = g[:, 0] + 0.1 * g[:, 3]
    mixed = np.eye(len(lin.gram))
    mixed[lin.free, lin.free + 3], mixed[lin.free + 3, lin.free + 3] = 1.0, 0.1
    lin = replace(lin, grams=(mixed.T @ lin.gram @ mixed,))
    problem = weighed(lin, catalogue_of(placed), 1.5)
    weighing, point = problem.weighing, unit(problem)
    term, other = problem.candidates.index((0, 1, 2)), problem.candidates.index((3,))
    spread = int(np.argmin(np.abs(weighing.sizes.values - 0.3)))
    found = at_places(problem, State(((term, spread),), point, 0.0), int(weighing.terms.cause[term]))[
        "zero-shift", ("q1",)
    ]
    noise = weighing.unknowns.noise[0].values[point[0]]

    def dense(present: list[int], further: float = 0.0) -> float:
        v = (
            noise**2 * np.eye(READINGS)
            + j @ j.T
            + weighing.sizes.values[spread] ** 2 * g[:, present] @ g[:, present].T
        )
        return float(multivariate_normal.logpdf(e, cov=v + further**2 * np.outer(g[:, 3], g[:, 3])))

    def with_other(present: list[int]) -> float:
        before = slot_odds(prior.RICHNESS, 1) + weighing.terms.log_prior([term])[other]
        seen = np.flatnonzero(weighing.noticeable[:, other])
        each = [dense(present, float(weighing.sizes.values[s])) + weighing.sizes.log_prior[s] for s in seen]
        return float(np.logaddexp.reduce(each) + before)

    inside = np.log(prior.IN_FAMILY / (1.0 - prior.IN_FAMILY))
    rest, whole = [1, 2], [0, 1, 2]
    weights = np.array([dense(rest), with_other(rest), dense(whole) + inside, with_other(whole) + inside])
    nothing, instead, place, both = np.exp(weights - np.logaddexp.reduce(weights))
    assert found.probability == pytest.approx(place + both, abs=1e-6)
    (cause, share), *more = found.rivals.items()
    assert cause == Cause("actuator-scale", ("q1",)) and not more
    assert share == pytest.approx(
        instead - nothing * both / place, abs=1e-6
    )  # what it gains where the place is not there
    assert nothing + instead == pytest.approx(1.0 - found.probability, abs=1e-6)


def test_places_of_a_family_of_a_kin_are_weighed_each_as_its_own_effect(arm: Machine) -> None:
    """By evidence of the family with and without the place, counted in full; what it holds is no rival of itself."""
    joints = [with_effect(arm, "joint-compliance", (q,)) for q in ("q1", "q2", "q3")]
    placed = (*joints, with_effect(arm, "gravity-sag", ("base",)))
    lin, j, g, e = linear(placed, 6, sizes=(0.6, 0.1, 0.0, 0.5))
    problem = weighed(lin, catalogue_of(placed), 1.5)
    term, point = problem.candidates.index((0, 1, 2, 3)), unit(problem)
    size = int(np.argmin(np.abs(problem.weighing.sizes.values - 0.3)))
    found = at_places(problem, State(((term, size),), point, 0.0), int(problem.weighing.terms.cause[term]))
    assert list(found) == [
        *(("joint-compliance", (q,)) for q in ("q1", "q2", "q3")),
        ("gravity-sag", ("base",)),
    ]
    noise = problem.weighing.unknowns.noise[0].values[point[0]]
    spread = float(problem.weighing.sizes.values[size])

    def dense(present: list[int]) -> float:
        v = noise**2 * np.eye(READINGS) + j @ j.T + spread**2 * g[:, present] @ g[:, present].T
        return float(multivariate_normal.logpdf(e, cov=v))

    for k, one in enumerate(found.values()):
        odds = np.exp(dense([0, 1, 2, 3]) - dense([i for i in range(4) if i != k]))
        assert one.probability >= 0.95 * odds / (1.0 + odds) and not one.rivals
