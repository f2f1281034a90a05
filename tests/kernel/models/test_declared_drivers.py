"""Drivers that a machine file declares: their units and what they drive; what is wrong is told with file and field."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.short_arm import FRAMES, HEAD, JOINTS, POSE
from support.simulated import machine_from
from truepose.errors import InputError
from truepose.models.file.driver import DeclaredDriver, Driver
from truepose.models.machine.machine import Machine


def declaring(folder: Path, drivers: str) -> Machine:
    return machine_from(folder, HEAD + JOINTS + FRAMES + POSE + f"drivers: {drivers}\n", "arm")


def test_names_and_mappings_stand_side_by_side(tmp_path: Path) -> None:
    machine = declaring(
        tmp_path, "[temperature.base, payload, approach, torque.q2, {name: tilt.column, unit: deg}]"
    )
    assert machine.drivers == ("temperature.base", "payload", "approach", "torque.q2", "tilt.column")
    assert machine.declared("torque.q2") == DeclaredDriver("torque.q2", "N*m", "N*m", "load")
    tilt = machine.declared("tilt.column~300")
    assert tilt == DeclaredDriver("tilt.column", "rad", "deg", "coupling")
    assert machine.driver_unit("tilt.column") == "rad" and machine.driver_unit("humidity") == "%"
    assert machine.declared("pressure") is None


@pytest.mark.parametrize(
    ("unit", "inside", "drives"),
    [
        ("kN", "N", "load"),
        ("lbf*ft", "N*m", "load"),
        ("mA", "mA", "load"),
        ("bar", "hPa", "load"),
        ("g", "kg", "load"),
        ("kelvin", "degC", "temperature"),
        ("kW", "kW", "temperature"),
        ("minute", "s", "time"),
        ("um", "mm", "coupling"),
        ("V", "V", "coupling"),
    ],
)
def test_a_unit_says_what_a_column_drives(tmp_path: Path, unit: str, inside: str, drives: str) -> None:
    (known,) = declaring(tmp_path, f"[{{name: it, unit: '{unit}'}}]").declared_drivers
    assert (known.unit, known.written, known.drives) == (inside, unit, drives)


def test_a_file_may_say_it_itself(tmp_path: Path) -> None:
    machine = declaring(tmp_path, "[{name: heater, unit: V, drives: temperature}, {name: it}]")
    assert machine.drives("heater") == "temperature" and machine.drives("it") == "coupling"


@pytest.mark.parametrize(
    ("drivers", "said"),
    [
        ("[{name: torque.q2, unit: deg}]", "drivers[0].unit: unit 'deg' is an angle, expected a unit convertible to N*m"),
        ("[payload, {name: it, unit: foo}]", "drivers[1].unit: unknown unit 'foo'"),
        ("[{name: it, units: deg}]", "drivers[0].units: unknown field; did you mean 'unit'?, found 'deg'"),
        ("[{unit: deg}]", "drivers[0].name: missing field"),
        ("[{name: q1, unit: deg}]", "drivers[0].name: found 'q1', a joint, expected a column beyond the joints"),
        ("[{name: it, drives: heat}]", "drivers[0].drives: expected 'load'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_file_and_field(tmp_path: Path, drivers: str, said: str) -> None:
    with pytest.raises(InputError) as told:
        declaring(tmp_path, drivers)
    assert str(told.value).startswith(f"{tmp_path / 'arm.yaml'}: {said}")


@pytest.mark.parametrize(
    ("unit", "name", "inside"), [("A", "current.q2", "A"), ("lbf*ft", "torque.q2", "N*m")]
)
def test_a_column_may_be_of_a_joint(tmp_path: Path, unit: str, name: str, inside: str) -> None:
    machine = declaring(tmp_path, f"[payload, {{name: axis2, unit: '{unit}', of: q2}}]")
    assert machine.drivers == ("payload", name)
    known = machine.declared(name)
    assert known is not None
    assert (known.column, known.unit, known.written, known.everywhere) == ("axis2", inside, unit, False)
    said = declaring(tmp_path, f"[{{name: axis2, unit: '{unit}', of: q2, drives: load}}]").declared(name)
    assert said is not None and said.everywhere


@pytest.mark.parametrize(
    ("drivers", "said"),
    [
        ("[{name: i, unit: A, of: q9}]", "drivers[0].of: found 'q9', expected a joint; known: q1"),
        ("[{name: i, of: q2}]", "drivers[0].unit: found None, expected N*m or A: what the drive of q2 holds"),
        ("[{name: i, unit: degC, of: q2}]", "drivers[0].unit: found 'degC', expected N*m or A"),
        ("[current.q2, {name: i, unit: A, of: q2}]", "drivers[1].of: found 'q2', of which 'current.q2' already is"),
    ],
)  # fmt: skip
def test_a_column_of_a_joint_that_cannot_be_is_told(tmp_path: Path, drivers: str, said: str) -> None:
    with pytest.raises(InputError) as told:
        declaring(tmp_path, drivers)
    assert str(told.value).startswith(f"{tmp_path / 'arm.yaml'}: {said}")


def test_what_a_slides_drive_holds_is_a_force() -> None:
    joints = {"q1": "rad", "slide": "mm", "long": "in", "motor": "turn"}
    units = {name: Driver("torque", name).unit(joints) for name in joints}
    assert units == {"q1": "N*m", "slide": "N", "long": "N", "motor": "N*m"}
    assert not Driver.of("torque.q1").smooth and Driver.of("tilt.column").smooth
    assert Driver.of("pressure.oil").smooth and not Driver.of("pressure").smooth
