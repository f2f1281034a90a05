"""Loops of many rows are closed, and readings predicted, some rows at a time: the same as all at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from truepose.identification.prediction import loops
from truepose.identification.prediction import predict as predict_module
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

MACHINE = Path(__file__).resolve().parents[3] / "machines" / "ups.yaml"


@pytest.mark.parametrize("together", [1, 7, 40, 41])
def test_any_number_of_rows_together_close_alike(together: int, monkeypatch: pytest.MonkeyPatch) -> None:
    machine, rng = load_machine(MACHINE), np.random.default_rng(3)
    table = pd.DataFrame(rng.uniform(-6.0, 6.0, (40, 6)), columns=[f"m{k} [turn]" for k in range(1, 7)])
    predictor = Predictor(machine, load_recording(machine, table, need_observations=False))
    whole, good = predictor.assemble(predictor.model.p_home)
    monkeypatch.setattr(loops, "TOGETHER", together)
    parts, same = predictor.assemble(predictor.model.p_home)
    assert good.all()
    np.testing.assert_array_equal(same, good)
    np.testing.assert_allclose(parts, whole, atol=1e-12)


@pytest.mark.parametrize("together", [1, 7, 40])
def test_any_number_of_rows_together_are_predicted_alike(
    together: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, rng = load_machine(MACHINE), np.random.default_rng(4)
    table = pd.DataFrame(rng.uniform(-6.0, 6.0, (40, 6)), columns=[f"m{k} [turn]" for k in range(1, 7)])
    recording = load_recording(machine, table, need_observations=False)
    whole = predict_module.predict(machine, recording)
    monkeypatch.setattr(predict_module, "TOGETHER", together)
    np.testing.assert_allclose(predict_module.predict(machine, recording), whole, rtol=1e-12, atol=1e-12)
