"""Figures that effects promise: an hour, the session a machine stands in, whose thermometer serves, elastic legs' loads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from support.effect_machines import READINGS, read_machines
from support.effects import Solved, position, with_effect
from support.telescope_models import LOADED, machine_of
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.units import convert

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.getbasetemp() / "effect_laws")


@pytest.mark.parametrize("hours", [0.25, 1.0, 30.0])
def test_a_rate_per_hour_is_a_rate_per_second(machines: Mapping[str, Machine], hours: float) -> None:
    """``x`` is in mm/h, time in s: what has passed is the product of the two, in units of pint."""
    arm, q, rate, start = machines["arm"], READINGS["arm"], 0.036, 400.0
    drift = with_effect(arm, "mount-drift", ("base",), {"start": start}, x=rate)
    (unit,) = {c.unit for c in drift.coefficients if c.name == "x"}
    assert unit == "mm/h"
    seconds = float(convert(hours, "h", "s"))
    moved = position(arm, q, drift, time=start + seconds) - position(arm, q, drift, time=start)
    np.testing.assert_allclose(moved, [float(convert(rate, unit, "mm/s")) * seconds, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("slug", ["frame-shift", "zero-shift"])
def test_a_machine_stands_as_its_latest_session_left_it(machines: Mapping[str, Machine], slug: str) -> None:
    """Where no session is recorded every change between sessions lies in the past."""
    arm, q = machines["arm"], READINGS["arm"]
    place, value = (("base",), {"x": 2.0}) if slug == "frame-shift" else (("q2",), {"zero": 0.01})
    for session in (1.0, 2.0):
        moved = with_effect(arm, slug, place, {"session": session}, **value)
        model = symbolic_model(arm, (moved,))
        usual = Solved(model, q, **dict(zip(model.drivers, model.z_home.tolist(), strict=True))).position
        np.testing.assert_allclose(usual, position(arm, q, moved, session=1.0), atol=1e-12)
        assert np.linalg.norm(usual - position(arm, q, moved, session=0.0)) > 1.0


@pytest.mark.parametrize("warm", range(1, 7))
def test_the_one_thermometer_of_a_machine_serves_all_legs(machines: Mapping[str, Machine], warm: int) -> None:
    """Named by the machine file's drivers, or by its number among the legs."""
    telescope, legs = machines["telescope"], tuple(f"leg{k}" for k in range(1, 7))
    own = f"temperature.leg{warm}"
    stated = replace(telescope, drivers=("time", own))
    assert with_effect(stated, "thermal-expansion", legs).drivers == (own,)
    every = replace(telescope, drivers=tuple(f"temperature.{leg}" for leg in legs))
    assert with_effect(every, "thermal-expansion", legs).drivers == every.drivers
    numbered = {"lag": 300.0, "thermometer": float(warm)}
    assert with_effect(telescope, "thermal-expansion", legs, numbered).drivers == (f"{own}~300",)
    assert with_effect(telescope, "thermal-expansion", legs).drivers == tuple(
        f"temperature.{leg}" for leg in legs
    )


def heights(folder: Path, machine: Machine, loads: list[float]) -> Array:
    """(n,) z of the tool at home under recorded payloads, mm."""
    columns = [*machine.mechanism.readings, *(c for s in machine.sensors for c in s.columns)]
    frame = pd.DataFrame(np.zeros((len(loads), len(columns))), columns=columns).assign(payload=loads)
    frame.to_csv(folder / "loads.csv", index=False)
    predictor = Predictor(machine, load_recording(machine, [folder / "loads.csv"]))
    poses, good = predictor.poses(predictor.model.p_home)
    assert good.all()
    return np.asarray(poses[:, 2, 3])


def test_elastic_legs_sag_by_the_recorded_payload(tmp_path: Path) -> None:
    """In proportion to it (the legs are linear springs), and by as much as under a mass of that weight in the file."""
    empty = [(old, new.replace("kg: 20", "kg: 0")) for old, new in LOADED]
    z = heights(tmp_path, machine_of(tmp_path, "stiffness", *empty), [0.0, 10.0, 20.0])
    sag = z[0] - z
    assert sag[2] > 5e-4
    assert sag[1] == pytest.approx(sag[2] / 2, rel=1e-3)
    fixed = heights(tmp_path, machine_of(tmp_path, "stiffness", *LOADED), [20.0])
    assert z[2] == pytest.approx(fixed[0], abs=1e-9)


def test_classes_of_parts_go_by_their_unit(machines: Mapping[str, Machine]) -> None:
    """What has no class of its own is a length in mm, or an angle in rad or as a direction's component."""
    every = {(p.part, p.unit) for machine in machines.values() for p in machine.parameters}
    assert {unit for part, unit in every if part == "length"} == {"mm"}
    assert {unit for part, unit in every if part == "angle"} == {"rad", "1"}
