"""Predictions of effects outside of what the fit saw: as sure inside as ever, and less sure the farther outside."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.searched_arm import ROWS, SCALE, Case
from truepose.arrays import Array
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predict import predict
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prior import FORM_ERROR
from truepose.models.effect_text import parse_effect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

COLUMNS = ("x", "y", "z")


@pytest.fixture
def case(tmp_path: Path) -> Case:
    return Case.of(tmp_path, SCALE)


def calibrated(case: Case, folder: Path, *effects: str) -> Machine:
    """The machine file of a fit with some effects, read again."""
    machine, recording = case.signatures.machine, case.signatures.recording
    fit = estimate(machine, recording, [parse_effect(text, machine) for text in effects])
    write_calibrated(folder / "calibrated.yaml", fit, recording)
    return load_machine(folder / "calibrated.yaml")


def without_ranges(machine: Machine) -> Machine:
    """As a file that says nothing of what was seen."""
    assert machine.file is not None and machine.file.covariance is not None
    told = {key: value for key, value in machine.file.covariance.items() if key != "seen"}
    return replace(machine, file=replace(machine.file, covariance=told))


def std(machine: Machine, case: Case, turned: float = 0.0) -> Array:
    """(n, 3) 1-sigma of the rows with q1 turned on by so much (rad)."""
    q = case.signatures.recording.q.copy()
    q[:, 0] += turned
    frame = predict(machine, replace(case.signatures.recording, q=q))
    return frame[[f"{c}.std" for c in COLUMNS]].to_numpy()


def test_inside_nothing_changes_and_outside_it_grows_to_the_error_of_form(case: Case, tmp_path: Path) -> None:
    machine = calibrated(case, tmp_path, SCALE)
    plain = without_ranges(machine)
    np.testing.assert_allclose(std(machine, case), std(plain, case), rtol=1e-12)
    low, high = case.signatures.recording.q[:, 0].min(), case.signatures.recording.q[:, 0].max()
    before = np.zeros((ROWS, 3))
    for turned in (1.0 * (high - low), 2.0 * (high - low), 20.0 * (high - low)):
        added = np.sqrt(std(machine, case, turned) ** 2 - std(plain, case, turned) ** 2)
        signal = moved_by_effect(machine, case, turned)
        assert np.all(added <= np.sqrt(2.0) * FORM_ERROR * signal * (1 + 1e-6) + 1e-12)
        share = added / np.maximum(signal, 1e-9)
        assert np.all(share >= before - 1e-6)
        before = share
    np.testing.assert_allclose(before[signal > 0.1], np.sqrt(2.0) * FORM_ERROR, rtol=1e-3)


def moved_by_effect(machine: Machine, case: Case, turned: float) -> Array:
    """(n, 3) how far the effect moves the readings, linear."""
    q = case.signatures.recording.q.copy()
    q[:, 0] += turned
    predictor = Predictor(machine, replace(case.signatures.recording, q=q), machine.effects)
    p = predictor.model.p_home
    x, _ = predictor.assemble(p)
    _, _, jacobian, _ = predictor.columns(p, x)
    count = len(machine.parameters)
    return np.abs(jacobian[:, :, count:] @ p[count:])
