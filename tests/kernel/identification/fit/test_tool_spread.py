"""Laws of the tool's uncertainty budget: its parts are those of the covariance, and repeated fits scatter as it says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from support.effect_machines import read_machines
from support.exact_fits import posed
from support.moving_machines import record, written
from truepose.arrays import Array
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.noise import unexplained
from truepose.identification.fit.problem import prior_of
from truepose.identification.fit.tool_pose import (
    EXPLANATIONS,
    READINGS,
    TOLERANCES,
    UNEXPLAINED,
    tool_spread,
)
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

SMALL = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: -90, d: 100, range: [-90, 90]}
frames: {tool: {in: flange, xyz: [400, 50, 30], tolerance: {xyz: 0.1}}}
sensor: {type: position, sigma: {xyz: 0.05}}
"""
GANTRY = """
mechanism:
  type: serial
  joints:
    - {name: x1, kind: prismatic, range: [-100, 100]}
    - {name: x2, kind: prismatic, alpha: -90, theta: -90, range: [-50, 150]}
    - {name: x3, kind: prismatic, alpha: -90, theta: -90}
sensor: {type: position, sigma: {xyz: 0.01}}
"""


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.getbasetemp() / "spread")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return written(tmp_path_factory.mktemp("small"), SMALL)


def drawn(machine: Machine, rng: np.random.Generator, size: float = 1.0) -> Array:
    """True constants (np,), normal about the drawing."""
    sigma = np.array([p.tolerance for p in machine.parameters])
    return np.array([p.nominal for p in machine.parameters]) + size * sigma * rng.normal(size=len(sigma))


def measured(
    machine: Machine, poses: Recording, truth: Array, rng: np.random.Generator, noise: float = 1.0
) -> Recording:
    """Readings of a machine with these constants, with so many sigmas of noise."""
    predictor = Predictor(machine, poses)
    names, exact, _, _ = predictor.columns(truth, predictor.assemble(truth)[0])
    sigma = np.array([channel.sigma for channel in machine.channels])
    values = exact + noise * sigma * rng.normal(size=exact.shape)
    return replace(poses, observations=dict(zip(names, values.T, strict=True)))


def slopes(fit: Estimate, recording: Recording, rows: NDArray[np.intp]) -> Array:
    """(k, 3, n_free) change of the tool's position by each free constant, by central differences, loops closed anew."""
    out = []
    for entry in fit.prior.free:
        step = 1e-3 * fit.prior.scale[entry] * np.eye(len(fit.p))[entry]
        predictor = Predictor(fit.nominal, recording.subset(rows), fit.effects)
        ends = [predictor.poses(fit.p + s)[0][:, :3, 3] for s in (step, -step)]
        out.append((ends[0] - ends[1]) / (2e-3 * fit.prior.scale[entry]))
    return np.stack(out, axis=2)


@pytest.mark.parametrize("loss", ["gauss", "huber"])
@pytest.mark.parametrize("name", ["arm", "stage", "gough", "camera"])
def test_parts_add_up_to_the_covariance_at_the_tool(
    machines: Mapping[str, Machine], name: str, loss: str
) -> None:
    machine, rng = machines[name], np.random.default_rng(5)
    recording = measured(machine, posed(machine), drawn(machine, rng, 0.3), rng, noise=1.5)
    wild = {k: v.copy() for k, v in recording.observations.items()}
    next(iter(wild.values()))[:2] += 0.5 if loss == "huber" else 0.0
    recording = replace(recording, observations=wild)
    fit = estimate(machine, recording, loss=loss)
    rows = np.array([0, 11, 25], dtype=np.intp)
    spread = tool_spread(fit, recording, rows)
    by = slopes(fit, recording, rows)
    whole = np.einsum("kij,jl,kil->k", by, fit.covariance, by)
    found = spread.variance[READINGS] + spread.variance[TOLERANCES]
    np.testing.assert_allclose(found, whole, rtol=2e-4)
    assert EXPLANATIONS not in spread.variance
    assert (spread.variance[READINGS] > 0).all() and (spread.variance[TOLERANCES] >= 0).all()
    np.testing.assert_allclose(spread.std**2, sum(spread.variance.values()))
    predictor = Predictor(machine, recording.subset(rows))
    np.testing.assert_allclose(spread.position, predictor.poses(fit.p)[0][:, :3, 3], atol=1e-6)


