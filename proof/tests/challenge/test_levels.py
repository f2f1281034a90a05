"""The scorer at three levels: place, driver, law."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from challenge.drivers import LIBRARY, OUTSIDE, agree, driver_of, of_effect
from challenge.figures import Figure
from challenge.findings import FORM, Found, Judge, Levels, Reply, Said
from challenge.headline import headline
from challenge.levels import judged
from challenge.predictions import Predicted
from challenge.score import Score, score
from challenge.score_table import markdown, table
from challenge.simulator.registry import MACHINES
from challenge.solutions import Truth
from challenge.table_document import document
from proof_support.challenge_replies import BEAT, BEND, PLAY, finding, key, leveled, nameless, reply
from truepose.models.effects.base import effects
from truepose.models.effects.common import OF_ROWS

SURE, FAINT = 0.95, 0.6
DRIVERS = {
    "load": "joint-compliance link-bending leg-compliance gravity-sag screw-windup axis-flexure",
    "position-periodic": "transmission-error encoder-eccentricity axis-wobble joint-runout screw-periodic",
    "position": "actuator-scale axis-straightness flexure-shift",
    "arrival": "backlash friction-hysteresis piezo-hysteresis early-reading",
    "time": "piezo-creep mount-drift",
    "temperature": "thermal-expansion",
    "session": "frame-shift zero-shift",
    "coupling": "axis-coupling",
    "constant": "wrong-constant target-offset",
    "sensor": "sensor-scale sensor-periodic air-refraction lens-distortion latency",
}
BY_SLUG: dict[str, str | None] = {slug: kind for kind, slugs in DRIVERS.items() for slug in slugs.split()}
BY_SLUG |= {"platform-deformation": None}  # the legs' load, or the travel of the actuators
FAULT = Truth("fault", "wrong-constant", ("leg3.a.x",), 2.0, 1.0, 0.5, 20.0)
COUPLED = Truth("coupled", "axis-coupling", ("q2", "q1"), 2.0, 1.0, 0.5, 20.0)
HEAT = Truth("heated-zero", "", ("q2",), 2.0, 1.0, 0.5, 20.0)
SLIP = Truth("slip", "fringe-miscount", ("rows",), 2.0, 1.0, 0.5, 20.0)


class TestDrivers:
    def test_every_effect_has_one(self) -> None:
        known = set(effects) - {FORM, *OF_ROWS}
        assert {slug: of_effect(slug) for slug in known} == BY_SLUG
        stated = {slug for slug in known if effects.get(slug, "test").driven_by is not None}
        assert set(LIBRARY) | stated == known and not set(LIBRARY) & stated

    def test_everything_without_a_name_was_thought_of(self) -> None:
        drawn = {kind.name for machine in MACHINES.values() for kind in machine().kinds() if not kind.slug}
        assert drawn <= set(OUTSIDE)
        assert set(OUTSIDE) - drawn == {"play-under-weight", "loose-bearing", "loose-flange"}  # MuJoCo's

    def test_a_position_is_one_driver_and_none_is_any(self) -> None:
        assert agree("position", "position-periodic") and agree("position-periodic", "position")
        assert agree("load", "load") and agree("load", None) and not agree("load", "position")
        assert driver_of(replace(HEAT, kind="unheard")) is None


RIGHT = [  # truth, finding, driver said: place right, driver right, law right
    (PLAY, "backlash", "rho1", "arrival", "PDL"),
    (PLAY, "backlash", "leg1", "arrival", "PDL"),  # the leg that this reading moves
    (PLAY, "backlash", "rho1+rho2", "arrival", "PD"),
    (PLAY, "friction-hysteresis", "rho1", "arrival", "PD"),
    (PLAY, "actuator-scale", "rho1", "position", "P"),
    (PLAY, "zero-shift", "rho1", "session", "PDL"),  # as good as the truth, with its own driver
    (PLAY, "empirical", "leg1", "arrival", "PD"),
    (PLAY, "backlash", "rho2", "arrival", ""),
    (FAULT, "wrong-constant", "leg3.length", "constant", "PD"),
    (FAULT, "leg-compliance", "leg3", "load", "P"),
    (COUPLED, "axis-coupling", "q2+q3", "coupling", "PD"),
    (COUPLED, "axis-coupling", "q1+q2", "coupling", "L"),  # another axis is driven; names know no order
    (COUPLED, "empirical", "q2", "coupling", "PD"),
    (COUPLED, "backlash", "q1", "arrival", ""),
    (BEAT, "backlash", "rho2", "arrival", "PD"),  # of no single driver: any is right
    (HEAT, "thermal-expansion", "q2", "temperature", "PD"),
    (HEAT, "backlash", "q2", "arrival", "P"),
    (SLIP, "outliers", "17", "sensor", "PD"),
    (SLIP, "backlash", "q2", "arrival", ""),
]


@pytest.mark.parametrize(("truth", "effect", "place", "kind", "wanted"), RIGHT)
def test_what_is_right_at_each_level(
    tmp_path: Path, truth: Truth, effect: str, place: str, kind: str, wanted: str
) -> None:
    said = leveled(finding(effect, place, 0.0 if effect == FORM else 0.7), kind, SURE, 0.99)
    told = score(key(truth), reply(tmp_path, "missing-physics", said)).levels
    marks = zip("PDL", (told.places, told.drivers, told.laws), strict=True)
    assert "".join(m for m, statements in marks if any(s.right for s in statements)) == wanted
    assert [s.probability for s in (*told.places, *told.drivers)] == [0.99, SURE]
    assert [s.probability for s in told.laws] == ([] if effect == FORM else [0.7])
    assert told.known == ("D" in wanted,)


def test_a_driver_of_another_explanation_counts_only_where_that_is(tmp_path: Path) -> None:
    """Session is right at rho2, arrival at rho1: of each explanation both must hold."""
    apart = replace(PLAY, equivalents=(("zero-shift", ("rho2",)),))
    for place, kind, right in (
        ("rho2", "session", True),
        ("rho1", "session", False),
        ("rho2", "arrival", False),
    ):
        told = score(key(apart), reply(tmp_path, "missing-physics", nameless(place, kind, SURE))).levels
        assert [(p.right, d.right) for p, d in zip(told.places, told.drivers, strict=True)] == [(True, right)]


@given(st.sampled_from(sorted(BY_SLUG)), st.sampled_from(["q1", "leg1", "rho1.b", "q2"]), st.floats(0.9, 1.0))
def test_the_very_truth_is_right_at_every_level(slug: str, part: str, p: float) -> None:
    solution = key(Truth("kind", slug, (part,), 2.0, 1.0, 0.5, 20.0))
    found = Found(Said(slug, (part,), p), (), p, 1.0, Levels(p, BY_SLUG[slug] or "load", p))
    told = judged(Judge(solution), Reply("missing-physics", False, (found,), {}, leveled=True), (found,))
    for said in (told.places, told.drivers, told.laws):
        assert [(s.probability, s.right) for s in said] == [(p, True)]
    assert told.known == (True,) and not told.withheld and not told.wrong_law


class TestNameless:
    """A finding whose place and driver are known, and no law, is no name."""

    def test_it_counts_nowhere_among_names(self, tmp_path: Path) -> None:
        said = reply(tmp_path, "missing-physics", nameless("rho1", "arrival", SURE))
        found = score(key(PLAY), said)
        assert (said.named, len(said.physics), len(said.located)) == ((), 1, 1)
        assert found.detected and found.verdict and found.levels.known == (True,)
        assert not (found.named or found.first or found.top_place or found.exact or found.confident_wrong)
        assert not (found.wrong_class or found.statements or found.classes or found.levels.laws)
        assert "something by arrival@rho1 0.95" in found.said

    def test_it_stands_beside_names(self, tmp_path: Path) -> None:
        name = leveled(finding("backlash", "rho1", gain=1.0), "arrival", SURE)
        found = score(key(PLAY), reply(tmp_path, "missing-physics", nameless("rho2", "load", SURE), name))
        assert found.first and found.exact  # though the other is better supported
        assert [s.right for s in found.levels.places] == [False, True]

    @pytest.mark.parametrize(
        ("verdict", "named", "abstained", "right"),
        [
            ("missing-physics", False, True, True),
            ("unknown", False, True, True),
            ("missing-physics", True, False, False),
        ],
    )
    def test_outside_the_library_it_is_an_abstention(
        self, tmp_path: Path, verdict: str, named: bool, abstained: bool, right: bool
    ) -> None:
        said = [nameless("rho2", "load", SURE), *([finding("backlash", "rho2", 0.5)] if named else [])]
        found = score(key(BEAT, stratum="out-of-library"), reply(tmp_path, verdict, *said))
        assert found.honest and found.abstained is abstained and found.verdict is right

    def test_where_nothing_is_missing_it_is_a_false_alarm(self, tmp_path: Path) -> None:
        found = score(key(), reply(tmp_path, "missing-physics", nameless("rho2", "load", SURE)))
        assert found.detected and not found.verdict and not found.levels.drivers[0].right


def _figures(*scores: Score) -> dict[str, Figure]:
    return {f.name: f for f in headline(scores)}


def _counts(figure: Figure) -> tuple[int, int, bool | None]:
    return figure.hits, figure.n, figure.met


class TestFigures:
    def test_of_a_small_examination(self, tmp_path: Path) -> None:
        said: list[dict[str, Any]] = [
            leveled(finding("backlash", "rho1", 0.97), "arrival", 0.98),
            leveled(finding("gravity-sag", "base", 0.92), "load", 0.93),
            leveled(finding("link-bending", "platform", 0.4), "load", FAINT, SURE),
        ]
        pair = score(key(replace(PLAY, size=9.0), BEND), reply(tmp_path, "missing-physics", *said))
        silent = score(key(BEND), None, failure="crash")
        figures = _figures(pair, silent)
        assert _counts(figures["place and driver, said with 0.9 or more, right"]) == (1, 2, False)
        assert _counts(figures["place, said with 0.9 or more, right"]) == (2, 3, None)
        assert _counts(figures["law, said with 0.9 or more, right"]) == (1, 2, False)
        large = figures["effects above 5 limits whose place and driver are said with 0.9 or more"]
        assert _counts(large) == (1, 3, False)  # the crash said nothing of its own
        assert figures["verdict unknown though place and driver are known"].n == 1
        # of each tenth what was said less what was right: 0.98 and 0.93 of one, 0.6 of one
        error = (abs(0.98 + 0.93 - 1) + abs(FAINT - 1)) / 3
        assert figures["place and driver: expected calibration error"].value == pytest.approx(error)
        assert figures["place: expected calibration error"].value == pytest.approx(
            abs(0.98 + 0.93 + SURE - 2) / 3
        )
        assert figures["law: expected calibration error"].met is False
        assert "places and drivers" in markdown(table([pair, silent]))
        assert document(table([pair]))["scores"][0]["known_each"] == [True, False]

    @pytest.mark.parametrize(("driver", "withheld"), [(0.5, True), (0.49, False)])
    def test_unknown_though_something_is_known(self, tmp_path: Path, driver: float, withheld: bool) -> None:
        unknown = score(key(BEAT), reply(tmp_path, "unknown", nameless("rho2", "load", driver)))
        named = score(key(BEAT), reply(tmp_path, "missing-physics", nameless("rho2", "load", driver)))
        figure = _figures(unknown, named)["verdict unknown though place and driver are known"]
        assert _counts(figure) == (int(withheld), 2, not withheld)

    @pytest.mark.parametrize(
        ("effect", "place", "probability", "wrong"),
        [
            ("backlash", "rho2", 0.9, True),
            ("backlash", "rho2", 0.89, False),
            ("zero-shift", "rho2", 0.99, False),  # as good as what has no name
            ("empirical", "rho5", 0.0, False),
        ],
    )
    def test_a_law_where_there_is_none(
        self, tmp_path: Path, effect: str, place: str, probability: float, wrong: bool
    ) -> None:
        truth = replace(BEAT, equivalents=(("zero-shift", ("rho2",)),))
        said = leveled(finding(effect, place, probability), "load", 0.99)
        found = score(key(truth, stratum="out-of-library"), reply(tmp_path, "missing-physics", said))
        figure = _figures(found)["out of library: a wrong law with 0.9 or more"]
        assert _counts(figure) == (int(wrong), 1, not wrong)

    def test_a_diagnosis_without_levels_tells_its_laws(self, tmp_path: Path) -> None:
        old = reply(tmp_path, "missing-physics", finding("backlash", "rho1"))
        assert old.findings[0].levels is None and not old.leveled and not old.located
        figures = _figures(score(key(PLAY), old), score(key(PLAY), None))
        assert _counts(figures["law, said with 0.9 or more, right"]) == (1, 1, True)
        empty = ("place and driver, said with 0.9 or more, right", "place: expected calibration error",
                 "effects above 5 limits whose place and driver are said with 0.9 or more",
                 "verdict unknown though place and driver are known")  # fmt: skip
        assert all(figures[name].n == 0 and figures[name].met is None for name in empty)

    def test_of_the_tool_and_of_bounds(self, tmp_path: Path) -> None:
        said = reply(tmp_path, "adequate")
        guesses = [
            (PLAY, 0.2, False),
            (BEND, 0.6, True),
            (BEND, 1.03, False),
            (None, 1.0, False),
            (None, None, None),
        ]
        scores = [
            score(
                key(*([truth] if truth else [])),
                said,
                predicted=Predicted(pose_ratio=ratio, unphysical=broken),
            )
            for truth, ratio, broken in guesses
        ]
        figures = _figures(*scores)
        median = figures["tool pose on fresh poses, improved over plain, median"]
        assert (median.value, median.n, median.met) == (0.6, 3, False)
        assert _counts(figures["tool pose on fresh poses, improved over plain, cases above 1.02"]) == (
            1,
            4,
            False,
        )
        assert _counts(figures["signs or bounds broken in improved.yaml"]) == (1, 4, False)
