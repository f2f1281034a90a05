"""What a planned experiment and a plan are expected to tell: verdicts, what would help, and what chance does."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from support.experiments import arm
from truepose.identification.leaves.planning.discriminate.experiment import Experiment, Pair, Worth
from truepose.identification.leaves.planning.discriminate.factors import Explanation, Factor, Target
from truepose.identification.leaves.planning.discriminate.race import Rows
from truepose.identification.leaves.planning.discriminate.words import experiment_json, sentences
from truepose.identification.leaves.planning.plan import Plan
from truepose.identification.leaves.planning.words import plan_json, plan_lines, plan_notes

SOFT, WAVE, PLAY = (
    Explanation(slug, ("q2",), ()) for slug in ("joint-compliance", "transmission-error", "backlash")
)
LOAD = Factor("payload", (0.0, 5.0), 0.0, False)
AIR = Factor("temperature.link2", (15.0, 20.0), 20.0, False)
PAIR = Pair(SOFT, WAVE, 5.0, 0.5, True, False)


def told(*pairs: Pair, **more: Any) -> Experiment:
    given: dict[str, Any] = {
        "machine": arm(), "explanations": (SOFT, WAVE), "rows": Rows(np.zeros((40, 6)), {}), "reference": None,
        "pairs": pairs or (PAIR,), "expected": 5.0, "already": None, "random": np.array([1.0, 3.0]), "worth": (),
        "targets": (), "seed": 0,
    }  # fmt: skip
    return Experiment(**{**given, **more})


NAMES = "joint-compliance@q2 and transmission-error@q2"


def test_from_three_on_rows_are_expected_to_decide() -> None:
    for expected in (3.0, 5.0):
        first, *_ = sentences(told(expected=expected))
        assert (
            first
            == f"these 40 rows are expected to tell {NAMES} apart: expected log Bayes factor {expected:g} (3 decides)"
        )
    first, *_ = sentences(told(expected=2.9))
    assert first.startswith(
        f"these 40 rows are not expected to tell {NAMES} apart: expected log Bayes factor 2.9, 3 decides; "
    )


@pytest.mark.parametrize(
    ("expected", "more"),
    [
        (2.0, "about 60 rows like these would"),
        (0.7, "about 172 rows like these would"),
        (0.5, "a size as small as this needs another instrument"),
    ],
)
def test_what_would_help_where_rows_do_not(expected: float, more: str) -> None:
    """More rows; or the best of what was not offered, where that brings more than the plan."""
    assert sentences(told(expected=expected))[0].endswith(f"3 decides; {more}")
    worth = (
        Worth("payload", (LOAD,), False, 4.0), Worth("temperature", (AIR,), False, 6.0), Worth("time", (LOAD,), True, 9.0),
    )  # fmt: skip
    best = sentences(told(expected=expected, worth=worth))[0]
    assert best.endswith("; temperature of link2 at 15, 20 degC would bring 6")
    poor = sentences(told(expected=expected, worth=(Worth("payload", (LOAD,), False, expected),)))[0]
    assert poor.endswith(more)


def test_pairs_that_nothing_tells_apart_have_a_sentence_each() -> None:
    stuck = replace(PAIR, separable=False, expected=0.0)
    first, second, *_ = sentences(told(PAIR, replace(stuck, rival=PLAY)))
    assert "apart as far as they can be told: " in first
    assert second.startswith(
        "joint-compliance@q2 and backlash@q2 cannot be told apart at this size by any of the rows that may be taken: no plan"
    )
    for same in (replace(stuck, twins=True), replace(stuck, share=0.9e-5)):
        (only,) = sentences(told(same))
        assert (
            f"{NAMES} do the same to every reading of this sensor, whatever the poses: no plan splits them"
            in only
        )
        assert "What would: joint-compliance: " in only and "; transmission-error: " in only
    worth = (Worth("payload", (LOAD,), False, 0.0, 4.0), Worth("temperature", (AIR,), False, 0.0, 3.5))
    (helped,) = sentences(told(stuck, worth=worth))
    assert helped == (
        "nothing that is offered tells joint-compliance@q2 from transmission-error@q2 (expected log Bayes factor 0);"
        " payload at 0, 5 kg would bring 4"
    )
    (twins,) = sentences(told(replace(stuck, twins=True), worth=worth))
    assert "no plan splits them" in twins


def test_chance_and_rows_that_exist_are_told_beside_the_plan() -> None:
    assert "as many random rows: 2 +- 1 (2 sets)" in sentences(told())
    assert "as many random rows: 2 +- 1 (2 sets); the rows that exist already: 0.25" in sentences(
        told(already=0.25)
    )
    assert not [line for line in sentences(told(replace(PAIR, separable=False))) if "random" in line]


def test_the_worst_six_pairs_are_told() -> None:
    pairs = [replace(PAIR, expected=float(9 - k)) for k in range(8)]
    lines = [
        line
        for line in sentences(told(*pairs, replace(PAIR, expected=0.1, separable=False)))
        if line.startswith("if ")
    ]
    assert [float(line.rpartition(": ")[2]) for line in lines] == [2.0, 3.0, 4.0, 5.0, 6.0]
    lines = [line for line in sentences(told(*pairs)) if line.startswith("if ")]
    assert lines[0] == "if joint-compliance@q2 is true, against transmission-error@q2: 2" and len(lines) == 6


@pytest.mark.parametrize(
    ("worth", "line"),
    [
        (Worth("payload", (LOAD,), True, 2.0), "with payload held at its nominal value: 2"),
        (Worth("payload", (LOAD,), False, 5.25), "payload was left at its nominal value; varying it would bring nothing"),
        (Worth("payload", (LOAD,), False, 5.3), "payload was left at its nominal value; payload at 0, 5 kg would bring 5.3"),
        (Worth("payload", (LOAD,), False, 5.3, 4.0), ""),
        (Worth("temperature", (AIR, replace(AIR, driver="temperature.link3")), True, 2.0),
         "with temperature of link2 and link3 held at its nominal value: 2"),
        (Worth("approach", (replace(AIR, driver="approach.q3"),), True, 2.0),
         "with side of approach of q3 held at its nominal value: 2"),
    ],
)  # fmt: skip
def test_what_a_factor_is_worth(worth: Worth, line: str) -> None:
    lines = [one for one in sentences(told(worth=(worth,))) if "nominal" in one]
    assert lines == ([line] if line else [])


def test_further_targets_are_told_with_what_they_bring() -> None:
    targets = ((Target("A", (0.0, 0.0, 1.0)), 5.25), (Target("B", (0.0, 0.0, 2.0)), 5.3))
    assert sentences(told(targets=targets))[-2:] == [
        "reading a further target A on the same rows would bring nothing",
        "reading a further target B on the same rows would bring 5.3",
    ]


def test_the_same_as_data() -> None:
    stuck = replace(PAIR, rival=PLAY, separable=False)
    worth = (Worth("payload", (LOAD,), True, 2.0), Worth("temperature", (AIR,), False, 4.0, 3.5))
    document = experiment_json(told(PAIR, stuck, worth=worth))
    assert document["split"] is False and experiment_json(told())["split"] is True
    assert experiment_json(told(expected=2.9))["split"] is False and document["threshold"] == 3.0
    assert document["inseparable"] == [["joint-compliance@q2", "backlash@q2"]]
    assert document["random"] == {"mean": 2.0, "std": 1.0, "sets": 2}
    assert document["factors"][0]["held"] == 2.0 and "would_bring" not in document["factors"][0]
    assert document["factors"][1]["would_bring"] == 4.0 and document["factors"][1]["opens"] == 3.5


# -- plans ---------------------------------------------------------------------------------------------


def plan(**more: Any) -> Plan:
    given = {
        "machine": SimpleNamespace(name="arm", effects=()), "by_chance": (1.5, 0.25), "by_exchange": None, "random": np.ones(5),
        "criterion": SimpleNamespace(name="d", title="log det"), "value": 2.0, "shrinkage": None, "determined": 4,
        "left_out": 0, "q": np.zeros((10, 2)), "repeats": lambda share: 0, "method": "exchange", "seed": 3,
        "indices": SimpleNamespace(o1=1.0, o2=2.0, o3=3.0, o4=4.0, o5=5.0),
    }  # fmt: skip
    return cast(Plan, SimpleNamespace(**{**given, **more}))


def test_a_plan_is_told_against_chance() -> None:
    assert plan_lines(plan()) == ["criterion d: log det = 2.0000; random poses 1.5000 +- 0.2500 (5 sets)"]
    assert plan_lines(plan(by_chance=None, by_exchange=1.75, shrinkage=0.8)) == [
        "criterion d: log det = 2.0000; random poses leave a direction open (5 sets); by exchange 1.7500",
        "1-sigma of the 4 determined directions: 0.800 of what random poses leave (geometric mean)",
    ]


def test_notes_of_a_plan() -> None:
    assert plan_notes(plan()) == []
    effects = [
        SimpleNamespace(drivers=("temperature.link2", "payload")),
        SimpleNamespace(drivers=("payload",)),
    ]
    assert plan_notes(plan(machine=SimpleNamespace(effects=effects))) == [
        f"{name!r} is not planned: effects that depend on it count at its default"
        for name in ("temperature.link2", "payload")
    ]
    assert plan_notes(plan(left_out=3)) == [
        "3 candidates were left out: not assembled, or next to a singularity"
    ]
    for repeats, noted in ((4, False), (5, True)):
        said = plan_notes(plan(repeats=lambda share, own=repeats: own if share == 0.02 else 0))
        assert bool(said) is noted
        assert not noted or said[0].startswith("5 of 10 poses repeat others within 2% of the ranges: ")


def test_a_plan_as_data() -> None:
    document = plan_json(plan(), ["q1", "q2"])
    assert document["random"] == {"mean": 1.5, "std": 0.25, "sets": 5}
    assert document["observability"] == {"O1": 1.0, "O2": 2.0, "O3": 3.0, "O4": 4.0, "O5": 5.0}
    assert (document["poses"], document["columns"], document["repeats"]) == (10, ["q1", "q2"], 0)
    assert plan_json(plan(by_chance=None), [])["random"] == {"mean": None, "std": None, "sets": 5}