def test_what_no_parameter_explains_is_added_to_all(small: Machine) -> None:
    rng = np.random.default_rng(8)
    poses = record(small, rng.uniform(-1.4, 1.4, (60, 2)))
    quiet = measured(small, poses, drawn(small, rng), rng)
    loud = measured(small, poses, drawn(small, rng), rng, noise=4.0)
    rows = np.arange(5, dtype=np.intp)
    assert UNEXPLAINED not in tool_spread(estimate(small, quiet), quiet, rows).variance
    fit = estimate(small, loud)
    (size, unit) = unexplained(small, fit.residual, fit.effective_parameters)["sensor.position"]
    assert unit == "mm" and size == pytest.approx(0.05 * np.sqrt(15.0), rel=0.15)
    np.testing.assert_allclose(tool_spread(fit, loud, rows).variance[UNEXPLAINED], 3.0 * size**2)


REFITS = 80


@pytest.mark.parametrize(
    ("constants", "noise", "source"), [(0.0, 1.0, READINGS), (1.0, 0.0, TOLERANCES), (1.0, 1.0, "both")]
)
def test_refits_scatter_as_the_budget_says(
    small: Machine, constants: float, noise: float, source: str
) -> None:
    """Noise drawn anew, machines drawn anew, or both: the model's error at unmeasured poses, mean square over refits.

    REFITS refits of at least three independent components: the ratio's own standard deviation is below
    sqrt(2 / (3 * 80)) = 0.09; some three of these are allowed.
    """
    rng = np.random.default_rng(11)
    poses = record(small, rng.uniform(-1.0, 1.0, (12, 2)))
    asked = record(small, rng.uniform(-1.4, 1.4, (8, 2)))
    rows = np.arange(8, dtype=np.intp)
    seen, shared = Predictor(small, asked), Predictor(small, poses)
    squares = np.zeros(8)
    for _ in range(REFITS):
        truth = drawn(small, rng, constants)
        recording = measured(small, poses, truth, rng, noise)
        fit = estimate(small, recording, predictor=shared.over(recording))
        off = (seen.poses(fit.p)[0] - seen.poses(truth)[0])[:, :3, 3]
        squares += np.sum(off**2, axis=1) / REFITS
    one = estimate(small, measured(small, poses, drawn(small, rng), rng))
    object.__setattr__(one, "scatter", type(one.scatter)((1.0,)))  # sigma is as stated here
    spread = tool_spread(one, poses, rows, asked.q)
    parts = spread.variance
    told = parts[READINGS] + parts[TOLERANCES] if source == "both" else parts[source]
    assert np.mean(squares) == pytest.approx(np.mean(told), rel=0.3)
    assert np.max(np.abs(np.log(squares / told))) < np.log(2.0)


def test_the_readings_part_shrinks_with_their_number(small: Machine) -> None:
    """As 1/n where the readings decide; tolerances are left as they were where the readings say nothing."""
    rng = np.random.default_rng(2)
    poses = record(small, rng.uniform(-1.4, 1.4, (20, 2)))
    wide = prior_of(small).with_sigma(100.0 * prior_of(small).sigma)
    rows = np.arange(20, dtype=np.intp)
    found = []
    for times in (1, 4, 16):
        many = record(small, np.tile(poses.q, (times, 1)))
        recording = measured(small, many, drawn(small, np.random.default_rng(1)), rng)
        fit = estimate(small, recording, prior=wide)
        noise = fit.scatter.variance[0]
        spread = tool_spread(fit, recording, rows)
        found.append(np.mean(spread.variance[READINGS]) / noise)
        assert np.mean(spread.variance[TOLERANCES]) < 0.02 * np.mean(spread.variance[READINGS])
    np.testing.assert_allclose(np.divide(found[0], found), [1.0, 4.0, 16.0], rtol=0.05)
