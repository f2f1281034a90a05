"""Laws of the noise that a fit finds: covariances that follow it, and what a model leaves unexplained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support.simulated import machine_from, poses_of
from truepose.identification.fit.decomposition import Decomposition
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.noise import Scatter, unexplained
from truepose.identification.fit.write_machine import calibrated_document, covariance_of
from truepose.identification.prediction.predict import predict
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.file.machine_file import write_machine
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

TEXT = """
schema: truepose/machine/1
name: stage
tolerances: {length: 0.2, angle: 0.05}
mechanism:
  type: serial
  joints:
    - {name: slide, kind: prismatic, alpha: 90, theta: 90, range: [-300, 300]}
    - {name: cross, kind: prismatic, alpha: -90, theta: -90, d: 30, range: [-200, 200]}
    - {name: turn, kind: revolute, alpha: 90, r: 60, range: [-60, 60]}
frames: {base: {xyz: [10, 20, 30], tolerance: {xyz: 5, rpy: 1}}}
sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.004}}
"""
NOISE = {"position": 3.0, "rotation": 1.0}
"""Times the stated sigma."""


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return machine_from(tmp_path_factory.mktemp("noise"), TEXT, "stage")


def measured(machine: Machine, noise: dict[str, float], n: int = 80, seed: int = 3) -> Recording:
    """Readings of the machine as drawn, with noise in stated sigmas by kind."""
    rng = np.random.default_rng(seed)
    q = rng.uniform([-300, -200, -60], [300, 200, 60], (n, 3))
    poses = poses_of(machine, pd.DataFrame(q, columns=["slide", "cross", "turn"]))
    predictor = Predictor(machine, poses)
    p = predictor.model.p_home
    _, values, _, _ = predictor.columns(p, predictor.assemble(p)[0])
    sigma = [c.sigma * noise[c.kind] for c in machine.channels]
    values = values + sigma * rng.standard_normal(values.shape)
    return replace(poses, observations=dict(zip(machine.sensors[0].columns, values.T, strict=True)))


def fitted(machine: Machine, noise: dict[str, float]) -> tuple[Estimate, Recording]:
    recording = measured(machine, noise)
    return estimate(machine, recording), recording


# -- algebra -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("weights", [(1.0, 0.5, 0.0, 2.0, 0.0), (1.0, 1.0, 1.0, 1.0, 1.0), (0.0,) * 5])
def test_a_sandwich_is_the_textbooks(weights: Sequence[float]) -> None:
    """A^-1 M A^-1 with A = slope J'J + P and M = sum of noise J_g'J_g + P; the plain posterior where M is A."""
    rng, weight = np.random.default_rng(2), np.array(weights)
    jacobian, parts = rng.standard_normal((20, 5)), [slice(0, 12), slice(12, 20)]
    known = Decomposition.of(jacobian, weight)
    slope, variance = 0.8, (4.0, 0.6)
    prior = np.diag(weight**2)
    a = slope * jacobian.T @ jacobian + prior
    m = prior + sum(v * jacobian[at].T @ jacobian[at] for v, at in zip(variance, parts, strict=True))
    root = known.root_with(slope, [np.sqrt(v) * jacobian[at] for v, at in zip(variance, parts, strict=True)])
    inverse = np.linalg.inv(a)
    np.testing.assert_allclose(root @ root.T, inverse @ m @ inverse, rtol=1e-8, atol=1e-12)
    same = known.root_with(1.0, [jacobian])
    np.testing.assert_allclose(same @ same.T, known.root @ known.root.T, rtol=1e-8, atol=1e-12)


# -- noise ---------------------------------------------------------------------------------------------


def test_hubers_variance_is_that_of_the_estimate() -> None:
    """A mean of rows with one in twenty gross, weighed by Huber: variance over slope squared is what many means have."""
    rng, n = np.random.default_rng(5), 60
    means, said = [], []
    for _ in range(1500):
        rows = rng.standard_normal((n, 1))
        wild = rng.random(n) < 0.05
        rows[wild] += rng.choice([-1.0, 1.0], (int(wild.sum()), 1)) * 30.0
        mean, weights = 0.0, np.ones(n)
        for _ in range(15):
            weights = np.minimum(1.0, 1.345 / np.maximum(np.abs(rows[:, 0] - mean), 1e-12))
            mean = float(weights @ rows[:, 0] / weights.sum())
        found = Scatter.of(rows - mean, weights, [[0]], [1.0])
        # the factor of a mean is the root of the sum of weights
        said.append(found.variance[0] / found.slope**2 / weights.sum())
        means.append(mean)
    assert np.sqrt(np.mean(said)) == pytest.approx(np.std(means), rel=0.05)  # 1500 runs: 2 % by chance


@pytest.mark.parametrize(("noisier", "expected"), [("position", 3.0), ("rotation", 1.0)])
def test_intervals_follow_the_noise_of_each_kind(stage: Machine, noisier: str, expected: float) -> None:
    """The places of this stage are known from positions: three times worse where those are noisier, not from rotations."""
    plain, noisy = (fitted(stage, dict.fromkeys(NOISE, 1.0) | more)[0] for more in ({}, {noisier: 3.0}))
    places = [k for k, c in enumerate(stage.channels) if c.kind == "position"]
    predictor = Predictor(stage, measured(stage, NOISE))
    (block,) = predictor.blocks(plain.p, predictor.assemble(plain.p)[0])
    free = plain.prior.free
    std = [
        covariance_of(fit).std(block.jacobian[:, places][..., free], fit.prior.scale[free])
        for fit in (plain, noisy)
    ]
    ratio = np.sqrt(np.mean(std[1] ** 2) / np.mean(std[0] ** 2))
    assert ratio == pytest.approx(expected, rel=0.2)
    np.testing.assert_allclose(np.diag(noisy.posterior), np.diag(plain.posterior), rtol=1e-2)


# -- unexplained ---------------------------------------------------------------------------------------


def test_what_no_parameter_explains_is_told_by_kind(stage: Machine) -> None:
    """In the sensor's unit, without rows that are wild; nothing where the noise is as stated."""
    assert covariance_of(fitted(stage, dict.fromkeys(NOISE, 1.0))[0]).unexplained == {}
    fit, _ = fitted(stage, NOISE)
    own = covariance_of(fit).unexplained
    assert list(own) == ["sensor.position"]
    value, unit = own["sensor.position"]
    assert unit == "mm"
    assert value == pytest.approx(0.01 * np.sqrt(8.0), rel=0.15)
    wild = fit.residual.copy()
    wild[::20] += 100.0
    assert unexplained(stage, wild, fit.effective_parameters)["sensor.position"][0] == pytest.approx(
        value, rel=0.05
    )
    assert unexplained(stage, np.full((3, 6), np.nan), 0.0) == {}


