"""How often a calibration's 95 % intervals hold the truth: 1,000 simulated calibrations of small machines.

    python -m benchmarks.interval_coverage [--runs 1000] [-o benchmarks/results/coverage.md]

Every calibration has a machine of its own, drawn from the tolerances, and noise of its own. The sigma that the file
states is right, too small, too large, or taken from repeated poses; or one row in twenty is grossly wrong.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from truepose.files import atomic_write_text
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.write_machine import covariance_of
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.machine.sensor import Sensor

Array = NDArray[np.float64]
HEAD = "schema: truepose/machine/1\nname: {name}\ntolerances: {{length: 0.2, angle: 0.05}}\n"
FRAMES = """frames:
  base: {xyz: [100, 20, 5], rpy: [1, 2, 40], tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [10, 20, 120], rpy: [0, 0, 0], tolerance: {xyz: 1, rpy: 0}}
"""
THREE_AXES = """mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: -90, d: 150, range: [-100, 60]}
    - {name: q3, kind: revolute, d: 455, range: [-100, 120]}
sensor: {type: position, sigma: {xyz: 0.02}}
"""
SLIDES = """mechanism:
  type: serial
  joints:
    - {name: x, kind: prismatic, alpha: 90, theta: 90, range: [-300, 300]}
    - {name: y, kind: prismatic, alpha: -90, theta: -90, d: 30, range: [-200, 200]}
    - {name: turn, kind: revolute, d: 60, range: [-60, 60]}
sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.004}}
"""
MACHINES = {"arm of three joints, positions": THREE_AXES, "two slides and a table, poses": SLIDES}
GROSS = 0.05
FAR = (10.0, 100.0)
"""Size of a gross error, in sigmas."""
LEVEL = 1.96
GIVEN_UP = 0.25
"""Rows that Huber's loss weighs less are set aside: more than six times as far off as half of the rows."""
DETERMINED = 0.5
"""Parameters count whose 1-sigma is below this share of their tolerance: the others know what the file told them."""
PAGE = """# How often the intervals hold

    python -m benchmarks.interval_coverage --runs {runs} -o benchmarks/results/coverage.md

{runs} simulated calibrations of each machine under each condition ({minutes:.0f} minutes on one core of a busy
machine). Every one has a machine of its own, drawn from the tolerances, and noise of its own; {rows} poses, but 12
where rows are few and 15 where they are repeated. The columns are the share of true values inside estimate +- 1.96 std: over
all parameters that the readings determine (std below half the tolerance), and the lowest and highest share of any one; then
the share of readings at 100 other poses inside 1.96 of what `predict` says and the stated sigma, and the rms of
these pulls. 95 % is right; the share of one parameter is known to {error:.1f} points (1 sigma).
Gross rows are 10 to 100 sigmas off.

{table}

The covariance follows the noise that the residuals show, for each sensor and kind of reading
(`identification/fit/noise.py`). Where sigma is stated too large, intervals of parameters are right all the same; held-out
readings lie inside too often, because the sensor's noise, as the file states it, is part of their spread. Tolerances are
taken as stated: a parameter that the readings do not determine is as uncertain as its tolerance, and its interval is
right only if that is.
"""


@dataclass(frozen=True)
class Condition:
    """Noise in stated sigmas (that of rotations ``turns`` times as much), share of gross rows, loss, how often each
    pose is measured, and whether rows that the loss gives up are set aside for a plain fit."""

    title: str
    rows: int = 40
    noise: float = 1.0
    turns: float = 1.0
    gross: float = 0.0
    loss: str = "gauss"
    repeats: int = 1
    set_aside: bool = False


CONDITIONS = (
    Condition("sigma as stated"),
    Condition("the same, few rows", rows=12),
    Condition("sigma stated 1.5 times too small", noise=1.5),
    Condition("sigma stated 1.5 times too large", noise=1 / 1.5),
    Condition("sigma stated 4 times too small", noise=4.0),
    Condition("positions 3 times noisier than stated, rotations as stated", noise=3.0, turns=1 / 3),
    Condition("sigma from repeated poses", rows=15, noise=1.5, repeats=3),
    Condition("robust loss, no gross row", loss="huber"),
    Condition("robust loss, 5 % gross rows", gross=GROSS, loss="huber"),
    Condition("the same, sigma 1.5 times too small", noise=1.5, gross=GROSS, loss="huber"),
    Condition("5 % gross rows, set aside", gross=GROSS, loss="huber", set_aside=True),
)


