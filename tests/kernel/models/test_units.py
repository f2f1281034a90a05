"""Units: conversions are exact laws, and every wrong unit is refused by name."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from truepose.errors import InputError
from truepose.models.file.fields import (
    Angle,
    AngleToleranceVector,
    Gain,
    LengthTolerance,
    LengthVector,
    Number,
    Section,
)
from truepose.models.units import UnitSystem, convert, parse_unit

PAIRS = [
    ("um", "mm"),
    ("m", "mm"),
    ("deg", "rad"),
    ("arcsec", "rad"),
    ("turn", "rad"),
    ("degF", "degC"),
    ("K", "degC"),
    ("urad/(N*m)", "rad/(N*m)"),
    ("um/m/K", "1/K"),
    ("%", "1"),
    ("bar", "hPa"),
]


@pytest.mark.parametrize(("unit", "other"), PAIRS)
@given(value=st.floats(-1e6, 1e6))
def test_there_and_back_is_where_it_began(unit: str, other: str, value: float) -> None:
    back = convert(convert(value, unit, other), other, unit)
    assert back == pytest.approx(value, rel=1e-12, abs=1e-9)


def test_known_values() -> None:
    assert convert(1.0, "um", "mm") == 0.001
    assert convert(180.0, "deg", "rad") == math.pi
    assert convert(20.0, "degC", "degC") == 20.0
    assert convert(75.0, "mm/turn", "mm/turn") == 75.0
    assert convert(1.0, "m/turn", "mm/turn") == pytest.approx(1000.0, rel=1e-14)
    assert convert(2.0, "1/(N*m)", "rad/(N*m)") == 2.0


@pytest.mark.parametrize(
    ("text", "dimension"),
    [
        ("milimeters", "length"),
        ("deg", "length"),
        ("mm", "angle"),
        ("1", "angle"),
        ("%", "angle"),
        ("deg", "number"),
        ("turn", "1"),
        ("kg", "reading"),
        ("mm/N", "rad/(N*m)"),
        ("5 mm", "length"),
        ("9**9**9**9", "length"),
        ("m**", "length"),
        ("", "length"),
        (3, "length"),
        (None, "angle"),
    ],
)
def test_wrong_units_are_refused_with_place_and_expectation(text: object, dimension: str) -> None:
    with pytest.raises(InputError, match=r"m\.yaml: units\.length: .*expected") as caught:
        parse_unit(text, dimension, "m.yaml: units.length")
    assert repr(text) in str(caught.value)


class _Part(Section):
    a: LengthVector
    turn: Angle = 0.0
    gain: Gain = 1.0
    share: Number = 0.0
    sigma: LengthTolerance = 0.0
    spread: AngleToleranceVector = (0.0, 0.0, 0.0)


def test_fields_convert_from_the_files_units() -> None:
    units = UnitSystem("m", "deg", "turn")
    data = {"a": [1, 2, 3], "turn": 90, "gain": 0.07, "sigma": math.inf, "spread": 180}
    part = _Part.model_validate(data, context={"units": units})
    assert part.a == (1000.0, 2000.0, 3000.0)
    assert part.turn == math.pi / 2
    assert part.gain == pytest.approx(70.0)
    assert part.sigma == math.inf
    assert part.spread == (math.pi, math.pi, math.pi)


@pytest.mark.parametrize("field", ["turn", "gain", "share", "sigma"])
@pytest.mark.parametrize("value", ["1", True, None, math.nan, -math.inf, [1.0]])
def test_what_is_no_number_is_refused(field: str, value: object) -> None:
    with pytest.raises(ValidationError):
        _Part.model_validate({"a": [0, 0, 0], field: value})
