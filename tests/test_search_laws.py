"""Laws of the search for missing physics: its steps, its grids and their prior, what settles names against no name."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray
from truepose.identification.diagnosis.effect_evidence import AMPLITUDES, MANY_OBSERVATIONS, grid_for
from truepose.identification.diagnosis.effect_selection import MANY_TERMS, Selection, select

from support.effect_machines import read_machines
from support.effects import with_effect
from truepose.identification.diagnosis import effect_selection as selection
from truepose.identification.diagnosis.candidates import Catalogue
from truepose.identification.diagnosis.refine import _setting
from truepose.identification.diagnosis.signatures import Linearisation, Signatures
from truepose.identification.fit.estimate import Estimate
from truepose.identification.selection.forward import MAX_TERMS, Accepted, select_forward
from truepose.identification.selection.scales import Grid
from truepose.identification.selection.tolerance_classes import FEW, PartClass, inflations, part_classes
from truepose.models.effects.base import Effect
from truepose.models.machine import Machine

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


def linear(readings: int) -> Linearisation:
    """So many readings of two lengths and an angle."""
    parts = (*LENGTHS[:2], PartClass("angle"))
    return Linearisation(np.eye(4), 3, (), readings, np.zeros(3), np.ones(3), parts, ())


@pytest.mark.parametrize("rms", [0.5, 2.0, 40.0])
def test_of_many_readings_tolerances_are_as_stated_and_the_noise_is_searched_as_far(rms: float) -> None:
    few, many = (grid_for(linear(MANY_OBSERVATIONS + more), rms) for more in (0, 1))
    assert many.classes == few.classes and len(few.inflation) > 1
    assert many.inflation == ((1.0, 1.0, 1.0),)
    assert many.noise[0] == 1.0 and many.noise[-1] == pytest.approx(few.noise[-1])
    gaps = np.diff(np.log(many.noise))
    assert len(gaps) >= 2
    np.testing.assert_allclose(gaps, gaps[0])
    assert gaps[0] <= 0.55 and (len(gaps) == 2 or gaps[0] * len(gaps) / (len(gaps) - 1) > 0.55)


def test_amplitudes_reach_from_nothing_to_ten_times_the_largest_expected() -> None:
    """docs/diagnosis.md: 21 values from 1e-4 to 10, four a decade."""
    np.testing.assert_allclose(np.log10(AMPLITUDES), np.linspace(-4.0, 1.0, 21), atol=1e-12)


# -- settings and names --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    folder: Path = tmp_path_factory.getbasetemp() / "search_laws"
    return read_machines(folder)["arm"]


LAGS = (0.0, 300.0, 900.0, 2700.0, 8100.0)


@pytest.mark.parametrize("own", range(len(LAGS)))
@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4), (4, 2, 0, 3, 1)])
def test_a_setting_is_sought_between_its_neighbours_on_the_grid(
    arm: Machine, own: int, order: Sequence[int]
) -> None:
    """At an end of the grid on one side; other places have grids of their own."""
    at = [with_effect(arm, "thermal-expansion", ("link1",), {"lag": LAGS[k]}) for k in order]
    elsewhere = [with_effect(arm, "thermal-expansion", ("link2",), {"lag": v + 1.0}) for v in LAGS]
    cat = Catalogue((*elsewhere, *at), (-2.0,) * 10, ())
    found = _setting(cat, 5 + list(order).index(own), "lag")
    assert found is not None
    assert (found.low, found.high) == (LAGS[max(own - 1, 0)], LAGS[min(own + 1, 4)])
    alone = Catalogue((*elsewhere, at[0]), (-2.0,) * 6, ())
    assert _setting(alone, 5, "lag") is None


TRIALS: list[tuple[Mapping[str, float], int, str]] = [
    ({"found": 1.0, "names": 3.0, "again": 2.0}, 1, "names"),
    ({"found": 3.0, "names": 2.0, "again": 1.0}, 1, "found"),
    ({"found": 1.0, "names": 2.0, "again": 3.0}, 1, "found"),
    ({"found": 2.0, "names": 1.0, "again": 3.0}, 1, "found"),
    ({"found": 1.0, "names": 3.0, "again": 2.0}, MANY_TERMS, "names"),
    ({"found": 1.0, "names": 3.0, "again": 2.0}, MANY_TERMS + 1, "found"),  # takes too long to tell
]


@pytest.mark.parametrize(("posterior", "count", "kept"), TRIALS)
def test_names_that_leave_something_unnamed_stay_where_their_posterior_is_the_highest(
    arm: Machine,
    monkeypatch: pytest.MonkeyPatch,
    posterior: Mapping[str, float],
    count: int,
    kept: str,
) -> None:
    """Each in its own fit: what was found first with something unnamed, names alone, and the search from there."""
    found, end = _second_trial(arm, monkeypatch, posterior, count, unnamed_again=True)
    assert found is end[kept]


def test_names_that_leave_nothing_unnamed_are_kept_whatever_the_posterior(
    arm: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    low = {"found": 3.0, "names": 2.0, "again": 1.0}
    found, end = _second_trial(arm, monkeypatch, low, 2, unnamed_again=False)
    assert found is end["again"]
    nothing, end = _second_trial(arm, monkeypatch, low, 0, unnamed_again=True)
    assert nothing is end["found"]


def _second_trial(
    arm: Machine,
    monkeypatch: pytest.MonkeyPatch,
    posterior: Mapping[str, float],
    count: int,
    *,
    unnamed_again: bool,
) -> tuple[Selection, dict[str, Selection]]:
    """What ``select`` ends at where searches and posteriors are these; ``count`` names are found without the unnamed."""
    scale = with_effect(arm, "actuator-scale", ("q1",))
    nameless = replace(scale, effect=cast(Effect, SimpleNamespace(slug="unknown")))
    cat = Catalogue((scale,) * (MANY_TERMS + 2) + (nameless,), (-2.0,) * (MANY_TERMS + 3), ())
    last = len(cat.candidates) - 1
    signatures = cast(Signatures, SimpleNamespace(linearise=lambda _: linear(60)))
    fit = cast(Estimate, SimpleNamespace())
    empty = Selection({}, fit, linear(60), grid_for(linear(60), 1.0), signatures, cat)
    names = dict.fromkeys(range(count), 1.0)
    end = {
        "found": replace(empty, accepted={last: 1.0}),
        "names": replace(empty, accepted=names),
        "again": replace(empty, accepted=names | ({last: 1.0} if unnamed_again else {})),
    }
    order = iter(("found", "names", "again"))
    monkeypatch.setattr(selection, "_settle", lambda *_: end[next(order)])
    monkeypatch.setattr(selection, "_sharpened", lambda found, *_: found)
    monkeypatch.setattr(selection, "restricted", lambda *_: empty)
    weight = {id(end[name]): value for name, value in posterior.items()}
    monkeypatch.setattr(selection, "log_posterior", lambda found: weight[id(found)])
    exclude: NDArray[np.bool_] = np.zeros(60, dtype=bool)
    return select(signatures, cat, fit, exclude, 1.0), end
