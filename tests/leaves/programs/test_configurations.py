"""Status and turn, quadrants: which joints they mean, on either side of each border, and how they are written anew."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from truepose.identification.leaves.programs.configurations import Configuration, Quadrants, StatusTurn

SLACK, HAIR = np.radians([0.05, 0.01])
"""rad: as much as rounding to a tenth of a degree may move a joint, and a little."""
ROUNDING = 1e-14


def at(axis: int, value: float, others: float) -> np.ndarray:
    """Six joints, one of them (from 1) at a value."""
    q = np.full(6, others)
    q[axis - 1] = value
    return q


@pytest.mark.parametrize("axis", range(1, 7))
def test_a_bit_of_the_turn_is_set_where_its_axis_is_below_zero(axis: int) -> None:
    bit = 1 << (axis - 1)
    rows = np.array([at(axis, v, 1.0) for v in (0.5, SLACK + HAIR, HAIR, -HAIR, -SLACK - HAIR, -0.5)])
    assert StatusTurn().fits((0.0, 0.0), rows).tolist() == [True, True, True, True, False, False]
    assert StatusTurn().fits((0.0, float(bit)), rows).tolist() == [False, False, True, True, True, True]
    # the other axes have to fit as well
    assert not StatusTurn().fits((0.0, float(bit ^ 63)), rows).any()


@pytest.mark.parametrize("axis", [1, 2, 3, 4, 6])
def test_an_axis_that_passed_zero_changes_its_bit_and_no_other(axis: int) -> None:
    bit, more = 1 << (axis - 1), 64  # bits beyond the sixth are of external axes
    for others, turn in ((1.0, 0), (-1.0, 63)):
        was = float(turn | more)
        for value in (0.3, -0.3, 1e-10, -1e-10):
            now = (turn | bit if value < 0 else turn & ~bit) | more
            assert StatusTurn().renewed((5.0, was), at(axis, value, others)) == (5.0, float(now))
        # zero itself, within rounding, is on the side where it was
        for value in (ROUNDING, 0.0, -ROUNDING):
            assert StatusTurn().renewed((5.0, was), at(axis, value, others)) == (5.0, was)


def test_axis_5_does_not_pass_zero() -> None:
    """The wrist is singular there: the robot would be in another configuration."""
    assert StatusTurn().renewed((2.0, 0.0), at(5, -0.01, 1.0)) is None
    assert StatusTurn().renewed((2.0, 16.0), at(5, 0.01, 1.0)) is None
    assert StatusTurn().renewed((2.0, 16.0), at(5, -0.01, 1.0)) == (2.0, 16.0)


@pytest.mark.parametrize(
    ("configuration", "numbers"),
    [
        (StatusTurn(), lambda a, b, c: (float(a + 2 * b + 4 * c), 35.0)),
        (StatusTurn(), lambda a, b, c: (float(a + 2 * b + 4 * c + 16), 35.0)),  # bits that newer controllers add
        (Quadrants(), lambda a, b, c: (0.0, -1.0, 1.0, float(4 * a + 2 * b + c))),
    ],
)  # fmt: skip
def test_shapes_are_told_by_their_bits(configuration: Configuration, numbers: object) -> None:
    """Wrist behind axis 1, wrist behind the lower arm, axis 5 below zero: each shape has numbers of its own."""
    assert callable(numbers)
    shapes = np.array(list(product((False, True), repeat=3)))
    for k, shape in enumerate(shapes.tolist()):
        assert np.flatnonzero(configuration.decides(numbers(*shape), shapes)).tolist() == [k]


@pytest.mark.parametrize(("place", "axis"), [(0, 1), (1, 4), (2, 6)])
def test_quadrants_count_quarter_turns_from_zero(place: int, axis: int) -> None:
    """Quadrant 0 is 0 to 90 deg, -1 is -90 to 0 deg; either may be taken for a joint on the border."""
    for quadrant in (-4, -2, -1, 0, 1, 3):
        numbers = [0.0, 0.0, 0.0, 0.0]
        numbers[place] = float(quadrant)
        low, high = np.radians([90 * quadrant, 90 * (quadrant + 1)])
        inside = [low - HAIR, low + HAIR, low + 0.7, high - HAIR, high + HAIR]
        outside = [low - SLACK - HAIR, high + SLACK + HAIR, low - 1.0, high + 1.0]
        rows = np.array([at(axis, v, 0.5) for v in (*inside, *outside)])
        assert Quadrants().fits(tuple(numbers), rows).tolist() == [True] * 5 + [False] * 4


@pytest.mark.parametrize(("place", "axis"), [(0, 1), (1, 4), (2, 6)])
def test_a_quadrant_is_written_anew_where_its_axis_left_it(place: int, axis: int) -> None:
    numbers, now = [0.0, 0.0, 0.0, 5.0], [0.0, 0.0, 0.0, 5.0]
    moves = [(1, 1.5, 0), (1, 1.6, 1), (1, 3.2, 2), (-1, 0.1, 0), (-1, -1.6, -2), (3, 4.71, 2)]
    for before, value, after in moves:
        numbers[place], now[place] = float(before), float(after)
        assert Quadrants().renewed(tuple(numbers), at(axis, value, 0.5)) == tuple(now)
    # on the border, within rounding, either quadrant stays
    for before in (-1, 0):
        numbers[place] = now[place] = float(before)
        for value in (ROUNDING, 0.0, -ROUNDING):
            assert Quadrants().renewed(tuple(numbers), at(axis, value, 0.5)) == tuple(now)
    for before in (0, 1):
        numbers[place] = now[place] = float(before)
        assert Quadrants().renewed(tuple(numbers), at(axis, np.pi / 2, 0.5)) == tuple(now)
