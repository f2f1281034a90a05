"""Numbers of a report: in units and digits that read well, curves of their formula, directions by their frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from support.reports import NAN, arm, fitted, recorded, synthetic
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.report.curves import curves
from truepose.identification.report.gauge import rank_words
from truepose.identification.report.numbers import measure, p_value, percent, significant, times, uncertain
from truepose.models.machine import Machine


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return arm(tmp_path_factory.mktemp("machine"))


@pytest.fixture(scope="module")
def diagnosis(machine: Machine) -> Diagnosis:
    return synthetic(machine)


def test_identified_function_is_the_formula(diagnosis: Diagnosis) -> None:
    (curve,) = curves(diagnosis, diagnosis.findings[0])
    q = np.radians(curve.x)
    expected = 1e6 * (3e-4 * np.sin(2 * q) - 1e-4 * np.cos(2 * q))
    assert np.allclose(curve.y, expected)
    assert (curve.title, curve.y_title) == ("displacement of q1", "shift [µrad]")
    assert (curve.std > 0).all()


def test_blind_directions_are_told_by_frame(machine: Machine) -> None:
    fit = fitted(machine, recorded(machine))
    free = [fit.prior.names[k] for k in fit.prior.free]
    blind: NDArray[np.float64] = np.eye(len(free) + 1)
    at = [free.index("tool.x"), free.index("q2.d")]
    blind[:, at] = 0.0
    blind[at[0], at] = (1.0, 1.0)  # their sum is seen, their difference is not
    said = " ".join(rank_words(replace(fit, factor=blind)))
    assert f"{len(free) - 1} of {len(free)} directions" in said
    assert "tool frame can move against the mechanism in 1 way (of x)" in said
    assert "q2.d" in said


def test_numbers_read_well() -> None:
    assert uncertain(0.00945, 0.00048, "1") == "0.00945 ± 0.00048"
    assert uncertain(2.1e-7, 5e-9, "rad/(N*m)") == "(2.100 ± 0.050)×10⁻⁷ rad/(N·m)"
    assert uncertain(0.0123, 0.0004, "mm") == "12.30 ± 0.40 µm"
    assert uncertain(1.5, float("inf"), "mm") == "1.500 mm (uncertainty unknown)"
    assert uncertain(NAN, 1.0, "mm") == "-"
    assert measure(1.05e-5, "mm") == "10.5 nm"
    assert measure(8.1e-6, "rad") == "8.10 µrad"
    assert measure(None, "mm") == measure(NAN, "mm") == "-"
    assert significant(1e-9) == "1.00×10⁻⁹"
    assert significant(0.0) == "0"
    assert percent(1.0) == "over 99.9 %"
    assert percent(0.0) == "below 0.1 %"
    assert percent(0.5) == "50 %"
    assert p_value(0.0) == "below 10⁻³⁰⁰"
    assert times(230.2585) == "10¹⁰⁰ times"
    assert times(0.6931) == "2.0 times"
