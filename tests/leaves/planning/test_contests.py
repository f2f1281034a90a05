"""Contests between explanations against matrices as large as the readings, and what an experiment may vary for them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from support import MACHINES
from support.command import input_error
from support.experiments import arm, poses
from truepose.arrays import Array, Index
from truepose.identification.leaves.planning.discriminate.factors import (
    EXPECTED,
    MOST,
    Explanation,
    Factor,
    explanation,
    factors,
    read_offer,
    settings,
    unplanned,
)
from truepose.identification.leaves.planning.discriminate.hypotheses import (
    RIVAL_FORMS,
    Field,
    Hypothesis,
    hypotheses,
    ordered,
    race,
    shares,
)
from truepose.identification.leaves.planning.discriminate.pool import Pool
from truepose.identification.leaves.planning.discriminate.rows import WIDE, Signals
from truepose.models.effects.base import PlacedEffect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

ROWS, READINGS, CONSTANTS = 14, 2, 3
FORMS = 5
YIELDS, UNEVEN, PLAY, GAIN = 0, 1, 1 + 2 * FORMS, 2 + 2 * FORMS
"""Where the columns of each effect begin: one of compliance, two of each order of a wave, one of play, one of gain."""
WIDTH = 3 + 2 * FORMS


def part(text: str) -> PlacedEffect:
    return explanation(text, arm()).forms[0][0]


WAVES = tuple(part(f"transmission-error@q2:order={k}") for k in range(1, FORMS + 1))
PARTS = (part("joint-compliance@q2"), *WAVES, part("backlash@q3"), part("actuator-scale@q1"))
COLUMNS = (
    slice(0, 1),
    *(slice(1 + 2 * k, 3 + 2 * k) for k in range(FORMS)),
    slice(PLAY, GAIN),
    slice(GAIN, WIDTH),
)


def drawn(seed: int = 0) -> Signals:
    """Random rows; the constants differ a thousandfold in size, and the third wave comes close to the compliance."""
    rng = np.random.default_rng(seed)
    geometry = rng.standard_normal((ROWS, READINGS, CONSTANTS)) * [0.3, 30.0, 1.0]
    effects = 40.0 * rng.standard_normal((ROWS, READINGS, WIDTH))
    effects[:, :, 5] = 0.7 * effects[:, :, YIELDS] + 0.1 * effects[:, :, 5]
    return Signals(("a", "b", "c"), geometry, effects, np.array([1.0, 0.04, 25.0]), COLUMNS)


def field(rows: Signals, *others: PlacedEffect, earlier: Signals | None = None) -> Field:
    base = np.zeros((CONSTANTS + WIDTH,) * 2) if earlier is None else earlier.gram
    return Field(rows, base, PARTS, others)


def dense(rows: Signals, signal: Array, wide: Index | list[int]) -> float:
    """What of a signal (n,) constants within their tolerances and effects ``wide`` of any size leave, in chi2."""
    geometry, effects = (a.reshape(-1, a.shape[2]) for a in (rows.geometry, rows.effects))
    covariance = np.eye(len(geometry)) + (geometry / rows.precision) @ geometry.T
    covariance += WIDE**2 * effects[:, wide] @ effects[:, wide].T
    return float(signal @ np.linalg.solve(covariance, signal))


def signal(rows: Signals, columns: list[int], amplitude: Array) -> Array:
    return np.asarray(rows.effects.reshape(-1, WIDTH)[:, columns] @ amplitude)


@pytest.mark.parametrize("beside", [False, True])
def test_a_rival_imitates_as_much_as_it_can_beside_all_that_may_be_there(beside: bool) -> None:
    rows = drawn()
    at = field(rows, *(PARTS[-2:-1] if beside else ()))
    also = [PLAY] if beside else []
    true, rival, size = [YIELDS], [5, 6], np.array([[0.5]])
    left, answer = at.imitated(at.rows.gram, np.array(true), size, np.array(rival))
    told = signal(rows, true, size[:, 0])
    whole, missed = dense(rows, told, also), dense(rows, told, [*also, *rival])
    assert 0.0 < left < 0.5 and left == pytest.approx(missed / whole, rel=1e-6)
    # its coefficients are those that leave the least
    least = dense(rows, told - signal(rows, rival, answer[:, 0]), also)
    for change in 1e-2 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]):
        assert dense(rows, told - signal(rows, rival, answer[:, 0] + change), also) > least


def explained() -> tuple[Explanation, Explanation, Explanation]:
    """Compliance of a known size, waves of five orders, play."""
    yields = Explanation("joint-compliance", ("q2",), ((PARTS[0],),), np.array([0.5]))
    waves = Explanation("transmission-error", ("q2",), tuple((wave,) for wave in WAVES))
    return yields, waves, Explanation("backlash", ("q3",), ((part("backlash@q3"),),))


def everywhere(at: Field) -> Array:
    return np.asarray(at.rows.gram + at.base)


def test_what_is_thought_of_is_as_large_as_it_imitates_or_as_the_catalogue_expects() -> None:
    """The third order imitates more than half of the compliance; of play no size is known."""
    at = field(drawn())
    gram = everywhere(at)
    yields, waves, play = hypotheses(at, explained(), gram, gram)
    assert yields.true.tolist() == [YIELDS] and yields.amplitude.tolist() == [[0.5]]
    assert waves.true.tolist() == [5, 6]
    _, answer = at.imitated(gram, yields.true, yields.amplitude, waves.true)
    np.testing.assert_allclose(waves.amplitude, answer)
    assert play.true.tolist() == [PLAY] and play.amplitude.tolist() == [[EXPECTED]]
    bare = hypotheses(at, explained()[1:], gram, gram)
    assert bare[0].true.tolist() == [1, 2] and bare[0].amplitude.tolist() == (EXPECTED * np.eye(2)).tolist()


def test_rival_versions_are_those_that_come_closest() -> None:
    at = field(drawn())
    gram = everywhere(at)
    found = hypotheses(at, explained()[:2], gram, gram)
    versions = np.array([(1 + 2 * k, 2 + 2 * k) for k in range(FORMS)])
    left = [at.imitated(gram, found[0].true, found[0].amplitude, version)[0] for version in versions]
    expected = versions[np.argsort(left)[:RIVAL_FORMS]].tolist()
    assert [rival.tolist() for rival in found[1].rivals] == expected
    assert [rival.tolist() for rival in found[0].rivals] == [[YIELDS]]


def some(at: Field) -> tuple[Hypothesis, ...]:
    """The waves with two rival versions, and cases of unknown sign."""
    yields, waves, play = explained()
    return (
        Hypothesis(yields, np.array([YIELDS]), np.array([[0.5]]), (np.array([YIELDS]),)),
        Hypothesis(waves, np.array([1, 2]), 0.1 * np.eye(2), (np.array([1, 2]), np.array([5, 6]))),
        Hypothesis(play, np.array([PLAY]), np.array([[0.3]]), (np.array([PLAY]),)),
    )


@pytest.mark.parametrize("beside", [False, True])
def test_a_pair_is_worth_half_of_what_the_best_version_of_its_rival_leaves(beside: bool) -> None:
    rows = drawn(3)
    at = field(rows, *(PARTS[-1:] if beside else ()))
    found, design = some(at), [1, 3, 4, 9]
    on, taken = race(at, found), rows.take(np.array(design))
    values = on.values(design)
    for (i, j), value in zip(ordered(3), values, strict=True):
        cases = [signal(taken, found[i].true.tolist(), a) for a in found[i].amplitude.T]
        also = [GAIN] if beside else []
        expected = min(
            sum(dense(taken, case, [*also, *rival.tolist()]) for case in cases) for rival in found[j].rivals
        )
        assert value == pytest.approx(0.5 * expected, rel=1e-5)
    assert on.pairs == 6 and on.counted.all()


def test_what_no_row_tells_apart_does_not_count_nor_do_twins() -> None:
    rows = drawn(3)
    rows.effects[:, :, PLAY] = 3.0 * rows.effects[:, :, YIELDS]  # play does what compliance does
    at = field(rows)
    on = race(at, some(at))
    assert on.counted.tolist() == [{i, j} != {0, 2} for i, j in ordered(3)]
    encoder = Explanation("encoder-eccentricity", ("q2",), ((part("encoder-eccentricity@q2:order=1"),),))
    series = Explanation("transmission-error", ("q2",), ((part("transmission-error@q2:orders=60"),),))
    for rival, counted in ((encoder, False), (replace(encoder, place=("q3",)), True)):
        pair = [replace(some(at)[1], explanation=series), replace(some(at)[2], explanation=rival)]
        assert race(at, pair).counted.tolist() == [counted, counted]


def test_the_share_of_a_signal_is_that_of_all_rows_together() -> None:
    rows, earlier = drawn(4).take(np.arange(9)), drawn(5)
    at = field(rows, earlier=earlier)
    found = some(at)
    on = race(at, found)
    told = shares(at, found, on)
    values = on.values(list(range(9)))
    for (i, _), share, value in zip(ordered(3), told, values, strict=True):
        every = sum(
            float(np.sum(signal(one, found[i].true.tolist(), a) ** 2))
            for one in (rows, earlier)
            for a in found[i].amplitude.T
        )
        assert share == pytest.approx(value / (0.5 * every), rel=1e-9) and 0.0 < share <= 1.0


def reads(*drivers: str, load: bool = False, slug: str = "some", **settings: float) -> Any:
    """A part that reads these drivers."""
    effect = SimpleNamespace(slug=slug)
    return SimpleNamespace(drivers=drivers, needs_load=load, effect=effect, settings_map=settings)


@pytest.mark.parametrize(
    ("driver", "factor"),
    [
        ("approach.q2", Factor("approach.q2", (1.0, -1.0), 1.0)),
        ("stop.q2~0.01", Factor("approach.q2", (1.0, -1.0), 1.0)),
        ("time", Factor("time", (0.0, 1800.0, 3600.0, 5400.0, 7200.0), 0.0)),
        ("session.after.2", Factor("session", (1.0, 2.0), 1.0)),
        ("pressure", Factor("pressure", (1013.25,), 1013.25)),
        ("humidity", Factor("humidity", (50.0,), 50.0)),
        ("temperature.link2~300", Factor("temperature.link2", (20.0,), 20.0)),
        ("payload", Factor("payload", (0.0,), 0.0)),
        ("velocity.q1", Factor("velocity.q1", (0.0,), 0.0)),
        ("torque.q2", None),  # nobody can hold it
        ("creep.q1~0.1", None),
    ],
)
def test_a_driver_that_nobody_offers_is_held(driver: str, factor: Factor | None) -> None:
    found = factors(arm(), [reads(driver), reads(driver)], {})
    assert found == (() if factor is None else (factor,))


def test_an_experiment_begins_no_earlier_than_a_drift() -> None:
    """Of a recording with seconds since 1970: at time 0 a drift at a constant rate was 50 m away."""
    (found,) = factors(arm(), [reads("time"), reads("time", start=1.8e9)], {})
    assert found == Factor(
        "time", (1.8e9, 1.8e9 + 1800.0, 1.8e9 + 3600.0, 1.8e9 + 5400.0, 1.8e9 + 7200.0), 1.8e9
    )


@pytest.mark.parametrize(
    ("driver", "levels", "nominal"),
    [
        ("temperature.link2", (10.0, 18.0, 30.0), 18.0),  # the level next to what the file means
        ("temperature.link2", (26.0,), 26.0),
        ("time", (60.0, 120.0), 60.0),
        ("torque.q2", (-1.0, 0.5, 4.0), 0.5),
    ],
)
def test_levels_that_are_offered_take_the_place_of_usual_ones(
    driver: str, levels: tuple[float, ...], nominal: float
) -> None:
    offer = {driver: levels, "pressure": (990.0, 1000.0)}
    (found,) = factors(arm(), [reads(driver)], offer)
    assert found == Factor(driver, levels, nominal)


def test_loads_are_varied_where_a_machine_has_masses_and_an_explanation_asks_for_them() -> None:
    bare = load_machine(MACHINES / "pus.yaml")
    for machine, load, expected in ((arm(), True, ["payload"]), (arm(), False, []), (bare, True, [])):
        assert [f.driver for f in factors(machine, [reads(load=load)], {})] == expected


def test_offers_are_sorted_levels_each_once() -> None:
    offer = read_offer(
        arm(), "5,0,2.5,5", [" pressure = 1000,990", "velocity.q2=3", "temperature.tool=21,20"]
    )
    assert offer == {
        "payload": (0.0, 2.5, 5.0), "pressure": (990.0, 1000.0), "velocity.q2": (3.0,), "temperature.tool": (20.0, 21.0),
    }  # fmt: skip
    assert read_offer(arm()) == {} and read_offer(arm(), "0") == {"payload": (0.0,)}
    assert read_offer(arm(), named=["temperature.shelf=20"]) == {"temperature.shelf": (20.0,)}
    for text in ("velocity.q9=1", "pressure", "payload=1", "=1,2"):
        with input_error("expected DRIVER=value,value"):
            read_offer(arm(), named=[text])
    for wrong, meant in (("temperatur.link2", "temperature.link2"), ("presure", "pressure"), ("velocty.q3", "velocity.q3"),
                         ("temprature.tool", "temperature.tool"), ("temperatur.air", "temperature.air")):  # fmt: skip
        with input_error(f"did you mean .*{meant}"):
            read_offer(arm(), named=[f"{wrong}=1,2"])


def test_what_has_a_past_is_noted_each_with_its_effect() -> None:
    parts = [
        reads("creep.q1~0.1", slug="a"), reads("step.q1", slug="b"), reads("loop.q2~0.1", slug="c"),
        reads("stop.q2~0.1", "time", slug="d"), reads("payload", "approach.q1", slug="e"),
    ]  # fmt: skip
    expected = [("strokes", "c"), ("strokes", "d"), ("creep", "a"), ("motions", "b")]
    assert [(note.kind, note.about) for note in unplanned(parts)] == expected


def test_half_of_the_settings_that_are_tried_are_extremes_where_there_are_so_many() -> None:
    """Of 81 settings: as the machine stands, eleven of sixteen corners, and others whatever they are."""
    varied = [Factor(name, (0.0, 1.0, 2.0), 1.0) for name in "abcd"]
    found = settings(varied, np.random.default_rng(3))
    assert found[0].tolist() == [1.0] * 4 and len(np.unique(found, axis=0)) == len(found) == MOST
    corners = np.all(found != 1.0, axis=1)
    assert corners[1 : MOST // 2].all() and not corners[MOST // 2 :].all()


def test_rows_to_choose_from_vary_what_is_offered_and_hold_the_rest() -> None:
    varied = (
        Factor("payload", (0.0, 2.5, 5.0), 0.0),
        Factor("temperature.link2", (20.0,), 20.0),
        Factor("approach.q2", (1.0, -1.0), 1.0),
        Factor("approach.q3", (1.0, -1.0), 1.0),
    )
    given = poses(arm(), 10)
    pool = Pool.of(arm(), varied, given, np.random.default_rng(0))
    assert {row.tobytes() for row in pool.rows.q} == {row.tobytes() for row in given}
    assert len(pool.rows) == 10 * 3 * 2 * 2 and np.sum(pool.nominal) == 10
    for factor in varied:
        assert set(pool.rows.drivers[factor.driver]) == set(factor.levels)
        assert set(pool.rows.drivers[factor.driver][pool.nominal]) == {factor.nominal}


def test_poses_that_are_drawn_are_short_numbers_and_those_that_are_given_stay() -> None:
    machine: Machine = arm()
    drawn = Pool.of(machine, (), None, np.random.default_rng(0)).rows.q
    assert len(drawn) > 100
    np.testing.assert_allclose(drawn[:, 0] * 1e4, np.round(drawn[:, 0] * 1e4), atol=1e-6)  # of 300 mm
    given = poses(machine, 3)
    kept = Pool.of(machine, (), given, np.random.default_rng(0)).rows.q
    assert sorted(kept[:, 0]) == sorted(given[:, 0])
