"""The same readings told otherwise (in other units, in another order, from another base) give the same answer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from support.examples import NIGHT
from support.told_otherwise import (
    OTHERWISE,
    Case,
    altogether,
    apart,
    as_it_is,
    described,
    overturned,
    recorded,
    shuffled,
)
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.prediction.predict import simulate

SAME = 1e-8
"""Relative to the parameter, or to its tolerance where it is smaller: as built it is of that size."""


# ------------------------------------------------------------------------------------ calibration


@pytest.mark.parametrize(
    ("name", "estimator"),
    [
        ("arm", "map"),
        ("arm", "ols"),
        ("arm", "liu"),
        ("arm", "huber"),
        ("hexapod", "map"),
        ("hexapod", "ridge"),
    ],
)
def test_a_calibration_is_the_same_however_it_is_told(tmp_path: Path, name: str, estimator: str) -> None:
    case = recorded(described(name), tmp_path, 30)
    plain = calibrate(*case.loaded(tmp_path), estimator=estimator).fit
    for what, tell in OTHERWISE.items():
        fit = calibrate(*tell(case).loaded(tmp_path), estimator=estimator).fit
        assert apart(plain, fit) < SAME, what
        assert fit.chi2 == pytest.approx(plain.chi2, rel=1e-9), what
        inside = [k for k in plain.prior.free if not plain.prior.names[k].startswith("base.")]
        seen = plain.std[inside] < 1e6  # what nothing determines is of 1e15 steps, give or take rounding
        np.testing.assert_allclose(fit.std[inside][seen], plain.std[inside][seen], rtol=1e-5, err_msg=what)


@pytest.mark.parametrize("solver", ["gn", "lm", "ipopt"])
@pytest.mark.parametrize("name", ["arm", "hexapod"])
def test_a_base_that_may_be_anywhere_may_be_turned_about_any_axis(
    tmp_path: Path, name: str, solver: str
) -> None:
    """The start is another, and so is the way to the minimum; the minimum is not."""
    document = described(name)
    case = recorded(document, tmp_path, 30)
    document["frames"]["base"]["tolerance"] = {"xyz": np.inf, "rpy": np.inf}
    fits = [calibrate(*tell(case).loaded(tmp_path), solver=solver).fit for tell in (as_it_is, overturned)]
    assert apart(*fits) < SAME


def test_changes_are_from_the_same_rows_however_they_are_ordered(tmp_path: Path) -> None:
    """The distance sensor's ``from`` names a pose: with time, the order of the rows says nothing."""
    document = described("arm")
    case = recorded(document, tmp_path, 30)
    document["sensor"] = [
        {"type": "position", "sigma": {"xyz": 0.02}},
        {
            "type": "distance",
            "beam": {"xyz": [0.0, 0.0, -900.0]},
            "mirror": {"in": "tool", "rx": 3.0, "ry": -4.0},
            "sigma": {"distance": 0.001},
        },
    ]
    table = case.table.drop(columns=["x", "y", "z", "rx", "ry", "rz"])
    # three poses measured again and again, so that only time tells which one is meant
    table["pose"], table["from"] = np.arange(30) % 3, np.roll(np.arange(30) % 3, 1)
    table.loc[0, "from"] = 0
    machine, poses = Case(document, table).loaded(tmp_path)
    told = Case(document, pd.concat([table, simulate(machine, poses, seed=4)], axis=1))
    fits = [calibrate(*tell(told).loaded(tmp_path)).fit for tell in (as_it_is, shuffled)]
    assert fits[0].chi2_per_dof == pytest.approx(1.0, abs=0.5)
    assert apart(*fits) < SAME


# ------------------------------------------------------------------------------------ diagnosis


def said(diagnosis: Diagnosis) -> dict[str, Any]:
    """What a diagnosis says, without numbers."""
    return {
        "verdict": diagnosis.verdict,
        "concealed": diagnosis.concealed,
        "findings": [(f.effect, f.place) for f in diagnosis.findings],
        "raised": {name: alarm.raised for name, alarm in diagnosis.alarms.items()},
        "outliers": len(diagnosis.outlier_rows),
    }


def probabilities(diagnosis: Diagnosis) -> list[float]:
    return [f.probability for f in diagnosis.findings]


DIAGNOSED = OTHERWISE if NIGHT else {"altogether": altogether}
"""One by one at night."""


@pytest.mark.parametrize("effects", [(), ("backlash@q2:b=0.3[deg]",), ("actuator-scale@q1:s=0.01",)])
def test_a_diagnosis_is_the_same_however_it_is_told(tmp_path: Path, effects: tuple[str, ...]) -> None:
    case = recorded(described("pair"), tmp_path, 40, effects)
    plain = diagnose(*case.loaded(tmp_path))
    assert plain.verdict == ("missing-physics" if effects else "adequate")
    assert [f.effect for f in plain.findings] == [text.split("@")[0] for text in effects]
    for what, tell in DIAGNOSED.items():
        again = diagnose(*tell(case).loaded(tmp_path))
        assert said(again) == said(plain), what
        # in other units and in another order the last digits of sums differ, and with them what chains draw
        assert probabilities(again) == pytest.approx(probabilities(plain), abs=0.03), what
        assert apart(plain.after, again.after) < SAME, what
        assert again.fits["free"].chi2_per_dof == pytest.approx(plain.fits["free"].chi2_per_dof, rel=1e-4), (
            what
        )
