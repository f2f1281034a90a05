"""Numbers, texts with units and settings of machine files: what fits, at both sides of every limit, and in which words not."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest
from pydantic import ValidationError

from truepose.errors import InputError
from truepose.models.file.driver import AIR, Driver, driven_by_unit
from truepose.models.file.fields import (
    AngleTolerance,
    FilePart,
    Length,
    LengthSigma,
    LengthTolerance,
    LengthToleranceVector,
    LengthVector,
    Number,
    NumberTolerance,
    Pitch,
    as_number,
    input_error,
    is_quantity,
    quantity,
    with_texts,
)
from truepose.models.file.formula import Formula, Law
from truepose.models.file.formula_checks import no_formula, no_readings, no_shifts
from truepose.models.file.limits import LARGEST, LATEST, SMALLEST, positive, within
from truepose.models.machine.placed import (
    ANY,
    COLUMN,
    COUNT,
    DURATION,
    HARMONIC,
    NOT_NEGATIVE,
    ORDER,
    POSITIVE,
    SWITCH,
    Allowed,
    check_settings,
    ranges,
)
from truepose.models.units import UnitSystem


class Part(FilePart):
    """One field of every kind of number."""

    length: Length = 0.0
    pitch: Pitch = 1.0
    number: Number = 0.0
    sigma: LengthSigma = 1.0
    tolerance: LengthTolerance = 0.0
    any_tolerance: NumberTolerance = 0.0
    angle_tolerance: AngleTolerance = 0.0
    place: LengthVector = (0.0, 0.0, 0.0)
    spread: LengthToleranceVector = (0.0, 0.0, 0.0)


def read(field: str, value: object, units: UnitSystem | None = None) -> Any:
    part = Part.model_validate({field: value}, context={"units": units or UnitSystem()})
    return getattr(part, field)


FITS: dict[str, list[float]] = {
    "length": [0.0, LARGEST, -LARGEST],
    "pitch": [SMALLEST, -SMALLEST, LARGEST, -LARGEST],
    "number": [0.0, LATEST, -LATEST],
    "sigma": [SMALLEST, LARGEST],
    "tolerance": [0.0, SMALLEST, LARGEST, math.inf],
    "any_tolerance": [0.0, 1e-300, LARGEST, math.inf],
}
REFUSED: dict[str, list[tuple[float, str]]] = {
    "length": [
        (1.1 * LARGEST, "expected a finite number (mm), at most 1e+12 by size in mm"),
        (-1.1 * LARGEST, "expected a finite number (mm), at most 1e+12 by size in mm"),
        (math.inf, "expected a finite number (mm)"),
        (math.nan, "expected a finite number (mm)"),
    ],
    "pitch": [
        (0.0, "expected a finite number that is not 0 (mm)"),
        (0.9 * SMALLEST, "expected a finite number that is not 0 (mm), between 1e-12 and 1e+12 in mm"),
    ],
    "number": [(1.1 * LATEST, "expected a finite number (1), at most 1e+20 by size")],
    "sigma": [
        (0.0, "expected a finite number > 0 (mm)"),
        (-1.0, "expected a finite number > 0 (mm)"),
        (0.9 * SMALLEST, "expected a finite number > 0 (mm), between 1e-12 and 1e+12 in mm"),
        (math.inf, "expected a finite number > 0 (mm)"),
    ],
    "tolerance": [
        (-1.0, "expected a number >= 0 or .inf (mm)"),
        (0.9 * SMALLEST, "expected a number >= 0 or .inf (mm), between 1e-12 and 1e+12 in mm"),
        (math.nan, "expected a number >= 0 or .inf (mm)"),
    ],
    "any_tolerance": [(1.1 * LARGEST, "expected a number >= 0 or .inf (1), between 1e-12 and 1e+12")],
}  # fmt: skip


@pytest.mark.parametrize(("field", "value"), [(f, v) for f, values in FITS.items() for v in values])
def test_a_number_fits_up_to_its_limit(field: str, value: float) -> None:
    assert read(field, value) == value


@pytest.mark.parametrize(
    ("field", "value", "said"), [(f, *case) for f, cases in REFUSED.items() for case in cases]
)
def test_a_number_beyond_is_refused_with_what_would_fit(field: str, value: float, said: str) -> None:
    with pytest.raises(ValidationError) as refused:
        read(field, value)
    assert str(input_error(refused.value, "m.yaml")) == f"m.yaml: {field}: {said}, found {value!r}"


def test_units_count_for_numbers_without_one() -> None:
    """And the limits are those of what is meant, not of what is written."""
    metres = UnitSystem(length="m", angle="deg")
    assert read("length", 2.0, metres) == pytest.approx(2000.0) and read(
        "length", "2 mm", metres
    ) == pytest.approx(2.0)
    assert read("number", 2.0, metres) == 2.0
    assert read("angle_tolerance", 180.0, metres) == pytest.approx(math.pi)
    assert read("place", ["1 mm", 2, "3um"], metres) == pytest.approx((1.0, 2000.0, 0.003))
    assert read("spread", 0.001, metres) == pytest.approx((1.0, 1.0, 1.0))
    assert read("spread", ["1 mm", ".inf mm", 0], metres) == pytest.approx((1.0, math.inf, 0.0))
    with pytest.raises(ValidationError) as refused:
        read("length", 2e9, metres)
    assert "expected a finite number (m), at most 1e+12 by size in mm" in str(input_error(refused.value, "m"))
    with pytest.raises(ValidationError):
        read("number", "2 mm")


@pytest.mark.parametrize("value", [[1.0, 2.0], 1.0, [1.0, 2.0, 3.0, 4.0], [1.0, True, 2.0], "1 mm", None])
def test_a_vector_has_three_numbers(value: object) -> None:
    with pytest.raises(ValidationError, match=r"expected 3 finite numbers \(mm\)"):
        read("place", value)


@pytest.mark.parametrize(
    ("text", "value"),
    [("20um", 0.02), (" -1.5E1 mm ", -15.0), (".5 m", 500.0), ("5. mm", 5.0), (".inf mm", math.inf), ("-inf mm", -math.inf),
     ("20", None), ("um", None), ("20 deg", None), ("1 2 mm", None), ("20 + mm", None), ("20 nonsense", None)],
)  # fmt: skip
def test_a_quantity_is_a_number_with_a_unit_of_its_dimension(text: str, value: float | None) -> None:
    assert quantity(text, "mm") == (None if value is None else pytest.approx(value))
    assert is_quantity(text) is (value is not None or text == "20 deg")
    assert quantity(20, "mm") is None


def test_what_is_no_number_of_a_document() -> None:
    assert as_number(3) == 3.0 and as_number(2.5) == 2.5
    assert [as_number(v) for v in (True, "3", None, [3], 10**400)] == [None] * 5
    assert within(LARGEST) and not within(math.nan) and within(LATEST, LATEST) and not within(LATEST)
    assert positive(SMALLEST) and positive(LARGEST) and not positive(0.0) and not positive(-1.0)


def test_a_schema_takes_texts_where_it_takes_numbers() -> None:
    number = {"type": "number"}
    schema = with_texts(
        {"anyOf": [number, {"type": "array", "items": number}], "prefixItems": [number, {"type": "string"}]}
    )
    assert [one["type"] for one in (schema["anyOf"][0], schema["anyOf"][1]["items"])] == [
        ["number", "string"]
    ] * 2
    assert schema["prefixItems"][1] == {"type": "string"} and with_texts(number)["pattern"]
    assert number == {"type": "number"}


SETTINGS: list[tuple[Allowed, list[float], list[float], str]] = [
    (ANY, [LARGEST, -LARGEST, 0.0], [2e12, -2e12, math.nan], "a number from -1e+12 to 1e+12"),
    (SWITCH, [0.0, 0.5, 1.0], [-0.1, 1.1], "a number from 0 to 1"),
    (NOT_NEGATIVE, [0.0, LARGEST], [-1e-9], "a number from 0 to 1e+12"),
    (POSITIVE, [1e-12, LARGEST], [0.0, 9e-13, -1.0], "a number from 1e-12 to 1e+12"),
    (ORDER, [-1e4, 0.5, 1e4], [0.0, 1.1e4], "a number from -10000 to 10000 that is not 0"),
    (COUNT, [1.0, 60.0], [0.0, 61.0, 1.5], "a whole number from 1 to 60"),
    (HARMONIC, [1.0, 180.0], [0.0, 181.0, 1.5], "a whole number from 1 to 180"),
    (COLUMN, [LATEST, -LATEST], [2e20, -2e20], "a number from -1e+20 to 1e+20"),
    (DURATION, [0.0, LATEST], [-1e-9, 2e20], "a number from 0 to 1e+20"),
]


@pytest.mark.parametrize(("allowed", "inside", "outside", "words"), SETTINGS)
def test_settings_are_within_their_range(
    allowed: Allowed, inside: list[float], outside: list[float], words: str
) -> None:
    assert str(allowed) == words
    known = ranges({"lag": allowed, "from.": ANY})
    for value in inside:
        check_settings("heat", known, {"lag": value, "from.hall": 3.0}, "m.yaml")
    for value in outside:
        with pytest.raises(InputError) as refused:
            check_settings("heat", known, {"lag": value}, "m.yaml")
        assert str(refused.value) == f"m.yaml: found lag: {value:g}, expected {words}"
    with pytest.raises(InputError, match=r"^m.yaml: heat has no setting 'lug'; did you mean 'lag'\?$"):
        check_settings("heat", known, {"lug": 1.0}, "m.yaml")
    with pytest.raises(InputError, match=r"^m.yaml: heat has no setting 'lag'; it has none$"):
        check_settings("heat", ranges({}), {"lag": 1.0}, "m.yaml")


DRIVERS = {
    # name: unit of a joint in rad, what it drives, column, smooth, air's where its own is not there
    "payload": ("kg", "load", "payload", True, "payload"),
    "time": ("s", "time", "time", True, "time"),
    "row": ("1", "time", "row", True, "row"),
    "session.after.2": ("1", "session", "session.after.2", False, "session.after.2"),
    "recording.a": ("1", "session", "recording.a", False, "recording.a"),
    "temperature": ("degC", "temperature", "temperature", False, "temperature"),
    "temperature.leg1": ("degC", "temperature", "temperature.leg1", True, AIR),
    "temperature.leg1~300": ("degC", "temperature", "temperature.leg1", True, AIR),
    "pressure": ("hPa", None, "pressure", False, "pressure"),
    "pressure.pump": ("hPa", None, "pressure.pump", True, "pressure.pump"),
    "humidity": ("%", None, "humidity", False, "humidity"),
    "velocity.q1": ("rad/s", "arrival", "velocity.q1", False, "velocity.q1"),
    "torque.q1": ("N*m", "load", "torque.q1", False, "torque.q1"),
    "torque.slide": ("N", "load", "torque.slide", False, "torque.slide"),
    "current.q1": ("A", "load", "current.q1", False, "current.q1"),
    "force.pull": ("N", "load", "force.pull", True, "force.pull"),
    "moment.pull": ("N*m", "load", "moment.pull", True, "moment.pull"),
    "approach.q1": ("1", "arrival", "approach.q1", False, "approach.q1"),
    "step.q1": ("rad", "arrival", "q1", False, "step.q1"),
    "stop.q1~0.01": ("rad", "arrival", "q1", False, "stop.q1~0.01"),
    "loop.q1~0.01~0~1": ("rad", "arrival", "q1", False, "loop.q1~0.01~0~1"),
    "creep.q1~2": ("rad", "time", "time", False, "creep.q1~2"),
    "stop.q1": ("rad", "arrival", "stop.q1", False, "stop.q1"),
    "coolant": ("", None, "coolant", True, "coolant"),
}


@pytest.mark.parametrize("name", DRIVERS)
def test_a_driver_is_what_its_name_says(name: str) -> None:
    driver = Driver.of(name)
    own = (
        driver.unit({"q1": "rad", "slide": "mm"}),
        driver.drives,
        driver.column,
        driver.smooth,
        driver.served_by(()),
    )
    assert own == DRIVERS[name]
    assert driver.after == (2 if name == "session.after.2" else None)
    assert driver.default == {"session.after.2": 1.0, "pressure": 1013.25, "humidity": 50.0}.get(
        name, 20.0 if name.startswith("temperature") else 0.0
    )


@pytest.mark.parametrize(
    ("unit", "kind"),
    [("kN", "load"), ("N*mm", "load"), ("g", "load"), ("mA", "load"), ("bar", "load"), ("K", "temperature"),
     ("kW", "temperature"), ("h", "time"), ("mm", "coupling"), ("1", "coupling"), ("", "coupling")],
)  # fmt: skip
def test_a_column_drives_what_its_unit_is_of(unit: str, kind: str) -> None:
    assert driven_by_unit(unit) == kind


def test_a_plug_ins_formulas_have_a_shape_and_are_numbers_somewhere() -> None:
    x = ca.SX.sym("x")
    three = type("Sensor", (), {"columns": {"x": "mm", "y": "mm", "z": "mm"}})()
    assert no_formula(x, 1) == no_formula(ca.log(x), 1) == no_formula(ca.vertcat(x, 1, 2), 3) == ""
    assert no_formula(ca.vertcat(x, 1), 1) == "an expression of shape (2, 1), expected an expression"
    assert no_formula(x, 3) == "an expression of shape (1, 1), expected a column of 3 expressions"
    assert no_formula("x" * 70, 1) == f"{repr('x' * 70)[:60]} ..., expected an expression"
    assert no_formula(ca.vertcat(x, x * np.nan), 2).startswith(
        "a formula that is no number wherever it was tried"
    )
    assert no_shifts({"q1": x}, None) == "" and no_shifts([x], None).endswith(
        "expected a mapping from ports to expressions"
    )
    assert no_shifts({"q1": x, 3: x}, None) == "the port 3, expected a name"
    assert no_shifts({"q1": "bad"}, None) == "at the port 'q1' 'bad', expected an expression"
    assert no_readings(np.zeros((5, 3)), three) == ""
    for wrong in (np.zeros((5, 2)), np.zeros(3), np.zeros((1, 5, 3))):
        assert (
            no_readings(wrong, three)
            == f"an array of shape {wrong.shape}, expected an array of rows by 3 columns"
        )
    assert no_readings([1], three) == "[1], expected an array of rows by 3 columns"


def number(text: str, *, bounded: bool = False, angle: float = 1.0, **at: float) -> float:
    formula, values = Formula.read(text, list(at), angle, "here"), {name: ca.SX(v) for name, v in at.items()}
    return float(ca.evalf(formula.value(values, bounded=True) if bounded else formula.value(values)))


def test_formulas_mean_what_they_say_in_the_files_angles() -> None:
    degree = math.radians(1.0)
    assert number("-2**2 + 3*4/6 - +1") == -3.0
    assert number("2*sin(30) + atan2(a, a)", angle=degree, a=2.0) == pytest.approx(46.0)
    assert number("acos(0.5) + asin(1) - atan(1)", angle=degree) == pytest.approx(60.0 + 90.0 - 45.0)
    assert number("sqrt(abs(-9)) + cos(60) + tan(45)", angle=degree) == pytest.approx(4.5)
    assert Formula.read("b + a*b - sin(c)", ["a", "b", "c"], 1.0, "here").names == ("b", "a", "c")


def test_a_bounded_formula_has_a_value_and_a_slope_everywhere() -> None:
    assert math.isnan(number("sqrt(a)", a=-1.0)) and number("sqrt(a)", bounded=True, a=-1.0) == pytest.approx(
        0.0
    )
    assert math.isnan(number("acos(a)", a=1.5)) and number("acos(a)", bounded=True, a=-1.5) == pytest.approx(
        math.pi, abs=1e-5
    )
    assert number("asin(a)", bounded=True, a=0.5) == number("asin(a)", a=0.5)
    a = ca.SX.sym("a")
    for text in ("sqrt(a)", "asin(a)", "acos(a)"):
        slope = ca.jacobian(Formula.read(text, ["a"], 1.0, "here").value({"a": a}, bounded=True), a)
        for at in (-2.0, -1.0, 0.0, 1.0, 2.0):
            assert math.isfinite(float(ca.Function("s", [a], [slope])(at)))


@pytest.mark.parametrize("q", [0.0, 30.0, 80.0])
def test_a_law_is_in_units_of_its_own(q: float) -> None:
    """mm of a joint in degrees and a length in metres; where the root has no value that of the nearest that has one."""
    formula = Formula.read("sqrt(cos(2*q) - 0.25 + 0*b) * 0.1 + b", ["q", "b"], math.radians(1.0), "here")
    law = Law(formula, 1000.0, (("q", math.radians(1.0)),), (("b", "link.b", 1000.0),))
    at = {"q": ca.SX(math.radians(q))}
    found = float(ca.evalf(law.value(at, {"link.b": ca.SX(1000.0)})))
    root = max(math.cos(math.radians(2 * q)) - 0.25, 0.0)
    assert found == pytest.approx(1000.0 + 100.0 * math.sqrt(root))


FORMULAS = [
    ("a^2", "expected ** for a power"), ("a % 2", "expected + - * / or **"), ("~a", "expected + or - before a term"),
    ("sine(a)", "expected a function; did you mean 'sin' or 'asin'?"), ("sin(a, a)", "expected sin of 1 value"),
    ("atan2(a)", "expected atan2 of 2 values"), ("sin(x=a)", "expected sin of 1 value"), ("True", "expected a number"),
    ("'a'", "expected a number"), ("b", "expected a driven joint or a length of this joint; known: a"),
    ("1e999", "expected a number"), ("a if a else a", "expected numbers, joints, + - * / **, brackets and sin, cos"),
    ("a +", "expected a formula such as 90 - q2 - q3"),
    ("1" * 1001, "found 1001 characters, expected a formula of at most 1000"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "said"), FORMULAS)
def test_what_is_no_formula_is_refused(text: str, said: str) -> None:
    with pytest.raises(InputError) as refused:
        Formula.read(text, ["a"], 1.0, "here")
    assert str(refused.value).startswith("here: found") and said in str(refused.value)
    assert Formula.read("1" * 300 + " " * 700, [], 1.0, "here").names == ()
