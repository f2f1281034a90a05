"""Loops of a machine a thousand times larger, and changes between rows that are predicted some at a time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from support import MACHINES
from truepose.arrays import Array
from truepose.identification.prediction import predict as predict_module
from truepose.identification.prediction.predict import predict
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.load import load_machine
from truepose.models.machine.closure import slides_of
from truepose.models.machine.machine import Machine


def machine_of(name: str) -> Machine:
    return load_machine(MACHINES / f"{name}.yaml")


def rows_of(machine: Machine, q: Array, **columns: Any) -> Recording:
    data = {f"{a.reading} [{a.reading_unit}]": q[:, k] for k, a in enumerate(machine.mechanism.actuators)}
    unbound = tuple(replace(a, range=None) for a in machine.mechanism.actuators)
    free = replace(machine, mechanism=replace(machine.mechanism, actuators=unbound))
    return load_recording(free, pd.DataFrame({**data, **columns}), need_observations=False)


def drawn(machine: Machine, n: int) -> Array:
    low, high = np.array([a.range for a in machine.mechanism.actuators], dtype=float).T
    return np.random.default_rng(7).uniform(low, high, (n, len(low)))


@pytest.mark.parametrize("name", ["pus", "planar"])
def test_a_machine_a_thousand_times_larger_closes_its_loops_alike(name: str) -> None:
    """Lengths a thousandfold, angles as they are: in the same few steps, none of which is too long for it."""
    machine, factor = machine_of(name), 1000.0
    q = drawn(machine, 6)
    small = Predictor(machine, rows_of(machine, q))
    p = small.model.p_home
    x, good = small.assemble(p)
    units = [a.reading_unit for a in machine.mechanism.actuators]
    grown = q * np.where([unit == "mm" for unit in units], factor, 1.0)
    kinds = {parameter.name: parameter.unit for parameter in machine.parameters}
    lengths = [kinds[n] == "mm" for n in small.model.names]
    large = Predictor(machine, rows_of(machine, grown))
    y, same = large.assemble(np.where(lengths, factor, 1.0) * p, larger=factor)
    assert good.all() and same.all()
    slides = list(slides_of(machine.mechanism))
    slides += [False] * (x.shape[1] - len(slides))
    np.testing.assert_allclose(y, x * np.where(slides, factor, 1.0), rtol=1e-7, atol=1e-6)


def test_changes_are_predicted_with_all_rows_that_they_count_from(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = machine_of("distance")
    recording = rows_of(machine, drawn(machine, 6), **{"pose": np.arange(6), "from": [0, 1, 0, 1, 2, 0]})
    whole = predict(machine, recording)
    monkeypatch.setattr(predict_module, "TOGETHER", 2)
    pd.testing.assert_frame_equal(predict(machine, recording), whole)
