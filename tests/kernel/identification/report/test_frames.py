"""Results as tables: a row for each thing that was found, whose numbers are those of the result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from support.reports import fitted, gear, gear_finding, recorded, synthetic
from truepose.identification.compensation.compensate import Compensation
from truepose.identification.compensation.inverse import Inverse, Reach
from truepose.identification.diagnosis.result import Alternative, Levels, Quantity
from truepose.identification.identifiability.observability import identifiable
from truepose.identification.report.frames import CONSTANTS, FINDINGS
from truepose.models.machine.machine import Machine
from truepose.shown.result import frame


def test_constants_stand_so_many_tolerances_from_the_drawing(machine: Machine) -> None:
    """Those that may move, in the fit's order; a coefficient has neither a drawing nor a tolerance."""
    fit = fitted(machine, recorded(machine), (gear(machine),), away=2.0)
    table = frame(fit)
    assert list(table.columns) == CONSTANTS
    held = {p.name for p in machine.parameters if not p.tolerance}
    assert held and table["parameter"].tolist() == [name for name in fit.prior.names if name not in held]
    own = table.set_index("parameter")
    bounded = np.isfinite(own["tolerance"])
    assert bounded.sum() > 5 and not bounded.all()
    away = (own["value"] - own["nominal"]) / own["tolerance"]
    np.testing.assert_allclose(own["in_tolerances"][bounded], away[bounded], rtol=1e-12)
    assert np.ptp(away[bounded]) > 2.0
    coefficients = own.loc[list(gear(machine).parameter_names)]
    assert coefficients["value"].tolist() == [3e-4, -1e-4] and coefficients["unit"].tolist() == ["rad"] * 2
    assert coefficients[["nominal", "tolerance", "in_tolerances"]].isna().all(axis=None)
    assert own["identifiable"].to_dict() == {name: identifiable(fit)[name] for name in own.index}
    assert set(own["identifiable"]) == {True, False}


def test_a_constant_without_a_tolerance_is_no_number_of_tolerances_away(machine: Machine) -> None:
    """What neither readings nor a tolerance hold has no 1-sigma either."""
    first = machine.parameters[0].name
    endless = replace(
        machine,
        mechanism=replace(
            machine.mechanism,
            parameters=tuple(
                replace(p, tolerance=np.inf) if p.name == first else p for p in machine.mechanism.parameters
            ),
        ),
    )
    own = frame(fitted(endless, recorded(endless))).set_index("parameter")
    tolerance, away, nominal = (
        float(own[name].to_dict()[first]) for name in ("tolerance", "in_tolerances", "nominal")
    )
    assert np.isinf(tolerance) and np.isnan(away) and np.isfinite(nominal)
    others = own.drop(index=first)
    assert others["in_tolerances"].notna().all() and np.isfinite(others["std"]).all()


def test_a_finding_is_a_row_with_its_rivals_and_amplitudes(machine: Machine) -> None:
    rivals = (
        Alternative("backlash", ("q1",), 0.05, 100.0),
        Alternative("axis-coupling", ("q1", "q2"), 0.01, 90.0),
    )
    levels = Levels(0.99, "position-periodic", 0.98)
    named = replace(gear_finding(), equivalents=rivals, levels=levels)
    nameless = replace(named, effect="empirical", place=("q2", "q1"), parameters={})
    table = frame(replace(synthetic(machine), findings=(named, nameless)))
    assert list(table.columns) == FINDINGS and len(table) == 2
    first, second = (table.loc[k] for k in (0, 1))
    assert (first["effect"], first["place"], first["probability"]) == ("transmission-error", "q1", 0.93)
    assert (first["place_probability"], first["driver"], first["driver_probability"]) == (
        0.99, "position-periodic", 0.98,
    )  # fmt: skip
    assert first["or_else"] == "backlash at q1; axis-coupling at q1, q2"
    assert first["amplitudes"] == "a = 0.0003 +- 1e-05 rad; b = -0.0001 +- nan rad"
    assert first["experiment"].startswith("sweep q1 alone")
    assert second["place"] == "q2, q1" and np.isnan(second["probability"]) and second["amplitudes"] == ""
    own = frame(replace(named, parameters={"a": Quantity(2.0, 0.5, "mm"), "b": Quantity(3.0, 0.25, "1")}))
    assert own.to_dict("list") == {
        "coefficient": ["a", "b"], "value": [2.0, 3.0], "std": [0.5, 0.25], "unit": ["mm", "1"],
    }  # fmt: skip


def test_corrected_commands_stand_beside_the_path_and_what_they_reach() -> None:
    rng = np.random.default_rng(5)
    nominal, before, after = rng.normal(size=(4, 2)), rng.normal(size=(4, 6)), rng.normal(size=(4, 6))
    target = np.broadcast_to(np.eye(4), (4, 4, 4))
    table = frame(Compensation(("q1", "q2"), nominal, nominal + 0.5, target, before, after))
    assert list(table.columns) == [
        "q1", "q2", "q1.nominal", "q2.nominal", "before.position", "before.rotation", "after.position", "after.rotation",
    ]  # fmt: skip
    np.testing.assert_array_equal(table[["q1.nominal", "q2.nominal"]], nominal)
    np.testing.assert_array_equal(table[["q1", "q2"]], nominal + 0.5)
    for when, twist in (("before", before), ("after", after)):
        whole = table[f"{when}.position"] ** 2 + table[f"{when}.rotation"] ** 2
        np.testing.assert_allclose(whole, np.sum(twist**2, axis=1))
        np.testing.assert_allclose(
            table[f"{when}.position"] ** 2, twist[:, 0] ** 2 + twist[:, 1] ** 2 + twist[:, 2] ** 2
        )


def test_joints_for_poses_say_how_each_ended() -> None:
    q = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    status = np.array([Reach.SOLVED, Reach.ITERATION_LIMIT, Reach.JOINT_RANGE], dtype=np.intp)
    gaps = np.array([0.0, 0.1, 0.2])
    beyond = np.zeros((3, 2), dtype=bool)
    table = frame(Inverse(("q1", "q2"), q, np.zeros((3, 0)), gaps, 2 * gaps, status, beyond))
    assert table.to_dict("list") == {
        "q1": [1.0, 3.0, 5.0], "q2": [2.0, 4.0, 6.0], "status": ["solved", "iteration limit", "joint range"],
        "position": [0.0, 0.1, 0.2], "rotation": [0.0, 0.2, 0.4],
    }  # fmt: skip


@pytest.mark.parametrize("other", [None, 3, "text", pd.DataFrame()])
def test_what_is_no_result_has_no_table(other: object) -> None:
    with pytest.raises(TypeError, match=f"found a {type(other).__name__}, expected a result"):
        frame(other)
