"""Laws of how tolerances may be misstated: their classes, their widenings, what each costs."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from truepose.identification.fit.tolerance_classes import (
    FEW,
    PartClass,
    inflations,
    part_classes,
    tolerance_cost,
    widenings,
)

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
    wrong = np.exp(0.6 * np.array(doubt)).tolist()
    assert tolerance_cost((1.0,) * 6, CLASSES) == 0.0
    assert tolerance_cost(wrong, CLASSES) == pytest.approx(cost, abs=1e-12)
    for order in ((5, 4, 3, 2, 1, 0), (3, 0, 5, 1, 4, 2), (1, 5, 0, 4, 2, 3)):
        again = tolerance_cost([wrong[k] for k in order], [CLASSES[k] for k in order])
        assert again == pytest.approx(cost, abs=1e-12)


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
    rows, log_prior = widenings(classes)
    assert rows[0] == found[0] and set(rows) == expected | {(0.5,) * len(classes)}  # or all too cautious
    assert log_prior == pytest.approx([-tolerance_cost(row, classes) for row in rows])


@pytest.mark.parametrize("count", [FEW - 1, FEW])
def test_so_many_parameters_make_a_class_of_their_own(count: int) -> None:
    """Fewer share the rest of their kind; frames are one class, whatever their parts are called."""
    names = [*(f"leg{k}.a.x" for k in range(count)), "odd.b", "base.x", "tool.x"]
    kinds = [*("length",) * (count + 1), "frame", "frame"]
    own = PartClass("length", "leg.a") if count == 4 else PartClass("length")
    found = part_classes(names, kinds)
    assert found == ((own,) * count + (PartClass("length"), PartClass("frame"), PartClass("frame")))