@dataclass(frozen=True)
class Covered:
    """Shares inside 95 %: of each parameter (k,) that the readings determine; of readings that were held out, and rms z."""

    parameters: Array
    held_out: float
    z: float


@dataclass(frozen=True)
class Bench:
    """A machine, and poses of it."""

    machine: Machine
    q: Array

    @classmethod
    def of(cls, name: str, rows: int, folder: Path) -> Bench:
        path = folder / "machine.yaml"
        path.write_text(HEAD.format(name="small") + FRAMES + MACHINES[name], encoding="utf-8")
        machine = load_machine(path)
        ranges = np.array([a.range for a in machine.mechanism.actuators], dtype=float)
        return cls(
            machine, np.random.default_rng(rows).uniform(ranges[:, 0], ranges[:, 1], (rows, len(ranges)))
        )

    def recording(self, values: Array) -> Recording:
        """Readings (n, k) at the poses, which are gone through again where there are more readings."""
        n = len(values)
        none = np.zeros(n, dtype=np.int64)
        columns = [name for sensor in self.machine.sensors for name in sensor.columns]
        return Recording(
            joints=self.machine.mechanism.readings,
            q=np.resize(self.q, (n, self.q.shape[1])),
            observations=dict(zip(columns, values.T, strict=True)),
            labels={},
            drivers={},
            files=("simulated",),
            source_file=none,
            source_row=np.arange(1, n + 1),
            session=none + 1,
            session_recorded=none == 0,
            validation=none > 0,
        )

    def predictor(self, machine: Machine, rows: int) -> Predictor:
        columns = sum(len(sensor.columns) for sensor in machine.sensors)
        return Predictor(machine, self.recording(np.zeros((rows, columns))))

    def truth(self, rng: np.random.Generator) -> Array:
        """(np,) constants of a machine as built."""
        return np.array([p.nominal + p.tolerance * rng.standard_normal() for p in self.machine.parameters])


def covered(name: str, condition: Condition, runs: int, folder: Path) -> Covered:
    """What ``runs`` calibrations under a condition cover."""
    bench, elsewhere = Bench.of(name, condition.rows, folder), Bench.of(name, 100, folder)
    fitted = bench.predictor(bench.machine, condition.rows * condition.repeats)
    held_out = elsewhere.predictor(bench.machine, 100)
    inside, sure, z = [], [], []
    for run in range(runs):
        rng = np.random.default_rng((run, condition.rows))
        p = bench.truth(rng)
        fit = _calibrated(bench, fitted, p, condition, rng)
        free = fit.prior.free
        inside.append(np.abs((fit.p - p)[free]) < LEVEL * fit.std[free])
        sure.append(fit.std[free] < DETERMINED * fit.prior.sigma[free])
        z.append(
            _pulls(elsewhere, held_out, fit, p, _noisy(bench.machine, _values(held_out, p), condition, rng))
        )
    known = np.mean(sure, axis=0) > 0.5
    pulls = np.concatenate(z)
    return Covered(
        np.mean(inside, axis=0)[known],
        float(np.mean(np.abs(pulls) < LEVEL)),
        float(np.sqrt(np.mean(pulls**2))),
    )


def _calibrated(
    bench: Bench, fitted: Predictor, p: Array, condition: Condition, rng: np.random.Generator
) -> Estimate:
    """One calibration of the machine of constants p (np,)."""
    exact = _values(fitted, p)
    readings = _noisy(bench.machine, exact, condition, rng)
    wild = rng.random(len(readings)) < condition.gross
    far = rng.uniform(*FAR, readings.shape) * rng.choice([-1.0, 1.0], readings.shape)
    readings[wild] += (far * _sigma(bench.machine))[wild]
    machine, predictor = bench.machine, fitted
    if condition.repeats > 1:
        repeated = _from_repeats(readings, condition, machine)
        machine = replace(machine, sensors=tuple(_with_noise(s, repeated) for s in machine.sensors))
        predictor = bench.predictor(machine, len(readings))
    predictor.recording = bench.recording(readings)
    fit = estimate(machine, predictor.recording, loss=condition.loss, predictor=predictor)
    if not condition.set_aside:
        return fit
    return estimate(machine, predictor.recording, exclude=fit.weights < GIVEN_UP, predictor=predictor)


