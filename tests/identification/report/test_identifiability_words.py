"""What poses can tell, in lines and as data: what is cut short, in which units, and what is said of each constant."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from support.told_drift import NAMES, blind
from truepose.identification.fit.decomposition import Observability
from truepose.identification.identifiability.analysis import Identifiability, ParameterSight
from truepose.identification.identifiability.note import Note
from truepose.identification.identifiability.observability import Direction
from truepose.identification.identifiability.subset import Subset
from truepose.identification.report.identifiability_words import (
    identifiability_document,
    identifiability_json,
    quantity,
)
from truepose.shown.text import LINES, first_screen

SEEN = ParameterSight("q1.r", "mm", 0.2, 0.004, 0.005, "determined", ())
TRADED = ParameterSight("q1.theta", "rad", np.pi / 180, 0.01, 0.0087, "partly", ("base.rz", "tool.rz"))
LOOSE = ParameterSight("gain", "1", np.inf, np.inf, np.inf, "nothing decides", ())


def told(**more: Any) -> Identifiability:
    given: dict[str, Any] = {
        "machine": "arm", "files": (), "seed": 20, "poses": 100, "n_observations": 600, "free": 3, "rank": 2,
        "rank_at_drawing": 2, "indices": Observability(1.0, 0.25, 12.0, 3.0, 0.5), "parameters": (SEEN, TRADED, LOOSE),
        "unseen": blind(), "unseen_at_drawing": (), "as_built_size": 0.0, "nearly": (), "subset": Subset(("q1.r",), {}, 2.0),
        "known": blind().known, "notes": (),
    }  # fmt: skip
    return Identifiability(**{**given, **more})


def lines(every: bool = False, **more: Any) -> list[str]:
    return first_screen(identifiability_document(told(**more), every), 10_000 if every else LINES)


def test_first_lines_say_what_was_looked_at() -> None:
    first, rank, *indices = lines()
    assert first == "arm: 100 poses drawn over the joints' ranges (seed 20), 600 readings"
    assert rank == "  the readings see 2 of 3 directions of the free parameters"
    assert indices[0].startswith(
        "  condition number 4; observability O1 1, O2 0.25, O3 12, O4 3, O5 0.5 (seen"
    )
    first, rank, *_ = lines(seed=None, files=("a.csv", "b.csv"), rank_at_drawing=1)
    assert first == "arm: 100 poses of a.csv, b.csv, 600 readings"
    assert rank.endswith(" of 3 directions of the free parameters (1 exactly at the drawing)")
    assert "(seed 0)" in lines(seed=0)[0]


def test_constants_stand_in_columns_with_what_is_said_of_each() -> None:
    told_lines = lines()
    assert told_lines[4:7] == [
        "  determined (1): q1.r",
        "  partly (1): q1.theta",
        "  nothing decides (1): gain",
    ]
    assert [" ".join(line.split()) for line in told_lines[-3:]] == [
        "gain unknown unknown nothing decides",
        "q1.theta 1 deg 0.498 deg partly; trades with base.rz, t ...",
        "q1.r 0.2 mm 0.005 mm determined",
    ]


@pytest.mark.parametrize(("count", "every"), [(5, False), (41, False), (41, True)])
def test_all_constants_are_listed_where_they_fit_or_are_asked_for(count: int, every: bool) -> None:
    own = tuple(replace(SEEN, name=f"c{k}") for k in range(count))
    told_lines = lines(every, parameters=own)
    shown = [line for line in told_lines if line.startswith("  c") and "mm" in line]
    assert (len(shown) == count) is (every or count == 5)
    assert ("more rows: to_frame(), or --json, has all" in told_lines[-1]) is (len(shown) < count)


@pytest.mark.parametrize("count", [2, 30])
def test_directions_that_are_nearly_unseen_are_told_and_counted(count: int) -> None:
    some = tuple(Direction({NAMES[k % 14]: 1.0}, 0.5) for k in range(count))
    brief, whole = (
        lines(every, nearly=some, unseen_at_drawing=some, as_built_size=2.5) for every in (False, True)
    )
    for label in ("hardly seen", "tolerances decide"):
        assert sum(line.startswith(f"  {label}: ") for line in whole) == count
        told_lines = [line for line in brief if line.startswith(f"  {label}: ")]
        assert ("more" in told_lines[-1]) is (count > 2) and len(told_lines) <= count
    assert "  tolerances decide: a +1 mm (readings alone: 2 tolerances)" in whole


def test_what_no_reading_sees_is_not_nearly_unseen() -> None:
    none, faint = Direction({"a": 1.0}, 0.0), Direction({"b": 1.0}, 0.1)
    assert [line for line in lines(nearly=(none, faint)) if "tolerances decide:" in line] == [
        "  tolerances decide: b +1 mm (readings alone: 10 tolerances)"
    ]
    assert not [
        line for line in lines(nearly=(none,)) if "tolerances decide:" in line or "no reading" in line
    ]
    seen = "  no reading sees: a alone: no reading changes when it moves; its tolerance decides"
    assert seen in lines(unseen=blind(none))


def test_constants_that_show_alike_are_left_out() -> None:
    relations: dict[str, dict[str, float]] = {f"c{k}": {"q1.r": 1.0} for k in range(10)}
    subset = Subset(("q1.r", "q2.r"), relations, 2.0)
    head = "2 parameters can be told apart from each other; left out as alike: "
    eight = ", ".join(f"c{k}" for k in range(8))
    assert f"{head}{eight} and 2 more" in " ".join(line.strip() for line in lines(subset=subset))
    assert f"{head}{eight}, c8, c9" in " ".join(line.strip() for line in lines(True, subset=subset))
    assert not [line for line in lines() if "told apart" in line]


@pytest.mark.parametrize(
    ("value", "unit", "said"),
    [
        (0.25, "mm", "0.25 mm"), (np.pi, "rad", "180 deg"), (1e-3, "rad", "0.0573 deg"), (0.1234, "1", "0.123"),
        (2.0, "rad/N", "2 rad/N"), (np.inf, "mm", "unknown"), (np.inf, "rad", "unknown"),
    ],
)  # fmt: skip
def test_angles_are_told_in_degrees(value: float, unit: str, said: str) -> None:
    assert quantity(value, unit) == said


def test_the_same_as_data() -> None:
    pair = Direction({"a": 2.0, "b": -1.0}, 0.25)
    subset = Subset(("q1.r",), {"gain": {"q1.r": 0.5}}, 2.0)
    document = identifiability_json(
        told(
            nearly=(pair,),
            unseen=blind(pair),
            unseen_at_drawing=(pair,),
            subset=subset,
            notes=(Note("unread", "time"),),
        )
    )
    assert (document["rank"], document["free_parameters"], document["condition"]) == (2, 3, 4.0)
    assert document["observability"] == {"O1": 1.0, "O2": 0.25, "O3": 12.0, "O4": 3.0, "O5": 0.5}
    assert document["parameters"]["q1.theta"] == {
        "unit": "rad", "tolerance": np.pi / 180, "std": 0.0087, "std_at_drawing": 0.01, "status": "partly",
        "trades_with": ["base.rz", "tool.rz"],
    }  # fmt: skip
    assert document["parameters"]["gain"]["tolerance"] is document["parameters"]["gain"]["std"] is None
    direction = {"parts": {"a": 2.0, "b": -1.0}, "meaning": "a +1 mm, b -0.5 mm"}
    assert document["unseen"] == document["unseen_at_drawing"] == [direction]
    assert document["nearly_unseen"] == [{**direction, "sigmas_a_tolerance": 0.25}]
    assert document["independent"] == {
        "kept": ["q1.r"],
        "left_out": {"gain": {"q1.r": 0.5}},
        "condition": 2.0,
    }
    assert len(document["notes"]) == 1 and len(document["sentences"]) == 1
    assert (document["seed"], document["files"], document["readings"]) == (20, [], 600)
