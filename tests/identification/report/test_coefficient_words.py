"""What is said of an effect's coefficients on one line: three one by one, more by their number and rms."""

from __future__ import annotations

import pytest

from truepose.identification.diagnosis.result import Quantity
from truepose.identification.report.naming import coefficient_words


def told(*names: str, value: float = 3e-4, unit: str = "mm") -> str:
    return coefficient_words({name: Quantity(value, 1e-5, unit) for name in names})


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ((), ""),
        (("a",), "a = 0.0003 +- 1e-05 mm"),
        (("a", "b", "c"), "a = 0.0003 +- 1e-05 mm, b = 0.0003 +- 1e-05 mm, c = 0.0003 +- 1e-05 mm"),
        (("a", "b", "c", "d"), "4 coefficients, 0.300 µm rms"),
    ],
)
def test_three_coefficients_are_told_one_by_one(names: tuple[str, ...], said: str) -> None:
    assert told(*names) == said


def test_a_number_without_a_unit_has_none() -> None:
    assert told("s", unit="1") == "s = 0.0003 +- 1e-05"
    assert told("s", unit="rad/(N*m)") == "s = 0.0003 +- 1e-05 rad/(N*m)"


def test_coefficients_are_pooled_by_their_unit() -> None:
    parameters = {f"k{j}": Quantity(float(v), 0.1, "mm") for j, v in enumerate((3.0, -4.0, 0.0, 5.0))}
    parameters["s"] = Quantity(-2.0, 0.1, "1")
    assert coefficient_words(parameters) == "4 coefficients, 3.54 mm rms; s, 2.00 rms"
    parameters["t"] = Quantity(2.0, 0.1, "1")
    assert coefficient_words(parameters).endswith("; 2 coefficients, 2.00 rms")


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("a1", "b1", "a2", "b2"), "2 orders, 4.24 mm rms"),  # the root of 4 * 3^2 / 2
        (("a1.x", "b1.x", "a12.x", "b12.x"), "2 orders, 4.24 mm rms"),
        (("a1.x", "b1.x", "a1.y", "b1.y"), "4 coefficients, 3.00 mm rms"),  # of one order
        (("a1", "b1", "a2", "c2"), "4 coefficients, 3.00 mm rms"),
        (("a1", "b1", "a2", "offset"), "4 coefficients, 3.00 mm rms"),
    ],
)
def test_orders_are_those_of_one_wave(names: tuple[str, ...], said: str) -> None:
    """A wave with so large a sine and cosine of each order has the root of half their squares."""
    assert told(*names, value=3.0) == said