def _pulls(bench: Bench, predictor: Predictor, fit: Estimate, p: Array, readings: Array) -> Array:
    """(n * k,) readings elsewhere less their prediction, in the 1-sigma of the prediction and the sigma that is stated."""
    predictor.recording = bench.recording(readings)
    x, _ = predictor.assemble(fit.p)
    (block,) = predictor.blocks(fit.p, x)
    sigma, stated = _sigma(bench.machine), _sigma(fit.nominal)
    known, free = covariance_of(fit), fit.prior.free
    std = sigma * known.std(block.jacobian[..., free], fit.prior.scale[free])
    kinds = [channel.kind for channel in fit.nominal.channels]
    own = np.array([known.unexplained.get(f"sensor.{kind}", (0.0, ""))[0] for kind in kinds])
    return np.asarray(sigma * block.residual / np.sqrt(std**2 + own**2 + stated**2)).ravel()


def _values(predictor: Predictor, p: Array) -> Array:
    x, _ = predictor.assemble(p)
    return predictor.columns(p, x)[1]


def _sigma(machine: Machine) -> Array:
    """(k,) stated 1-sigma of the columns, which are the channels here."""
    return np.array([channel.sigma for channel in machine.channels])


def _noisy(machine: Machine, values: Array, condition: Condition, rng: np.random.Generator) -> Array:
    (sensor,) = machine.sensors
    noisier = _with_noise(sensor, condition.noise, condition.turns)
    return noisier.noisy(values, rng)


def _from_repeats(readings: Array, condition: Condition, machine: Machine) -> float:
    """Noise in stated sigmas, pooled over the poses that were measured several times."""
    again = readings.reshape(condition.repeats, condition.rows, -1) / _sigma(machine)
    return float(np.sqrt(np.mean(np.var(again, axis=0, ddof=1))))


def _with_noise(sensor: Any, factor: float, turns: float = 1.0) -> Sensor:
    """The sensor with ``factor`` times the sigma, that of rotations times ``turns`` besides."""
    names = [f.name for f in fields(sensor) if f.name.startswith("sigma")]
    factors = {name: factor * (turns if name.endswith("rot") else 1.0) for name in names}
    return cast(Sensor, replace(sensor, **{name: f * getattr(sensor, name) for name, f in factors.items()}))


def table(runs: int, tell: Callable[[str], None]) -> str:
    """Markdown: machine and condition, parameters' coverage (mean, lowest, highest), held-out readings'."""
    head = "| machine | condition | parameters | lowest | highest | held-out readings | rms z |"
    lines = [head, "|---|---|---|---|---|---|---|"]
    tell("\n".join(lines))
    with TemporaryDirectory() as folder:
        for name, text in MACHINES.items():
            for condition in CONDITIONS:
                if condition.turns != 1.0 and "rot:" not in text:
                    continue
                found = covered(name, condition, runs, Path(folder))
                share = found.parameters
                numbers = [
                    f"{100 * v:.1f} %" for v in (share.mean(), share.min(), share.max(), found.held_out)
                ]
                lines.append(f"| {name} | {condition.title} | {' | '.join(numbers)} | {found.z:.2f} |")
                tell(lines[-1])
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("-o", "--output", type=Path)
    asked = parser.parse_args()
    began = time.perf_counter()
    text = table(asked.runs, print)
    if asked.output is not None:
        took = time.perf_counter() - began
        atomic_write_text(
            asked.output,
            PAGE.format(
                runs=asked.runs,
                table=text,
                minutes=took / 60,
                rows=Condition.rows,
                error=100 * np.sqrt(0.95 * 0.05 / asked.runs),
            ),
        )


if __name__ == "__main__":
    main()
