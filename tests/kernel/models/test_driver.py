"""A driver's name says its kind, place and memory; its unit and default are the same wherever it is met."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.generated_c import built_of, needs_compiler
from support.machine_texts import machine_from
from truepose import parse_effect, predict
from truepose.codegen.c import generate
from truepose.identification.recording.load import load_recording
from truepose.identification.report.curves import columns
from truepose.models.effects.base import Coefficient, Effect, PlacedEffect
from truepose.models.file.driver import AIR, Driver
from truepose.models.machine.kinematics import driver_default

KINDS = ("payload", "pressure", "humidity", "temperature", "approach", "velocity", "session", "time", "tilt")
PLACES = st.one_of(st.just(""), st.from_regex(r"[a-z][a-z0-9_]{0,6}(\.[a-z]{1,3})?", fullmatch=True))
JOINTS = {"q1": "rad", "slide": "mm", "motor": "turn"}
ARM = """
schema: truepose/machine/1
name: arm
mechanism: {type: serial, joints: [{name: q1, kind: revolute, r: 300, range: [-150, 150]}]}
sensor: {type: position, sigma: {xyz: 0.02}}
"""


@given(st.sampled_from(KINDS), PLACES, st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=3))
def test_a_driver_is_read_back_from_its_name(kind: str, place: str, numbers: list[float]) -> None:
    driver = Driver(kind, place, tuple(numbers))
    assert Driver.of(driver.name) == driver
    assert Driver.of(driver.name).now == Driver(kind, place)


@given(st.text())
def test_any_text_is_a_driver_of_some_kind(name: str) -> None:
    driver = Driver.of(name)
    assert Driver.of(driver.name) == driver and np.isfinite(driver.default)


@pytest.mark.parametrize(
    ("name", "unit", "default"),
    [
        ("humidity", "%", 50.0),
        ("pressure", "hPa", 1013.25),
        ("temperature.arm~300", "degC", 20.0),
        ("session.after.2", "1", 1.0),
        ("velocity.q1", "rad/s", 0.0),
        ("stop.slide~0.1", "mm", 0.0),
        ("creep.motor~2", "turn", 0.0),
        ("velocity.elsewhere", "", 0.0),
        ("tilt.column", "", 0.0),
    ],
)
def test_unit_and_default_follow_from_the_kind(name: str, unit: str, default: float) -> None:
    driver = Driver.of(name)
    assert (driver.unit(JOINTS), driver.default) == (unit, default)


def test_the_air_serves_temperatures_alone() -> None:
    assert Driver.of("temperature.arm").served_by({AIR}) == AIR
    assert Driver.of("temperature.arm").served_by({AIR, "temperature.arm"}) == "temperature.arm"
    assert Driver.of("pressure").served_by({AIR}) == "pressure"


class Swelling(Effect):
    """A base that swells with the humidity."""

    slug = "swelling"

    def places(self, machine: object) -> list[tuple[str, ...]]:
        return [("base",)]

    def coefficients(self, machine: object, place: object, settings: object) -> tuple[Coefficient, ...]:
        return (Coefficient("k", "mm/%", 1e-3),)

    def drivers(self, machine: object, place: object, settings: object) -> tuple[str, ...]:
        return ("humidity",)

    def shifts(self, site):  # type: ignore[no-untyped-def]
        return {"base.motion.z": site.c["k"] * site.driver("humidity")}


def test_humidity_is_known_wherever_a_driver_is_met(tmp_path: Path) -> None:
    machine = machine_from(tmp_path, ARM, "arm")
    wet = machine.with_effects((PlacedEffect.at(Swelling(), machine, ("base",)),))
    frame = pd.DataFrame(
        {"q1": [0.0, 9.0, 30.0], "x": 300.0, "y": 0.0, "z": 0.0, "humidity [1]": [0.4, 0.5, 0.6]}
    )
    frame.to_csv(tmp_path / "rows.csv", index=False)
    recording = load_recording(machine, [tmp_path / "rows.csv"])
    humidity = recording.driver("humidity")
    assert humidity is not None and np.allclose(humidity, [40.0, 50.0, 60.0])
    assert [c.title for c in columns(machine, recording) if c.name == "humidity"] == ["humidity [%]"]
    assert driver_default(machine, "humidity") == 50.0
    generate(wet, tmp_path / "c")
    assert "arm_Z_humidity 0 /* %: humidity */" in (tmp_path / "c" / "arm_kin.h").read_text(encoding="utf-8")


DRIFTS = {
    "a rate": "{effect: mount-drift, place: [base], start: 1.8e9, parameters: {x: {value: 0.1, unit: mm/h}}}",
    "a settling": "{effect: mount-drift, place: [base], start: 1.8e9, tau: 900, parameters: {x: {value: 0.1, unit: mm}}}",
    "a form": "{effect: empirical, place: [q1], degree: 1, from.time: 1.8e9, to.time: 1.8000036e9, "
    "parameters: {c1: {value: 1.0e-4, unit: rad}}}",
}


@needs_compiler
@pytest.mark.parametrize("named", [["a rate"], ["a settling"], ["a form"], [*DRIFTS]], ids=str)
def test_without_a_clock_the_c_stands_where_a_drift_began(named: list[str], tmp_path: Path) -> None:
    """Defaults predict what the times of the recording do, but for the drift in it: seconds since 1970 are years beyond it."""
    entries = "".join(f"  - {DRIFTS[name]}\n" for name in named)
    machine = machine_from(tmp_path, f"{ARM.strip()}\neffects:\n{entries}", "arm")
    built = built_of(machine, tmp_path / "c", "double")
    q = np.array([0.3])
    (code, alone), *recorded = (
        built.fk(q, z=z) for z in (None, *(1.8e9 + np.linspace(0.0, 3600.0, 5)[:, None]))
    )
    assert code == 0 and all(code == 0 for code, _ in recorded)
    assert np.ptp([pose for _, pose in recorded], axis=0).max() > 1e-5
    assert np.array_equal(alone, recorded[0][1])
    row = pd.DataFrame({"q1 [rad]": q})
    pose = predict(machine, row)[["pose.x", "pose.y", "pose.z"]].to_numpy()
    assert np.allclose(pose, alone[3::4], rtol=0, atol=1e-9)


def test_a_drift_that_is_named_begins_with_those_of_the_machine(tmp_path: Path) -> None:
    for name, drift in DRIFTS.items():
        machine = machine_from(tmp_path, f"{ARM.strip()}\neffects:\n  - {drift}\n", name)
        for text, start in (("x=1", 1.8e9), ("x=1,start=60", 60.0)):
            named = parse_effect(f"mount-drift@tool:{text}", machine)
            assert named.settings_map["start"] == start
            assert driver_default(machine, "time", [named]) == 1.8e9
