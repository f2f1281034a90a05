"""What is counted of sweeps, and what a posterior's states and classes say: small ones written out."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from support.linear_problems import catalogue_problem, single, spike_slab
from truepose.arrays import Array
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.posterior import Posterior, Tally, mode
from truepose.identification.posterior.sampler import Sweep, Visit
from truepose.identification.posterior.spike_slab import SpikeSlab
from truepose.identification.posterior.state import State, typical

POINT = GridPoint((1,), 0)


def visit(*terms: float, filled: bool = True) -> Visit:
    return Visit(np.array(terms), filled)


def test_visits_are_summed_and_full_slots_tell_what_stands_beside_what() -> None:
    """By causes, of which the first has two terms; an empty slot counts for terms alone."""
    problem = spike_slab(catalogue_problem(0), single(*[1] * 6, causes=[0, 0, 1, 2, 3, 4]))
    tally = Tally(problem)
    tally.add(Sweep(((4, 1), (0, 0)), POINT, (visit(0.3, 0.2, 0.4, 0, 0, 0), visit(0, 0, 0, 0, 0.9, 0))))
    tally.add(Sweep((), POINT, (visit(0.1, 0.0, 0, 0.2, 0, 0, filled=False),)))
    np.testing.assert_allclose(tally.terms, [0.4, 0.2, 0.4, 0.2, 0.9, 0.0])
    np.testing.assert_allclose(tally.causes, np.array([0.6, 0.4, 0.2, 0.9, 0.0]) / 2.0)
    np.testing.assert_allclose(tally.held, [0.5, 0.4, 0.0, 0.9, 0.0])
    expected = np.zeros((5, 5))
    expected[:2, :2] = np.outer([0.5, 0.4], [0.5, 0.4])
    expected[3, 3] = 0.81
    np.testing.assert_allclose(tally.beside, expected)
    assert tally.draws == [(((0, 0), (4, 1)), POINT), ((), POINT)] and tally.sweeps == 2


def test_what_is_given_is_held_in_every_sweep_and_no_cause_is_surer_than_certain() -> None:
    problem = spike_slab(catalogue_problem(0)).conditioned([(2, 1)])
    tally = Tally(problem)
    for _ in range(3):
        tally.add(Sweep(((5, 0),), POINT, (visit(0, 0, 0, 0, 0, 0.8), visit(0, 0, 0, 0, 0, 0.7))))
    np.testing.assert_allclose(tally.causes, [0, 0, 1.0, 0, 0, 1.0])
    assert tally.terms[2] == 3.0 and tally.held[2] == 3.0 and tally.beside[2, 2] == 3.0
    assert set(tally.draws) == {(((2, 1), (5, 0)), POINT)}


# -- classes and the mode -----------------------------------------------------------------------------------------


def posterior(causes: list[float], beside: Array, *states: tuple[State, float]) -> Posterior:
    return Posterior({}, np.array(causes), beside, states, (), 0.0, 1)


def test_a_slot_holds_a_cause_or_what_stands_in_for_it() -> None:
    """A cause that no slot was seen with counts for itself, and so does one that fills its slot in few of the states."""
    beside = np.array([[0.5, 0.4, 0.0], [0.0, 0.0, 0.0], [0.0, 0.03, 0.97]])
    np.testing.assert_allclose(posterior([0.3, 0.6, 0.1], beside).slots, [0.9, 0.6, 0.1])


def state(*terms: int, log_posterior: float = 0.0) -> State:
    return State(tuple((term, 0) for term in terms), POINT, log_posterior)


SLAB = cast(SpikeSlab, SimpleNamespace(terms=SimpleNamespace(cause=np.arange(4))))


def test_the_mode_is_the_state_of_what_is_there_more_often_than_not() -> None:
    """Whatever its own share; of states that agree as well the likelier one."""
    alone = np.diag([0.9, 0.7, 0.3, 0.1])
    causes = [0.9, 0.7, 0.3, 0.1]
    states = [(state(0, 2), 0.5), (state(0, 1), 0.2), (state(0, 1, 2), 0.2), (state(1), 0.1)]
    assert mode(posterior(causes, alone, *states), SLAB) == state(0, 1)
    other = State(((0, 0), (1, 0)), GridPoint((1,), 1), 2.0)
    assert mode(posterior(causes, alone, *states, (other, 0.05)), SLAB) == other


def test_of_a_class_one_stands_for_all_and_a_second_must_be_there_beside_it() -> None:
    """Two causes share a slot that is full; both at once are no likelier for that."""
    beside = np.array([[0.55, 0.4, 0, 0], [0.5, 0.45, 0, 0], [0, 0, 0.2, 0], [0, 0, 0, 0.2]])
    causes = [0.55, 0.42, 0.2, 0.2]
    states = [(state(0), 0.3), (state(1), 0.3), (state(0, 1), 0.3), (state(), 0.1)]
    assert mode(posterior(causes, beside, *states), SLAB) == state(0)
    both = [0.99, 0.97, 0.2, 0.2]
    assert mode(posterior(both, beside, *states), SLAB) == state(0, 1)


def test_typical_states_stand_for_equal_parts_of_the_posterior() -> None:
    """Each as often as its share has it, and never one beyond the last."""
    states = [(state(k), share) for k, share in enumerate((0.4, 0.35, 0.15))]  # shares may not add up to one
    for number in (1, 2, 9, 24):
        found = typical(states, number)
        assert sum(share for _, share in found) == pytest.approx(1.0)
        assert {s for s, _ in found} <= {s for s, _ in states}
    shares = {s.members[0][0]: share for s, share in typical(states, 9)}
    assert shares == pytest.approx({0: 4 / 9, 1: 4 / 9, 2: 1 / 9}, abs=1 / 9)
