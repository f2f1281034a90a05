"""Laws of derivatives by ports: they are the derivatives, and their Gram matrix is that of the columns written out."""

from __future__ import annotations

import numpy as np
import pytest

from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.problem import Problem
from truepose.identification.prediction.by_ports import ByPorts, GramSum, Part
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.machine.machine import Machine
from truepose.threads import VARIABLE

Case = tuple[Machine, Recording]


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
def test_derivatives_of_long_series_are_those_of_differences(recorded: Case, orders: float) -> None:
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


def test_a_fit_of_long_series_finds_what_the_same_fit_written_out_finds(
    recorded: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, recording = recorded
    terms = [e.with_values([0.0] * len(e.coefficients)) for e in _series(machine, 60.0, 4)]
    found = estimate(machine, recording, terms)
    monkeypatch.setattr("truepose.identification.prediction.port_kinematics.MANY", 10_000)
    other = estimate(machine, recording, terms)
    std = np.where(
        other.std > 0.0, other.std, 1.0
    )  # directions of a millionth of the prior's information are left out
    np.testing.assert_allclose(found.p / std, other.p / std, atol=1e-3)
    np.testing.assert_allclose(found.std / std, other.std / std, atol=2e-5)


def test_directions_that_no_reading_sees_change_nothing(
    recorded: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Joints over part of a turn: long series are solved for in fewer steps, and say what all steps say.

    Each of tens of directions left out has up to 1e-6 of the prior's information: no 1-sigma is off by more than half of
    their sum, and no value by more than a thousandth of one.
    """
    machine, recording = recorded
    terms = [e.with_values([0.0] * len(e.coefficients)) for e in _series(machine, 120.0, 4)]
    slim = estimate(machine, recording, terms)
    assert slim.turn is not None
    steps, free = len(slim.factor) - 1, len(slim.prior.free)
    assert steps < 0.9 * free and slim.factor.shape == (steps + 1, steps + 1)
    monkeypatch.setattr(f"{Problem.__module__}.WIDE_PROBLEM", 10 * free)
    whole = estimate(machine, recording, terms)
    assert whole.turn is None
    std = np.where(whole.std > 0.0, whole.std, 1.0)
    np.testing.assert_allclose(slim.std / std, whole.std / std, atol=2e-5)
    np.testing.assert_allclose(slim.p / std, whole.p / std, atol=1e-3)
    assert slim.chi2 == pytest.approx(whole.chi2, abs=1e-3)
    assert slim.effective_parameters == pytest.approx(whole.effective_parameters, abs=1e-3)
    at = np.random.default_rng(3).choice(free, 30, replace=False)
    spread = np.sqrt(np.outer(*2 * [np.diag(whole.covariance_among(at))]))
    np.testing.assert_allclose(
        slim.covariance_among(at) / spread, whole.covariance_among(at) / spread, atol=4e-5
    )
    known, other = slim.slopes.T @ slim.slopes, whole.slopes.T @ whole.slopes
    held = whole.prior_weight[:, None] * whole.prior_weight
    assert np.max(np.abs(known - other) / (held + np.sqrt(np.outer(np.diag(other), np.diag(other))))) < 1e-3
    block = next(iter(Predictor(machine, recording, terms).blocks(slim.p, slim.x)))
    written = block.jacobian[:, :, slim.prior.free] * slim.prior.scale[slim.prior.free]
    np.testing.assert_allclose(slim.by_steps(block), written @ slim.turn.matrix.toarray(), atol=1e-9)
    np.testing.assert_allclose(slim.decomposition.lengths, np.linalg.norm(slim.slopes, axis=0), atol=1e-9)
    np.testing.assert_allclose(slim.decomposition.std / whole.decomposition.std, 1.0, atol=2e-5)
    blind = slim.null_space @ slim.turn.matrix
    assert np.linalg.norm(slim.slopes @ slim.null_space.T) < 1e-2 * np.linalg.norm(slim.slopes)
    assert blind.shape[0] == free - slim.rank


def test_threads_change_no_digit_of_a_fit(recorded: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows come in several blocks, and chunks of a batch are shared out, too."""
    machine, recording = recorded
    monkeypatch.setattr("truepose.identification.prediction.predictor.BLOCK", 7)
    monkeypatch.setattr("truepose.codegen.evaluation.batch.ALONE", 5)
    monkeypatch.setattr("truepose.codegen.evaluation.batch.CHUNK", 4)
    terms = [e.with_values([0.0] * len(e.coefficients)) for e in _series(machine, 80.0, 4)]
    found = []
    for threads in ("1", "2", "5"):
        monkeypatch.setenv(VARIABLE, threads)
        found.append(estimate(machine, recording, terms))
    for other in found[1:]:
        assert np.array_equal(other.p, found[0].p) and np.array_equal(other.std, found[0].std)


@pytest.mark.parametrize("orders", [60.0, 120.0])
def test_columns_of_long_series_are_those_of_directions(
    recorded: tuple[Machine, Recording], orders: float
) -> None:
    """A linearisation in directions is the one in coefficients, turned; what is left out no reading sees."""
    machine, recording = recorded
    terms = _series(machine, orders, 4)
    fit = estimate(machine, recording, [e.with_values([0.0] * len(e.coefficients)) for e in terms[:1]])
    plain = Signatures(machine, recording, terms)
    slim = plain.seen_from(fit)
    assert slim.width < plain.width and slim.seen_from(fit) is slim and slim.of(terms).turns == slim.turns
    wide, few = plain.linearise(fit), slim.linearise(fit)
    size = wide.free + plain.width
    turn = np.zeros((size, few.free + slim.width))
    turn[: wide.free, : few.free] = np.eye(wide.free)
    for k, (own, columns) in enumerate(zip(plain.columns, slim.columns, strict=True)):
        rows = slice(wide.free + own.start, wide.free + own.stop)
        turn[rows, few.free + columns.start : few.free + columns.stop] = few.turn(k)
    for gram, other in zip(few.grams, wide.grams, strict=True):
        length = np.sqrt(np.maximum(np.diag(gram), 1e-300))[: turn.shape[1]]
        turned = turn.T @ other[:size, :size] @ turn
        np.testing.assert_allclose(gram[: len(length), : len(length)] / np.outer(length, length),
                                   turned / np.outer(length, length), atol=1e-8)  # fmt: skip
    gone = np.linalg.qr(few.turn(0), mode="complete")[0][:, few.turn(0).shape[1] :]
    at = wide.free + np.arange(plain.columns[0].start, plain.columns[0].stop)
    assert np.max(np.linalg.eigvalsh(gone.T @ wide.among(at, at) @ gone), initial=0.0) < 2e-3
    amplitudes = few.departure[few.free : few.free + slim.columns[0].stop]
    fitted = wide.departure[wide.free : wide.free + plain.columns[0].stop]
    assert few.turn(0) @ amplitudes == pytest.approx(few.turn(0) @ few.turn(0).T @ fitted, abs=1e-12)


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
        total = GramSum(7, channels)
        total.add(part)
        total.add(part)
        assert total.matrix() == pytest.approx(2.0 * flat.T @ flat, abs=1e-12)
    assert part.readings([1, 2]) == 2 * n
