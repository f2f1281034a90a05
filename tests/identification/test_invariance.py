"""The same readings told otherwise (in other units, in another order, from another base) give the same answer."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from numpy.typing import NDArray

from support.examples import NIGHT
from truepose.identification.diagnosis.engine import diagnose
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.fit.estimate import Estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prediction.simulate import simulate
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.effect_text import parse_effect
from truepose.models.load import load_machine
from truepose.models.machine import Machine

Array = NDArray[np.float64]
SAME = 1e-8
"""Relative to the parameter, or to its tolerance where it is smaller: as built it is of that size."""
Document = dict[str, Any]
BASE = {"xyz": [10.0, -20.0, 30.0], "rpy": [4.0, -3.0, 25.0], "tolerance": {"xyz": 5.0, "rpy": 1.0}}
TOOL = {"xyz": [5.0, -7.0, 60.0], "rpy": [0.0, 0.0, 0.0], "tolerance": {"xyz": 1.0, "rpy": 0.5}}
POSE = {"type": "pose", "sigma": {"xyz": 0.01, "rot": 0.005}}
ENDS = (
    ([391.3, -83.2, 0.0], [173.6, -179.9, 0.0]),
    ([391.3, 83.2, 0.0], [173.6, 179.9, 0.0]),
    ([-123.6, 380.5, 0.0], [69.0, 240.3, 0.0]),
    ([-267.7, 297.3, 0.0], [-242.6, 60.4, 0.0]),
    ([-267.7, -297.3, 0.0], [-242.6, -60.4, 0.0]),
    ([-123.6, -380.5, 0.0], [69.0, -240.3, 0.0]),
)
MECHANISMS: Mapping[str, Document] = {
    "arm": {
        "type": "serial",
        "joints": [
            {"name": "q1", "kind": "prismatic", "r": 0.0, "range": [-150.0, 150.0]},
            {"name": "q2", "kind": "revolute", "alpha": 90.0, "d": 40.0, "r": 100.0, "range": [-90.0, 90.0]},
            {"name": "q3", "kind": "revolute", "d": 300.0, "range": [-90.0, 90.0]},
        ],
    },
    "hexapod": {
        "type": "6-pus",
        "home": [0.0, 0.0, 440.0, 0.0, 0.0, 0.0],
        "legs": [
            {"name": f"leg{k}", "joint": f"rho{k}", "a": a, "b": b, "length": 500.0, "range": [-80.0, 80.0]}
            for k, (a, b) in enumerate(ENDS, start=1)
        ],
    },
    "pair": {
        "type": "serial",
        "joints": [
            {"name": "q1", "kind": "prismatic", "range": [-100.0, 100.0]},
            {"name": "q2", "kind": "revolute", "d": 50.0, "range": [-90.0, 90.0]},
        ],
    },
}
LENGTHS = ("r", "d", "length", "offset", "a", "b", "xyz")
ANGLES = ("alpha", "beta", "theta", "rpy", "rot", "angle")


@dataclass(frozen=True)
class Case:
    """A machine file's document and the table of its recording."""

    document: Document
    table: pd.DataFrame

    def loaded(self, folder: Path) -> tuple[Machine, Recording]:
        """By way of files, as a user would."""
        (folder / "m.yaml").write_text(yaml.safe_dump(self.document, sort_keys=False))
        self.table.to_csv(folder / "r.csv", index=False, float_format="%.17g")
        machine = load_machine(folder / "m.yaml")
        return machine, load_recording(machine, [folder / "r.csv"], need_observations="x" in self.table)


def described(name: str) -> Document:
    return {
        "schema": "truepose/machine/1",
        "name": name,
        "mechanism": copy.deepcopy(MECHANISMS[name]),
        "frames": {"base": copy.deepcopy(BASE), "tool": copy.deepcopy(TOOL)},
        "sensor": copy.deepcopy(POSE),
        "tolerances": {"length": 0.2, "angle": 0.1},
    }


def recorded(
    document: Document, folder: Path, rows: int, effects: tuple[str, ...] = (), seed: int = 1
) -> Case:
    """Readings of a machine drawn from the tolerances, with time and the way each joint came."""
    rng = np.random.default_rng(seed)
    machine, _ = Case(document, pd.DataFrame({name: [0.0] for name in _readings(document)})).loaded(folder)
    ranges = np.array([a.range for a in machine.mechanism.actuators], dtype=float)
    turns = np.array([a.unit == "rad" for a in machine.mechanism.actuators])
    q = ranges.mean(axis=1) + 0.4 * np.ptp(ranges, axis=1) * rng.uniform(-1, 1, (rows, len(ranges)))
    table = pd.DataFrame(np.where(turns, np.degrees(q), q), columns=list(machine.mechanism.readings))
    table["time"] = 7.0 * np.arange(rows)
    for name in machine.mechanism.readings:
        table[f"approach.{name}"] = rng.choice([-1.0, 1.0], rows)
    machine, poses = Case(document, table).loaded(folder)
    if effects:
        read = simulate(machine, poses, [parse_effect(text, machine) for text in effects], seed=seed)
        return Case(document, pd.concat([table, read], axis=1))
    truth = np.array([p.nominal + p.tolerance * rng.standard_normal() for p in machine.parameters])
    predictor = Predictor(machine, poses)
    names, values, _, _ = predictor.columns(truth, predictor.assemble(truth)[0])
    values = machine.sensors[0].noisy(values, rng)
    values[:, 3:] = np.degrees(values[:, 3:])
    return Case(document, pd.concat([table, pd.DataFrame(values, columns=names)], axis=1))


