"""What an experiment may vary: levels of every kind of factor, settings of several, and the rows that come of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from support import MACHINES
from support.command import input_error
from support.experiments import arm, poses
from truepose.identification.leaves.planning.discriminate.factors import (
    MOST,
    Factor,
    factors,
    read_offer,
    settings,
    unplanned,
)
from truepose.identification.leaves.planning.discriminate.race import Pool
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine


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
