"""Laws of a search by steps, and of how tolerances may be misstated: their classes, their widenings, what each costs."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from truepose.identification.drift.forward import MAX_TERMS, Accepted, select_forward
from truepose.identification.drift.scales import Grid
from truepose.identification.fit.tolerance_classes import FEW, PartClass, inflations, part_classes

# -- steps ---------------------------------------------------------------------------------------------------


def test_a_search_adds_until_nothing_is_worth_it_and_reviews_each_step() -> None:
    """The review hears of every step whether something was added; the last one, without an addition, is the end."""
    heard: list[tuple[list[int], bool]] = []

    def add(current: Accepted) -> Accepted:
        worth = [k for k in (3, 1, 4) if k not in current]
        return {**current, worth[0]: 1.0} if worth else current

    def review(current: Accepted, added: bool) -> Accepted:
        heard.append((list(current), added))
        assert len(heard) < 20
        return current

    assert list(select_forward({9: 2.0}, add, review)) == [9, 3, 1, 4]
    assert heard == [([9, 3], True), ([9, 3, 1], True), ([9, 3, 1, 4], True), ([9, 3, 1, 4], False)]


def test_a_search_that_goes_in_a_circle_ends_where_it_was_before() -> None:
    """One step puts in what the next takes out again."""
    steps: list[int] = []

    def turn(current: Accepted) -> Accepted:
        steps.append(1)
        assert len(steps) < 20
        return {(next(iter(current)) + 1) % 3: 1.0}

    assert select_forward({0: 1.0}, turn, lambda current, _: current) == {0: 1.0}
    assert len(steps) == 3


def test_a_search_for_ever_more_ends_at_the_most_terms() -> None:
    found = select_forward({}, lambda current: {**current, len(current): 1.0}, lambda current, _: current)
    assert len(found) == MAX_TERMS
    assert select_forward(found, lambda _: {}, lambda _, __: {}) == found


# -- grids and their prior -----------------------------------------------------------------------------------

LENGTHS = tuple(PartClass("length", f"leg.{part}") for part in ("a", "b", "r"))
CLASSES = (
    *LENGTHS,
    PartClass("angle", "leg.u"),
    PartClass("angle"),
    PartClass("frame"),
)
DOUBTS: list[tuple[tuple[int, ...], float]] = [
    ((0, 0, 0, 0, 0, 0), 0.0),
    ((1, 0, 0, 0, 0, 0), 0.5),  # one class
    ((1, 1, 1, 0, 0, 0), 0.5),  # one kind
    ((1, 1, 1, 1, 1, 1), 0.5),  # one optimist for everything
    ((2, 2, 2, 2, 2, 2), 2.0),
    ((1, 1, 1, 1, 1, 0), 1.0),  # two kinds, or everything and the frame back
    ((0, 0, 0, 0, 1, 2), 2.0),  # everything by one, lengths and an angle back, the frame by one more
    ((2, 2, 2, 1, 1, 0), 1.5),  # everything by one, lengths by one more, the frame by one less
    ((3, 2, 2, 0, 0, 0), 2.5),  # a kind by two, one class of it by one more
    ((3, 2, 2, 2, 2, 2), 2.5),
    ((1, 2, 1, 0, 1, 3), 3.5),  # everything by one, two classes by one beside it, the frame by two
    ((0, -1, 0, 0, 0, 0), 0.5),  # too cautious by as much
]


@pytest.mark.parametrize(("doubt", "cost"), DOUBTS)
def test_misstated_tolerances_cost_the_shortest_story_of_who_was_wrong(
    doubt: tuple[int, ...], cost: float
) -> None:
    """In steps of 0.6 of the log: (steps)^2 / 2 for all parts, for a kind beside them, for a class beside its kind."""
    grid = Grid((), (), CLASSES)
    wrong = np.exp(0.6 * np.array(doubt)).tolist()
    found = grid.log_prior(1.0, (1.0,) * 6) - grid.log_prior(1.0, wrong)
    assert found == pytest.approx(cost, abs=1e-12)
    for order in ((5, 4, 3, 2, 1, 0), (3, 0, 5, 1, 4, 2), (1, 5, 0, 4, 2, 3)):
        turned = Grid((), (), tuple(CLASSES[k] for k in order))
        again = turned.log_prior(1.0, [wrong[k] for k in order])
        assert again == pytest.approx(grid.log_prior(1.0, wrong), abs=1e-12)


KINDS = ("length", "angle", "frame", "gain")


@pytest.mark.parametrize("present", [p for n in range(1, 5) for p in itertools.combinations(KINDS, n)])
def test_tolerances_are_widened_by_kind_all_at_once_and_class_by_class(present: tuple[str, ...]) -> None:
    """1, 2 or 4: lengths and angles each as a whole, everything, and one class alone unless it came with an instrument."""
    classes = tuple(
        PartClass(kind, part) for kind in present for part in (("a", "b") if kind == "length" else ("",))
    )
    length, angle = (np.array([c.kind == kind for c in classes]) for kind in KINDS[:2])
    expected = {
        tuple(np.where(length, one, np.where(angle, other, 1.0)).tolist())
        for one in (1.0, 2.0, 4.0)
        for other in (1.0, 2.0, 4.0)
    }
    expected |= {(factor,) * len(classes) for factor in (2.0, 4.0)}
    for k, c in enumerate(classes):
        if c.kind != "gain":
            expected |= {
                tuple([1.0] * k + [factor] + [1.0] * (len(classes) - k - 1)) for factor in (2.0, 4.0)
            }
    found = inflations(classes)
    assert found[0] == (1.0,) * len(classes)
    assert len(found) == len(set(found)) and set(found) == expected


@pytest.mark.parametrize("count", [FEW - 1, FEW])
def test_so_many_parameters_make_a_class_of_their_own(count: int) -> None:
    """Fewer share the rest of their kind; frames are one class, whatever their parts are called."""
    names = [*(f"leg{k}.a.x" for k in range(count)), "odd.b", "base.x", "tool.x"]
    kinds = [*("length",) * (count + 1), "frame", "frame"]
    own = PartClass("length", "leg.a") if count == 4 else PartClass("length")
    found = part_classes(names, kinds)
    assert found == ((own,) * count + (PartClass("length"), PartClass("frame"), PartClass("frame")))
