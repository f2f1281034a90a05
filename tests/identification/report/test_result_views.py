"""What a session and a notebook show of results: title, facts and table, from what the result holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.reports import fitted, gear, gear_finding, recorded, synthetic
from support.results import RESULTS
from support.told_drift import CHANGED, movement, told_drift
from truepose.identification.compensation.compensate import Compensation
from truepose.identification.compensation.inverse import Inverse, Reach
from truepose.identification.diagnosis.result import UNNAMED, Alternative, Levels, Quantity
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.identifiability.analysis import Identifiability, ParameterSight
from truepose.identification.identifiability.observability import Note
from truepose.identification.report.numbers import significant
from truepose.models.machine.machine import Machine
from truepose.shown.result import view


def test_what_is_no_result_has_no_view() -> None:
    with pytest.raises(TypeError, match="found a int, expected a result"):
        view(3)


# -- fits ----------------------------------------------------------------------------------------------


def test_a_fit_says_its_misfit_its_rows_and_what_the_readings_see(machine: Machine) -> None:
    own = fitted(machine, recorded(machine))
    shown, free = view(own), len(own.prior.free)
    used = own.residual[own.used]
    rms = 10.0 * float(np.sqrt(np.mean(np.sum(used**2, axis=1))))  # µm: a sigma is 0.01 mm
    assert shown.title == (
        f"Estimate of arm: misfit chi2/dof {significant(own.chi2_per_dof)}, rms position {rms:.1f} µm"
    )
    rows = f"25 rows fitted, 75 readings{{}}; the readings see {free - 1} of {free} directions of the free constants"
    assert shown.facts == (rows.format(""),)
    lost = view(replace(own, unassembled=(3, 4)))
    assert lost.facts[0] == rows.format(", 2 rows cannot be assembled")
    label = gear(machine).label
    assert view(fitted(machine, recorded(machine), (gear(machine),))).facts[1] == f"effects: {label}"


def test_constants_stand_the_farthest_from_the_drawing_first(machine: Machine) -> None:
    """Those without a tolerance last, without a number of them."""
    own = fitted(machine, recorded(machine), (gear(machine),))
    rows = view(own).rows
    far = [abs(float(row[-1])) if row[-1] else -1.0 for row in rows]
    assert far == sorted(far, reverse=True) and far[0] > 0.0 and far[-1] == -1.0
    names = list(own.prior.names)
    for name, value, std, drawing, unit, tolerance, away in rows:
        k = names.index(name)
        assert value == f"{own.p[k]:.6g}" and std in (f"{own.std[k]:.2g}", "inf")
        if k < len(machine.parameters):
            p = machine.parameters[k]
            assert (drawing, unit, tolerance) == (f"{p.nominal:.6g}", p.unit, f"{p.tolerance:.3g}")
            assert away == f"{own.in_tolerances[k]:.2f}" or not 0.0 < p.tolerance < np.inf


def test_a_calibration_says_rows_that_were_held_out_its_method_and_its_notes(machine: Machine) -> None:
    recording = recorded(machine)
    fit = fitted(machine, recording)
    found = Calibration(fit, None, recording, ("a note",), {"estimator": "map", "solver": "gn"})
    first, _, *others = view(found).facts
    used, held = (
        10.0 * float(np.sqrt(np.mean(np.sum(fit.residual[mask] ** 2, axis=1))))
        for mask in (fit.used, recording.validation)
    )
    assert first == f"rms: position {used:.1f} µm; on the validation rows position {held:.1f} µm"
    assert others == ["method: estimator map, solver gn", "note: a note"]
    none = replace(recording, validation=np.zeros(30, dtype=bool))
    assert view(replace(found, recording=none)).facts[0] == f"rms: position {used:.1f} µm"


# -- diagnoses and findings ----------------------------------------------------------------------------


def test_a_diagnosis_says_what_was_gained_what_was_left_out_and_what_is_open(machine: Machine) -> None:
    found = synthetic(machine)
    shown = view(found)
    assert shown.title.startswith("Diagnosis of arm: missing-physics. ")
    position = "position 12.0 µm; on the validation rows position 13.0 µm"
    facts = list(shown.facts)
    assert facts[:4] == [
        f"before: rms {position}; after: {position}",
        "chi2 per degree of freedom: free 1.02, before 9.00, after 1.01",
        "concealed: an ordinary fit would have looked good",
        "2 rows excluded as outliers: rows 7, 19",
    ]
    assert "cannot be tested: thermal-expansion: no temperature.link1 column" in facts
    calm = view(replace(found, terms=(), concealed=False, outlier_rows=()))
    assert calm.facts[0] == f"rms {position}"
    assert not [fact for fact in calm.facts if fact.startswith("concealed") or "excluded" in fact]
    many = view(replace(found, outlier_rows=tuple(range(1, 15)), noise=2.0))
    rows = "1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12 and 2 more"
    assert f"14 rows excluded as outliers: rows {rows}" in many.facts
    assert "note: without effects the readings scatter 2 times the stated sigma" in many.facts


def test_findings_of_a_diagnosis_are_rows(machine: Machine) -> None:
    sure = Levels(0.99, "load", 0.95)
    bare = replace(gear_finding(), effect="empirical", place=("q2",), equivalents=(), levels=sure)
    shown = view(synthetic(machine, findings=(replace(gear_finding(), levels=sure), bare)))
    assert shown.head == ("finding", "law", "place", "driver", "varies with", "or else")
    assert shown.rows == (
        ("transmission-error at q1", "93.0 %", "99.0 %", "95.0 %", "load", "1"),
        ("empirical at q2", "", "99.0 %", "95.0 %", "load", ""),
    )


def test_a_finding_says_what_it_could_also_be_and_its_coefficients() -> None:
    shown = view(gear_finding())
    assert shown.title.endswith(": The gear of joint q1 turns unevenly.")
    also = [fact for fact in shown.facts if fact.startswith("could also be: ")]
    assert also == ["could also be: eccentric encoder disc (encoder-eccentricity) at q1 (6.0 %)"]
    assert shown.facts[-1].startswith("what would separate it: sweep q1 alone")
    assert shown.head == ("coefficient", "value", "1-sigma", "unit")
    assert shown.rows == (("a", "0.0003", "1e-05", "rad"), ("b", "-0.0001", "nan", "rad"))
    alone = view(replace(gear_finding(), equivalents=(), parameters={"g": Quantity(2.0, 0.125, "1")}))
    assert not [fact for fact in alone.facts if fact.startswith("could also be")]
    assert alone.rows == (("g", "2", "0.12", ""),)
    rivals = tuple(Alternative(UNNAMED, (f"q{k}",), 0.1, 1.0) for k in range(6))
    (also_,) = [f for f in view(replace(gear_finding(), equivalents=rivals)).facts if f.startswith("could")]
    assert also_.endswith(" and 2 more")


# -- drift ---------------------------------------------------------------------------------------------


def test_movements_stand_by_what_became_of_them() -> None:
    """What moved on top, with its last change; what did not, with what a movement would have to be to be seen."""
    kinds = ("unseen", "masked", "still", "anew", "perhaps", "moved")
    found = told_drift(
        *(movement(kind, kind, **({} if k < 3 else CHANGED), hidden=0.004) for k, kind in enumerate(kinds))
    )
    rows = view(found).rows
    assert [row[1] for row in rows] == ["moved", "perhaps", "anew", "still", "masked", "unseen"]
    assert rows[0] == ("moved", "moved", "60.0 µm", "1.0 µm", "99.0 %")
    assert rows[3] == ("still", "still", "", "4.0 µm", "99.0 %")
    assert "cannot be shown" not in repr(found)


def test_a_drift_says_its_sessions_and_notes() -> None:
    shown = view(told_drift(movement("a", "moved", **CHANGED), notes=("a note",)))
    assert shown.title.startswith("Drift of arm: 3 sessions")
    assert shown.facts[0] == "sessions: s0, s1, s2" and "note: a note" in shown.facts


# -- paths and poses -----------------------------------------------------------------------------------


def compensated(rows: int) -> Compensation:
    command = np.array([[1.0, -2.0], [0.5, 0.25]])[:rows]
    twist = np.zeros((rows, 6))
    return Compensation(("q1", "q2"), np.zeros((rows, 2)), command, np.zeros((rows, 4, 4)), twist, twist, "C")


def test_a_compensation_says_the_largest_correction_of_each_joint_either_way() -> None:
    shown = view(compensated(2))
    assert shown.title.startswith("Compensation of 2 rows, solved by C; largest pose error")
    assert shown.rows == (("q1", "1"), ("q2", "2"))
    empty = view(compensated(0))
    assert empty.title == "Compensation of 0 rows, solved by C"
    assert empty.rows == (("q1", "0"), ("q2", "0"))


def test_an_inverse_says_how_many_poses_ended_how_and_what_is_left_at_most() -> None:
    status = np.array([Reach.SOLVED, Reach.JOINT_RANGE, Reach.SOLVED], dtype=np.intp)
    found = Inverse(
        ("q1",), np.array([[0.5], [1.0], [1.5]]), np.zeros((3, 0)), np.array([0.0, 0.25, 1e-9]),
        np.array([1e-9, 1e-3, 0.0]), status, np.zeros((3, 1), dtype=bool),
    )  # fmt: skip
    shown = view(found)
    assert shown.title == "Inverse kinematics of 3 poses: 2 solved, 1 joint range"
    assert shown.facts == ("left to the pose at most: 0.25 mm, 0.001 rad; joints in mm and rad",)
    assert shown.rows[1] == ("1", "joint range", "0.25", "0.001")
    none = replace(found, q=np.zeros((0, 1)), position=np.zeros(0), rotation=np.zeros(0), status=status[:0])
    assert view(none).title == "Inverse kinematics of 0 poses: none"
    assert view(none).facts == ("left to the pose at most: 0 mm, 0 rad; joints in mm and rad",)


# -- what poses can tell -------------------------------------------------------------------------------


def test_constants_that_the_readings_tell_least_about_stand_first() -> None:
    """By what is left of the tolerance, to what is no rounding; where nothing decides before all, what is held last."""
    sizes = {
        "half": (0.5, 1.0), "well": (0.1, 1.0), "also half": (0.50000001, 1.0), "nothing": (np.inf, np.inf),
        "seen": (0.2, np.inf), "barely": (0.09, 0.1),
    }  # fmt: skip
    told = tuple(
        ParameterSight(name, "mm", tolerance, std, std, "partly", ())
        for name, (std, tolerance) in sizes.items()
    )
    found = RESULTS["identifiability nanopositioner"]()
    assert isinstance(found, Identifiability)
    own = replace(
        found, parameters=told, files=("/far/off/a.csv",), seed=None, notes=(Note("strokes", "q1"),)
    )
    shown = view(own)
    assert [row[0] for row in shown.rows] == ["nothing", "barely", "half", "also half", "well", "seen"]
    assert shown.rows[0] == ("nothing", "unknown", "unknown", "partly")
    assert shown.rows[1] == ("barely", "0.1 mm", "0.09 mm", "partly")
    assert f"{found.poses} poses of a.csv, " in shown.title
    assert shown.facts[-1] == "note: q1: every move counts as a long one; strokes that shrink are not planned"
    assert all(fact == fact.strip() for fact in shown.facts)
