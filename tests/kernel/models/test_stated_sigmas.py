"""A sigma is a finite number above zero, a tolerance may be 0 or .inf, neither is .nan: said by file and field."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import pytest

from support.simulated import machine_from
from truepose.errors import InputError
from truepose.models.machine.builder import BuildContext
from truepose.models.machine.machine import Machine
from truepose.models.machine.sensor import Channel, Sensor, sensors

CAVITY = "beam: {xyz: [0, 0, 0], rx: 90}, mirror: {z: 1}, sigma: {distance: S}"
SECTIONS = {
    "angle": "{type: angle, sigma: {angle: R}}",
    "ballbar": "{type: ballbar, centre: [400, 100, 50], ball: [0, 0, 60], sigma: {distance: S}}",
    "direction": "{type: direction, sigma: {angle: R}}",
    "distance": f"{{type: distance, {CAVITY}}}",
    "irradiance": f"{{type: irradiance, wavelength: 1.55e-3, reflectivities: [0.04, 0.9], {CAVITY}}}",
    "pose": "{type: pose, sigma: {xyz: S, rot: R}}",
    "position": "{type: position, sigma: {xyz: S}}",
    "socket": "{type: socket, ball: [0, 0, 60], sigma: {xyz: S}}",
    "targets": "{type: targets, points: {P1: [1, 2, 3]}, sigma: {xyz: S}}",
    "tilt": "{type: tilt, sigma: {angle: R}}",
}
BAD_SIGMAS = ("0", "0.0", "-0.01", ".inf", "-.inf", ".nan", "true", "none")
ARM = """\
schema: truepose/machine/1
name: arm
gravity: [0, 0, -9.80665]
mechanism: {type: serial, joints: [{name: q1, kind: revolute, r: 300}]}
frames: {base: {in: world, tolerance: {xyz: 1, rpy: 1}}}
tolerances: {length: 0.1, angle: 0.1, q1.r: 0.2}
bounds: {q1.r: [0.0, 400]}
effects: [{effect: backlash, place: [q1], parameters: {b: {value: 0.01, unit: deg, std: 0.001}}}]
"""


def _load(folder: Path, sensor: str, arm: str = ARM) -> Machine:
    return machine_from(
        folder, f"{arm}sensor:\n- {{type: position, sigma: {{xyz: 1}}}}\n- {sensor}\n", "machine"
    )


def _refusal(folder: Path, sensor: str, arm: str = ARM) -> str:
    with pytest.raises(InputError) as caught:
        _load(folder, sensor, arm)
    return str(caught.value)


def test_every_kind_of_sensor_is_looked_at() -> None:
    own = {name for name in sensors if sensors.get(name, "").__module__.startswith("truepose.models.sensors")}
    assert own == set(SECTIONS)


@pytest.mark.parametrize("kind", sorted(SECTIONS))
@pytest.mark.parametrize("bad", BAD_SIGMAS)
def test_a_sigma_that_weighs_nothing_or_everything_is_refused(tmp_path: Path, kind: str, bad: str) -> None:
    section = SECTIONS[kind]
    checked = 0
    for letter in {"S", "R"} & {word.strip("{},") for word in section.split()}:
        whole = section.replace(" S", f" {bad}" if letter == "S" else " 0.01")
        message = _refusal(tmp_path, whole.replace(" R", f" {bad}" if letter == "R" else " 0.01"))
        turn = "angle" if "angle: R" in section else "rot"
        key = turn if letter == "R" else "distance" if "distance: S" in section else "xyz"
        unit = "deg" if letter == "R" else "mm"
        found = {"true": "True", "none": "'none'"}.get(bad, bad.replace(".inf", "inf").replace(".nan", "nan"))
        expected = f"sensor[1].sigma.{key}: expected a finite number > 0 ({unit}), found {found}"
        assert message == f"{tmp_path / 'machine.yaml'}: {expected}"
        checked += 1
    assert checked == section.count("S}") + section.count("S,") + section.count("R}")


@pytest.mark.parametrize("bad", [".nan", "-1"])
@pytest.mark.parametrize(
    ("stated", "field"),
    [
        ("xyz: 1, rpy", "frames.base.tolerance.xyz"),
        ("rpy: 1", "frames.base.tolerance.rpy"),
        ("length: 0.1", "tolerances.length"),
        ("angle: 0.1", "tolerances.angle"),
        ("q1.r: 0.2", "tolerances.q1.r"),
        ("std: 0.001", "effects[0].parameters.b.std"),
    ],
)
def test_a_tolerance_is_a_number(tmp_path: Path, stated: str, field: str, bad: str) -> None:
    key, _, value = stated.partition(": ")
    ending = ", rpy" if value.endswith("rpy") else ""
    message = _refusal(tmp_path, SECTIONS["position"], ARM.replace(stated, f"{key}: {bad}{ending}"))
    assert message.startswith(f"{tmp_path / 'machine.yaml'}: {field}: expected ")
    assert re.search(rf"number(s?) >= 0 or \.inf.*, found {bad.removeprefix('.')}$", message)


@pytest.mark.parametrize("stated", ["[.nan, 400]", "[0.0, .nan]"])
def test_a_bound_is_a_number(tmp_path: Path, stated: str) -> None:
    message = _refusal(tmp_path, SECTIONS["position"], ARM.replace("[0.0, 400]", stated))
    assert "machine.yaml: bounds.q1.r: expected [low, high]" in message


@pytest.fixture
def dial() -> str:
    """A sensor from outside that does not check its sigma."""

    @sensors.add("careless-dial")
    @dataclass(frozen=True)
    class Dial(Sensor):
        sigma: float
        type = "careless-dial"
        columns = {"height": "mm"}  # noqa: RUF012
        parameters = ()
        channels = property(lambda self: (Channel("height", "mm", self.sigma, "distance", "tip"),))

        @classmethod
        def build(cls, section: Mapping[str, Any], context: BuildContext) -> Dial:
            return cls(float(section["noise"]))

        def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
            return world[2, 3]

    return "{type: careless-dial, noise: S}"


@pytest.mark.parametrize("bad", ["0", "-1", ".inf", ".nan"])
def test_the_sigma_of_a_plugins_sensor_is_checked_too(tmp_path: Path, dial: str, bad: str) -> None:
    message = _refusal(tmp_path, dial.replace("S", bad))
    found = float(bad.replace(".", ""))
    assert message == (
        f"{tmp_path / 'machine.yaml'}: sensor[1]: found a sigma of {found} of 'height', expected a finite number > 0"
    )
