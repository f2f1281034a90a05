"""Laws of derivatives by ports: they are the derivatives, and their Gram matrix is that of the columns written out."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from truepose.identification.fit.estimate import estimate
from truepose.identification.prediction.by_ports import ByPorts, Part
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.machine import Machine

Array = NDArray[np.float64]


def _series(machine: Machine, orders: float, seed: int) -> list[PlacedEffect]:
    """A gear's series at two joints, a wobbling axis that moves several ports, a sensor's scale that reads what is seen."""
    rng = np.random.default_rng(seed)
    gear, wobble, scale = (
        effects.get(s, "test")() for s in ("transmission-error", "axis-wobble", "sensor-scale")
    )
    every = [PlacedEffect.at(gear, machine, (joint,), {"orders": orders}) for joint in ("q2", "q3")]
    every += [PlacedEffect.at(wobble, machine, ("q4",)), PlacedEffect.at(scale, machine, ("sensor",))]
    return [e.with_values((1e-5 * rng.standard_normal(len(e.coefficients))).tolist()) for e in every]


@pytest.mark.parametrize("orders", [20.0, 40.0])
def test_derivatives_of_long_series_are_those_of_differences(
    recorded: tuple[Machine, Recording], orders: float
) -> None:
    """20 orders are written out, 40 follow ports. Steps of a coefficient; readings of about a metre, whitened by 0.01 mm."""
    machine, recording = recorded
    recording = recording.subset(np.arange(6))
    predictor = Predictor(machine, recording, _series(machine, orders, 3))
    p, rng = predictor.model.p_home, np.random.default_rng(5)
    x, _ = predictor.assemble(p)
    jacobian = next(iter(predictor.blocks(p, x))).jacobian
    for k in rng.choice(len(p), 25, replace=False):
        step = np.zeros(len(p))
        step[k] = 1e-5
        above, below = (next(iter(predictor.blocks(p + s, x))).residual for s in (step, -step))
        slope = (above - below) / 2e-5
        assert jacobian[:, :, k] == pytest.approx(
            slope, rel=1e-4, abs=1e-4 * np.max(np.abs(jacobian[:, :, k])) + 1e-3
        )


def test_gram_matrix_is_that_of_the_columns_written_out() -> None:
    rng = np.random.default_rng(11)
    n, m = 30, 4
    ports = ByPorts(
        rng.standard_normal((n, m, 3)),
        np.array([0, 2, 2, 1]),
        np.array([1, 3, 4, 6]),
        rng.standard_normal((n, 4)),
    )
    part = Part(rng.standard_normal((n, m, 3)), np.array([0, 2, 5]), ports)
    columns = np.empty((n, m, 7))
    columns[:, :, part.at] = part.dense
    ports.put_into(columns)
    for channels in (None, [0, 3]):
        flat = columns[:, channels or slice(None)].reshape(-1, 7)
        assert part.gram(7, channels) == pytest.approx(flat.T @ flat, abs=1e-12)
    assert part.readings([1, 2]) == 2 * n


def test_a_fit_of_long_series_finds_what_the_same_fit_written_out_finds(
    recorded: tuple[Machine, Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, recording = recorded
    terms = [e.with_values([0.0] * len(e.coefficients)) for e in _series(machine, 60.0, 4)]
    found = estimate(machine, recording, terms)
    monkeypatch.setattr("truepose.identification.prediction.port_kinematics.MANY", 10_000)
    other = estimate(machine, recording, terms)
    assert found.p == pytest.approx(other.p, rel=1e-6, abs=1e-9)
    assert found.std == pytest.approx(other.std, rel=1e-6, abs=1e-12)