def test_predictions_are_as_uncertain_as_what_is_unexplained(stage: Machine, tmp_path: Path) -> None:
    """It adds to every reading of its kind, in a file that says so; and held-out readings are as far off as told."""
    fit, recording = fitted(stage, NOISE)
    document = calibrated_document(fit, recording)
    write_machine(tmp_path / "with.yaml", document)
    told = document["covariance"].pop("unexplained")
    assert told == {"sensor.position": {"value": pytest.approx(0.0283, rel=0.15), "unit": "mm"}}
    write_machine(tmp_path / "without.yaml", document)
    frames = [predict(load_machine(tmp_path / name), recording) for name in ("with.yaml", "without.yaml")]
    for name in ("x.std", "y.std", "z.std"):
        added = np.sqrt(frames[0][name] ** 2 - frames[1][name] ** 2)
        np.testing.assert_allclose(added, told["sensor.position"]["value"], rtol=1e-9)
    for name in ("rx.std", "x", "pose.x"):
        np.testing.assert_array_equal(frames[0][name], frames[1][name])
    fresh = measured(stage, NOISE, seed=9)
    again = predict(load_machine(tmp_path / "with.yaml"), fresh)
    pulls = [(fresh.observations[a] - again[a]) / np.hypot(again[f"{a}.std"], 0.01) for a in "xyz"]
    assert 0.8 < float(np.sqrt(np.mean(np.square(pulls)))) < 1.25
