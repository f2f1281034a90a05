"""Numbers of the machine file with a unit of their own: the same as in the file's unit, and told when they cannot be."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.simulated import machine_from
from truepose.errors import InputError
from truepose.models.file.fields import quantity
from truepose.models.machine.machine import Machine

MACHINE = """
schema: truepose/machine/1
name: arm
units: {{length: m, angle: deg}}
gravity: [0, 0, -9.81]
mechanism:
  type: serial
  joints:
    - {{name: q1, kind: revolute, d: {d}}}
    - {{name: q2, kind: revolute, alpha: {alpha}}}
frames: {{tool: {{in: flange, xyz: {xyz}, tolerance: {{xyz: {tool}, rpy: {turn}}}}}}}
tolerances: {{length: {length}, angle: 0.05, q1.d: {override}}}
masses: {{link2: {{kg: {kg}, com: [0, 0, 0], in: link2}}}}
sensor: {{type: pose, sigma: {{xyz: {sigma}, rot: {rot}}}}}
"""
PLAIN = {
    "d": "0.4", "alpha": "-90", "xyz": "[0.12, 0, 0.001]", "tool": ".inf", "turn": "0.5", "length": "0.0002",
    "override": "0.00002", "kg": "0.5", "sigma": "0.00002", "rot": "0.001",
}  # fmt: skip
WITH_UNITS = {
    "d": "400mm", "alpha": "-1.5707963267948966 rad", "xyz": "[12 cm, 0, 1e-3 m]", "tool": ".inf mm",
    "turn": "30 arcmin", "length": "0.2mm", "override": "20um", "kg": "500 g", "sigma": "20um", "rot": "0.001 deg",
}  # fmt: skip


def _load(folder: Path, **fields: str) -> Machine:
    return machine_from(folder, MACHINE.format(**{**PLAIN, **fields}), "arm")


@pytest.mark.parametrize("field", PLAIN)
def test_a_number_with_its_unit_is_the_same(tmp_path: Path, field: str) -> None:
    plain, stated = _load(tmp_path), _load(tmp_path, **{field: WITH_UNITS[field]})
    for one, other in zip(plain.parameters, stated.parameters, strict=True):
        assert other.name == one.name
        assert other.nominal == pytest.approx(one.nominal, rel=1e-12)
        assert other.tolerance == pytest.approx(one.tolerance, rel=1e-12)
    assert [c.sigma for c in stated.channels] == pytest.approx([c.sigma for c in plain.channels], rel=1e-12)
    assert plain.file is not None
    assert stated.file is not None
    assert [mass.kg for mass in stated.file.masses.values()] == pytest.approx(
        [mass.kg for mass in plain.file.masses.values()]
    )


@pytest.mark.parametrize(
    ("field", "text", "expected"),
    [
        ("sigma", "20 deg", "sigma.xyz: expected a finite number > 0 .m., found '20 deg'"),
        ("sigma", "-20um", "sigma.xyz: expected a finite number > 0"),
        ("sigma", "20 lengths", "sigma.xyz: expected a finite number"),
        ("d", "20 20um", "d: expected a finite number"),
        ("override", "20 mrad", r"tolerances.q1.d: found '20 mrad', expected a number with a unit convertible to mm"),
        ("override", "-20um", "tolerances.q1.d: expected a number >= 0"),
        ("kg", "5 N", "kg: expected a finite number"),
    ],
)  # fmt: skip
def test_units_that_cannot_be_are_refused(tmp_path: Path, field: str, text: str, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        _load(tmp_path, **{field: text}).parameters  # noqa: B018


def test_texts_that_are_no_quantities() -> None:
    assert quantity("1.5e-3 m", "mm") == pytest.approx(1.5)
    assert quantity("1.5e-3m", "mm") == pytest.approx(1.5)
    assert quantity(20.0, "mm") is None
    assert quantity("20", "mm") is None
    assert quantity("um", "mm") is None
