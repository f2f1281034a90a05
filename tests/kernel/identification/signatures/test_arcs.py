"""Long series in the directions that readings see: which candidates they are, and shifts that are turned."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from support.effect_machines import read_machines
from support.effects import with_effect
from truepose.identification.prior import LONG
from truepose.identification.signatures.signatures import series_ports, turned
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.empirical import Empirical
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return read_machines(tmp_path_factory.getbasetemp() / "arcs")["arm"]


def ports_of(placed: PlacedEffect, *names: str) -> Mapping[int, str]:
    return series_ports((placed,), [(list(names), slice(0, len(placed.coefficients) * len(names)))])


@pytest.mark.parametrize(("orders", "long"), [(6.0, False), (7.0, True), (60.0, True)])
def test_a_series_of_more_coefficients_than_a_dozen_is_long(arm: Machine, orders: float, long: bool) -> None:
    placed = with_effect(arm, "transmission-error", ("q1",), {"orders": orders})
    assert (len(placed.coefficients) > LONG) is long
    assert ports_of(placed, "q1.displacement") == ({0: "q1.displacement"} if long else {})
    assert ports_of(placed, "q1.displacement", "q2.displacement") == {}  # of several ports it is none


def test_forms_without_a_name_and_what_has_bounds_are_no_series(arm: Machine) -> None:
    """Coefficients of forms are kept one by one; bounds are of coefficients, too."""
    degree = {"from.q1": -1.0, "to.q1": 1.0, "degree": 20.0}
    form = PlacedEffect.at(Empirical(), arm, ("q1",), degree)
    assert len(form.coefficients) > LONG and ports_of(form, "q1.displacement") == {}
    soft = with_effect(arm, "joint-compliance", ("q2",))
    assert ports_of(soft, "q2.displacement") == {}


def test_shifts_are_turned_candidate_by_candidate() -> None:
    """Each to as many columns as its directions; where none are given, by its coefficients as they are."""
    rng = np.random.default_rng(1)
    shifts = rng.standard_normal((9, 7))
    layout = [(["a"], slice(0, 2)), (["b"], slice(2, 5)), (["c", "d"], slice(5, 7))]
    turn = rng.standard_normal((3, 2))
    found, places = turned(shifts, layout, [None, turn, None])
    np.testing.assert_allclose(found, np.column_stack([shifts[:, :2], shifts[:, 2:5] @ turn, shifts[:, 5:]]))
    assert places == [(["a"], slice(0, 2)), (["b"], slice(2, 4)), (["c", "d"], slice(4, 6))]
    same, nowhere = turned(shifts, [], [])
    assert same is shifts and nowhere == []