def _readings(document: Document) -> list[str]:
    mechanism = document["mechanism"]
    return (
        [j["name"] for j in mechanism["joints"]]
        if "joints" in mechanism
        else [g["joint"] for g in mechanism["legs"]]
    )


# ------------------------------------------------------------------------------------ ways to tell it


def as_it_is(case: Case) -> Case:
    return case


def in_um_and_mrad(case: Case) -> Case:
    """Every length in um and every angle in mrad, in the machine file and in the recording."""
    document = _rescaled(case.document, 1e3, 1e3 * np.pi / 180)
    table, factors = case.table.copy(), {"x": 1e3, "y": 1e3, "z": 1e3}
    for joint in document["mechanism"].get("joints", document["mechanism"].get("legs")):
        angle = joint.get("kind") == "revolute"
        factors[joint.get("joint", joint["name"])] = 1e3 * (np.pi / 180 if angle else 1.0)
    for name in table.columns:
        table[name] *= factors.get(name, 1e3 * np.pi / 180 if name in ("rx", "ry", "rz") else 1.0)
    return Case({**document, "units": {"length": "um", "angle": "mrad"}}, table)


def _rescaled(value: Any, length: float, angle: float) -> Any:
    if isinstance(value, list):
        return [_rescaled(item, length, angle) for item in value]
    if not isinstance(value, dict):
        return value
    out = {}
    for key, item in value.items():
        if key == "range":
            out[key] = _times(item, angle if value.get("kind") == "revolute" else length)
        elif key == "home":
            out[key] = _times(item[:3], length) + _times(item[3:], angle)
        elif key in LENGTHS:
            out[key] = _times(item, length)
        elif key in ANGLES:
            out[key] = _times(item, angle)
        else:
            out[key] = _rescaled(item, length, angle)
    return out


def _times(value: Any, factor: float) -> Any:
    return [_times(item, factor) for item in value] if isinstance(value, list) else value * factor


def shuffled(case: Case) -> Case:
    """Rows in another order; time and the way joints came are recorded."""
    return Case(case.document, case.table.sample(frac=1.0, random_state=3))


def elsewhere(case: Case) -> Case:
    """The base 700 mm away and turned about the vertical, so that rpy tolerances mean the same."""
    return moved(case, [0.0, 0.0, 1.2])


def overturned(case: Case) -> Case:
    """The base turned about all axes: only where nothing is known of it does that mean the same."""
    return moved(case, [0.5, -0.8, 1.2])


def moved(case: Case, turn: list[float]) -> Case:
    document, table = copy.deepcopy(case.document), case.table.copy()
    base, rotation, shift = (
        document["frames"]["base"],
        lie.exp_so3(np.array(turn)),
        np.array([100.0, -50.0, 700.0]),
    )
    base["xyz"] = (rotation @ np.array(base["xyz"]) + shift).tolist()
    base["rpy"] = np.degrees(lie.rpy_of(rotation @ lie.rpy_matrix(np.radians(base["rpy"])))).tolist()
    table[["x", "y", "z"]] = table[["x", "y", "z"]].to_numpy() @ rotation.T + shift
    read = lie.exp_so3(np.radians(table[["rx", "ry", "rz"]].to_numpy()))
    table[["rx", "ry", "rz"]] = np.degrees(lie.log_so3(rotation @ read))
    return Case(document, table)


OTHERWISE: Mapping[str, Callable[[Case], Case]] = {
    "um and mrad": in_um_and_mrad,
    "shuffled": shuffled,
    "elsewhere": elsewhere,
}


def altogether(case: Case) -> Case:
    """Elsewhere, shuffled, and last in other units: the other ways are written in mm and deg."""
    return in_um_and_mrad(shuffled(elsewhere(case)))


def apart(one: Estimate, other: Estimate) -> float:
    """Largest relative difference of two estimates' physical parameters: all but where the base stands."""
    assert one.prior.names == other.prior.names
    inside = [k for k in one.prior.free if not one.prior.names[k].startswith("base.")]
    size = np.maximum(np.abs(one.p[inside]), one.prior.scale[inside])
    return float(np.max(np.abs(one.p - other.p)[inside] / size))


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
