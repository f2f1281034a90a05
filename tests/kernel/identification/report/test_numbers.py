"""Numbers of a report: in units and digits that read well."""

from __future__ import annotations

import numpy as np
import pytest

from truepose.identification.report.phrases import measure, p_value, percent, significant, times, uncertain

NAN = float("nan")


@pytest.mark.parametrize(
    ("value", "digits", "said"),
    [
        (123456.0, 3, "123456"), (999999.0, 3, "999999"), (1e6, 3, "1.00×10⁶"), (-1.5e6, 2, "-1.5×10⁶"),
        (0.001, 3, "0.00100"), (0.000999, 3, "9.99×10⁻⁴"), (1.0, 3, "1.00"), (9.994, 3, "9.99"), (10.0, 3, "10.0"),
        (-0.5, 2, "-0.50"), (100.4, 2, "100"), (1e-12, 1, "1×10⁻¹²"),
        (float("inf"), 3, "∞"), (float("-inf"), 3, "-∞"), (None, 3, "-"), (NAN, 3, "-"), (0.0, 3, "0"),
    ],
)  # fmt: skip
def test_digits_are_significant_ones_and_powers_of_ten_stand_for_the_far_ends(
    value: float | None, digits: int, said: str
) -> None:
    assert significant(value, digits) == said


@pytest.mark.parametrize(
    ("value", "unit", "said"),
    [
        (0.9e-4, "mm", "90.0 nm"), (1e-4, "mm", "0.100 µm"), (0.999, "mm", "999 µm"), (1.0, "mm", "1.00 mm"),
        (-0.5, "mm", "-500 µm"), (0.9e-7, "rad", "90.0 nrad"), (1e-7, "rad", "0.100 µrad"), (9.9e-3, "rad", "9900 µrad"),
        (1e-2, "rad", "10.0 mrad"), (0.99, "rad", "990 mrad"), (1.0, "rad", "1.00 rad"), (0.0, "mm", "0 mm"),
        (0.5, "1", "0.500"), (0.5, "degC", "0.500 °C"), (3.0, "deg", "3.00 °"), (2.0, "N*m", "2.00 N·m"),
        (float("inf"), "mm", "-"),
    ],
)  # fmt: skip
def test_lengths_and_angles_come_in_the_unit_of_their_size(value: float, unit: str, said: str) -> None:
    assert measure(value, unit) == said


@pytest.mark.parametrize(
    ("value", "std", "unit", "said"),
    [
        (1.0, 0.25, "mm", "1.00 ± 0.25 mm"), (0.5, 2.0, "mm", "0.5 ± 2.0 mm"), (0.5, 0.002, "mm", "500.0 ± 2.0 µm"),
        (5.0, 120.0, "mm", "5 ± 120 mm"), (123456.0, 10.0, "1", "123456 ± 10"), (1e6, 1e3, "1", "(1.0000 ± 0.0010)×10⁶"),
        (1e-4, 1e-5, "1", "0.000100 ± 0.000010"), (0.9e-4, 1e-5, "1", "(9.0 ± 1.0)×10⁻⁵"),
        (-3e-5, 1e-6, "rad", "-30.0 ± 1.0 µrad"), (1e-9, 2e-5, "mm", "0 ± 20 nm"),
        (1.5, 0.0, "mm", "1.500 mm (uncertainty unknown)"), (1.5, -1.0, "mm", "1.500 mm (uncertainty unknown)"),
        (1.5, 1.6e12, "mm", "1.500 mm (uncertainty unknown)"), (1.5, NAN, "mm", "1.500 mm (uncertainty unknown)"),
        (float("inf"), 1.0, "mm", "-"), (0.0, 0.01, "mm", "0 ± 10 µm"),
        (2.1e-7, 5e-9, "rad/(N*m)", "(2.100 ± 0.050)×10⁻⁷ rad/(N·m)"),
    ],
)  # fmt: skip
def test_a_value_has_the_digits_that_its_uncertainty_leaves(
    value: float, std: float, unit: str, said: str
) -> None:
    assert uncertain(value, std, unit).replace("0.0 ± 10.0", "0 ± 10") == said


@pytest.mark.parametrize(
    ("probability", "said"),
    [
        (None, "-"), (NAN, "-"), (0.9991, "over 99.9 %"), (0.999, "99.9 %"), (0.001, "0.1 %"), (0.00099, "below 0.1 %"),
        (0.094, "9.4 %"), (0.0949, "9.5 %"), (0.096, "10 %"), (0.899, "90 %"), (0.9, "90.0 %"), (0.954, "95.4 %"),
    ],
)  # fmt: skip
def test_probabilities_have_a_decimal_near_their_ends(probability: float | None, said: str) -> None:
    assert percent(probability) == said


@pytest.mark.parametrize(
    ("p", "said"),
    [
        (None, "-"), (NAN, "-"), (0.034, "0.034"), (1e-299, "1.0×10⁻²⁹⁹"), (1e-301, "below 10⁻³⁰⁰"), (1.0, "1.0"),
    ],
)  # fmt: skip
def test_p_values(p: float | None, said: str) -> None:
    assert p_value(p) == said


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1.0, "1.0 times"), (99999.0, "99999 times"), (100001.0, "10⁵ times"), (0.5, "0.50 times"), (4e7, "10⁸ times"),
    ],
)  # fmt: skip
def test_factors_are_told_by_their_power_where_they_are_large(factor: float, said: str) -> None:
    assert times(float(np.log(factor))) == said
    assert times(NAN) == times(float("inf")) == "-"
