"""Directions that no reading sees, in words: alone or together, in which proportion, and who decides."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from truepose.identification.fit.decomposition import Decomposition
from truepose.identification.identifiability.observability import Direction, Knowledge
from truepose.identification.identifiability.patterns import Blind, Pattern
from truepose.identification.report.unseen_words import grouped, meaning, terms, unseen_sentences

LENGTHS = (
    "base.z",
    "q1.r",
    "q2.r",
    "q3.r",
    "q4.r",
    "q5.r",
    "q6.r",
    "leg1.a.x",
    "leg2.a.x",
    "leg3.a.x",
    "leg1.b",
)
TURNS = ("base.rz", "q1.theta", "gain")
UNITS = ("mm",) * len(LENGTHS) + ("rad", "rad", "1")
NAMES = LENGTHS + TURNS


def knowledge() -> Knowledge:
    n = len(NAMES)
    none = Decomposition.of(np.zeros((0, n)), np.ones(n))
    return Knowledge(NAMES, UNITS, np.zeros(n), np.ones(n), np.ones(n), none)


def said(*directions: Direction, patterns: Sequence[Pattern] = ()) -> list[str]:
    return unseen_sentences(Blind(knowledge(), directions, tuple(patterns)))


def alone(name: str, open_ended: bool = False) -> Direction:
    return Direction({name: 1.0}, open_ended=open_ended)


def test_what_is_unseen_alone_is_told_once_for_those_that_a_tolerance_holds_and_once_for_others() -> None:
    assert said(alone("q2.r")) == ["q2.r alone: no reading changes when it moves; its tolerance decides"]
    assert said(alone("q2.r", True)) == [
        "q2.r alone: no reading changes when it moves; nothing decides, it stays at the drawing"
    ]
    several = said(alone("gain", True), alone("base.rz"), alone("base.z", True), alone("q1.r"))
    assert several == [
        "q1.r and base.rz, each alone: no reading changes when one of them moves; tolerances decide",
        "base.z and gain, each alone: no reading changes when one of them moves; nothing decides, they stay at the drawing",
    ]


def test_few_that_trade_are_told_with_what_is_seen_of_them() -> None:
    one = Direction({"base.z": 1.0, "q1.r": -1.0})
    assert said(one) == [
        "base.z and q1.r trade with each other: only one combination of the two is seen"
        " (base.z +1 mm, q1.r -1 mm); tolerances decide"
    ]
    wide = Direction({"base.z": 2.0, "q1.r": -1.0, "q2.r": 1.0})
    assert said(wide) == [
        "base.z, q1.r and q2.r trade with each other: only two combinations of the three are seen"
        " (base.z +1 mm, q1.r -0.5 mm, q2.r +0.5 mm); tolerances decide"
    ]
    chained = said(one, Direction({"q1.r": 1.0, "q2.r": 3.0}, open_ended=True))
    assert chained == [
        "base.z, q1.r and q2.r trade with each other: only one combination of the three is seen"
        " (base.z +1 mm, q1.r -1 mm; q1.r +1 mm, q2.r +3 mm); tolerances decide"
    ]
    both = [Direction({"q1.r": 1.0, "q2.r": 0.5}, open_ended=True), Direction({"q1.r": 1.0, "q2.r": -0.5})]
    assert said(*both) == [
        "q1.r and q2.r: no reading changes when they move; nothing decides, they stay at the drawing"
    ]


@pytest.mark.parametrize("count", [6, 7])
def test_blocks_of_more_than_six_are_told_by_their_directions(count: int) -> None:
    direction = Direction(dict.fromkeys(LENGTHS[:count], 1.0))
    (text,) = said(direction)
    if count == 6:
        assert text.startswith(
            f"{', '.join(LENGTHS[:5])} and {LENGTHS[5]} trade with each other: only five combinations of the six"
        )
    else:
        assert text == "moving base.z, q1..q6 r +1 mm changes no reading; tolerances decide"


def test_blocks_that_share_a_parameter_are_one_and_others_are_not() -> None:
    """Whichever comes first."""
    a, b, c = (Direction({x: 1.0, y: 1.0}) for x, y in (("q1.r", "q2.r"), ("q3.r", "q4.r"), ("q2.r", "q3.r")))
    assert len(said(a, b)) == 2
    for order in ((a, b, c), (c, b, a), (a, c, b)):
        (text,) = said(*order)
        assert "only one combination of the four is seen" in text


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        ({"base.z": 2.0, "q1.r": -1.0}, "base.z +1 mm, q1.r -0.5 mm"),
        ({"base.rz": 0.5, "q1.theta": -0.5, "q1.r": 2.0}, "base.rz +1 mrad, q1.theta -1 mrad, q1.r +0.004 mm"),
        ({"q1.r": 2.0, "q1.theta": 0.5}, "q1.r +1 mm, q1.theta +250 mrad"),
        ({"gain": 4.0, "q1.r": 2.0}, "gain +0.001, q1.r +0.0005 mm"),
        ({"leg1.a.x": 1.0, "leg2.a.x": 1.0, "leg3.a.x": -1.0, "q1.r": 1.0}, "leg1..leg2 a.x, q1.r +1 mm, leg3.a.x -1 mm"),
        ({name: 1.0 + k for k, name in enumerate(LENGTHS[:8])},
         "base.z +1 mm, q1.r +2 mm, q2.r +3 mm, q3.r +4 mm, q4.r +5 mm, q5.r +6 mm and 2 more"),
    ],
)  # fmt: skip
def test_proportions_lead_with_a_millimetre_a_milliradian_or_a_thousandth(
    parts: dict[str, float], told: str
) -> None:
    assert terms(knowledge(), Direction(parts)) == told
    for factor in (7.0, -3.0):  # a direction has no size and no sign
        assert terms(knowledge(), Direction({name: factor * part for name, part in parts.items()})) == told


@pytest.mark.parametrize(
    ("names", "open_ended", "told"),
    [
        (["q1.r"], False, "q1.r alone is not seen; its tolerance decided"),
        (["q1.r"], True, "q1.r alone is not seen; nothing decided, it stays at the drawing"),
        (["q1.r", "base.z"], False, "moving base.z together with q1.r is not seen; tolerances decided"),
        (["q1.r", "base.z"], True, "moving base.z together with q1.r is not seen; nothing decided, they stay at the drawing"),
        (["q1.r", "q2.r"], False, "moving q1..q2 r together is not seen; tolerances decided"),
        ([f"{c}.r" for c in "abcdefghijklm"], False,
         "moving a.r together with b.r, c.r, d.r, e.r, f.r, g.r, h.r, i.r, j.r, k.r and 2 more is not seen;"
         " tolerances decided"),
    ],
)  # fmt: skip
def test_the_meaning_of_a_direction(names: list[str], open_ended: bool, told: str) -> None:
    assert meaning(Direction(dict.fromkeys(names, 1.0), open_ended=open_ended)) == told


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (["leg2.a.x", "leg1.a.x", "leg3.a.x"], ["leg1..leg3 a.x"]),
        (["leg1.a.x", "leg3.a.x", "leg10.a.x"], ["leg1, leg3, leg10 a.x"]),
        (["leg1.a.x", "leg1.a.y", "tool.z"], ["leg1.a.x", "leg1.a.y", "tool.z"]),
        (["leg9.a.x", "leg10.a.x"], ["leg9..leg10 a.x"]),
        ([], []),
    ],
)
def test_names_that_differ_by_a_number_stand_together(names: list[str], told: list[str]) -> None:
    assert grouped(names) == told


def body(motion: str, *undone: str, members: tuple[str, ...] = ("leg1.a", "leg2.a")) -> Pattern:
    return Pattern("body", np.zeros(len(NAMES)), members, motion, undone)


def test_patterns_are_told_in_few_words() -> None:
    shift = Pattern("shift", np.zeros(len(NAMES)), ("q1.r", "q2.r", "q3.r"))
    assert said(patterns=[Pattern("scale", np.zeros(len(NAMES)), ()), shift]) == [
        "scale: all lengths can grow together by one factor; one known length would settle it",
        "a common change of q1..q3 r: only their differences are seen",
    ]
    moves = [body("along x", "base.z"), body("about z", "base.rz"), body("along y", "base.z")]
    assert said(patterns=moves) == [
        "points leg1..leg2 a move as one body along x, y and about z; base.z, base.rz would undo it"
    ]
    free = [body("about x", members=("P1", "P2", "P4"))]
    assert said(patterns=free) == [
        "points P1, P2 and P4 move as one body about x; where the frame that they are written in sits is nobody's measurement"
    ]
    apart = [body("along x"), body("along x", members=("leg3.a",))]
    assert len(said(patterns=apart)) == 2
