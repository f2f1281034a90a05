"""What an estimate owes its data and its tolerances, on simulated recordings."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from support.built_machines import TEXTS, Machines, departures, manufactured, nominal, simulated
from support.moving_machines import record, written
from support.telescope_legs import ENDS, leg_rows
from truepose.identification.fit.estimate import FREE_TOLERANCE, estimate
from truepose.identification.fit.problem import prior_of
from truepose.identification.fit.summary import worst_allowed
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.sensors.pose import Pose


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("name", TEXTS)
def test_the_truth_lies_within_the_posterior(machines: Machines, name: str, seed: int) -> None:
    machine, rng = machines[name], np.random.default_rng(seed)
    truth = manufactured(machine, rng)
    fit = estimate(machine, simulated(machine, truth, rng))
    off = departures(fit, truth)
    assert np.abs(off).max() < 4.5
    assert 0.5 < np.mean(off**2) < 2.0
    assert fit.chi2_per_dof == pytest.approx(1.0, abs=0.25)
    assert np.all(fit.std <= fit.prior.sigma * (1 + 1e-9))


@pytest.mark.parametrize("name", TEXTS)
def test_the_order_of_rows_does_not_matter(machines: Machines, name: str) -> None:
    machine, rng = machines[name], np.random.default_rng(3)
    recording = simulated(machine, manufactured(machine, rng), rng)
    one, other = (
        estimate(machine, r) for r in (recording, recording.subset(rng.permutation(len(recording))))
    )
    assert other.chi2 == pytest.approx(one.chi2, rel=1e-9)
    assert np.abs(departures(other, one.p)).max() < 1e-3
    np.testing.assert_allclose(other.std, one.std, rtol=1e-6)


@pytest.mark.parametrize("name", TEXTS)
def test_rows_that_say_nothing_new_shrink_the_std_only(machines: Machines, name: str) -> None:
    """Every row four times is every row once with half the sigma, where sigmas are taken at their word."""
    machine, rng = machines[name], np.random.default_rng(4)
    recording = simulated(machine, manufactured(machine, rng), rng)
    (sensor,) = machine.sensors
    assert isinstance(sensor, Pose)
    finer = Pose(0.5 * sensor.sigma_xyz, 0.5 * sensor.sigma_rot)
    fourfold = estimate(machine, recording.subset(np.tile(np.arange(len(recording)), 4)))
    sharp = estimate(replace(machine, sensors=(finer,)), recording)
    np.testing.assert_allclose(np.diag(fourfold.posterior), np.diag(sharp.posterior), rtol=2e-5)
    assert np.abs(departures(fourfold, sharp.p)).max() < 1e-3


@pytest.mark.parametrize("unit", ["um", "m", "inch"])
def test_the_unit_of_the_file_does_not_matter(tmp_path: Path, unit: str) -> None:
    factor = {"um": 1e3, "m": 1e-3, "inch": 1 / 25.4}[unit]

    def text(k: float) -> str:
        ends = [(_times(a, k), _times(b, k)) for a, b in ENDS]
        legs = leg_rows(f"length: {500 * k}", ends)
        return (
            f"tolerances: {{length: {0.2 * k}, angle: 0.1}}\nframes:\n"
            f"  base: {{xyz: {[5 * k, 6 * k, 7 * k]}, rpy: [1, 2, 3], tolerance: {{xyz: {k}, rpy: 1}}}}\n"
            f"mechanism:\n  type: 6-pus\n  home: {[0, 0, 440 * k, 0, 0, 0]}\n  legs:\n{legs}"
            f"sensor: {{type: position, sigma: {{xyz: {0.01 * k}}}}}\n"
        )

    plain = written(tmp_path, text(1.0))
    other = written(tmp_path, f"units: {{length: {unit}}}\n" + text(factor), "other")
    rng = np.random.default_rng(5)
    q = rng.uniform(-50, 50, (30, 6))
    truth = manufactured(plain, rng)
    predictor = Predictor(plain, record(plain, q))
    _, values, _, _ = predictor.columns(truth, predictor.assemble(truth)[0])
    rows = np.hstack([q, plain.sensors[0].noisy(values, rng)])
    header = ",".join([*plain.mechanism.readings, "x", "y", "z"])
    fits = []
    for machine, k in ((plain, 1.0), (other, factor)):
        path = tmp_path / f"{machine.name}.csv"
        np.savetxt(path, rows * k, delimiter=",", header=header, comments="", fmt="%.17g")
        fits.append(estimate(machine, load_recording(machine, [path])))
    assert fits[1].chi2 == pytest.approx(fits[0].chi2, rel=1e-7)
    np.testing.assert_allclose(fits[1].std, fits[0].std, rtol=1e-6)
    assert np.abs(departures(fits[1], fits[0].p)).max() < 1e-3


def _times(vector: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    x, y, z = vector
    return factor * x, factor * y, factor * z


@pytest.mark.parametrize("name", TEXTS)
def test_freedom_fits_better_and_strays_further(machines: Machines, name: str) -> None:
    machine, rng = machines[name], np.random.default_rng(7)
    recording = simulated(machine, manufactured(machine, rng), rng)
    fits = [estimate(machine, recording, widen=factor) for factor in (1.0, 10.0, 100.0)]
    stated = prior_of(machine).sigma
    for tight, loose in pairwise(fits):
        # the free fit stops when half the sum of squares has less than that share of the readings to gain
        assert loose.chi2 <= tight.chi2 + 2 * FREE_TOLERANCE * loose.n_observations
        assert loose.effective_parameters >= tight.effective_parameters
        # only an independent set of tolerances is widened, a larger one where more of it shows
        assert np.sum(loose.prior.sigma > stated) >= np.sum(tight.prior.sigma > stated)
    assert np.any(fits[1].prior.sigma > stated)


@pytest.mark.parametrize("name", TEXTS)
def test_the_worst_departure_allowed_is_that_of_machines_as_made(machines: Machines, name: str) -> None:
    """Against machines drawn from the tolerances, measured with noise and estimated."""
    machine, rng = machines[name], np.random.default_rng(17)
    fit = estimate(machine, simulated(machine, nominal(machine), rng, 25))
    n = len(fit.prior.free)
    r, tolerance = fit.factor[:n, :n], fit.prior.sigma[fit.prior.free] / fit.prior.scale[fit.prior.free]
    made = tolerance[:, None] * rng.standard_normal((n, 4000))
    seen = r.T @ (r @ made + rng.standard_normal(made.shape))
    found = np.linalg.solve(r.T @ r + np.diag(tolerance**-2.0), seen)
    worst = np.max(np.abs(found) / tolerance[:, None], axis=0)
    assert worst_allowed(fit) == pytest.approx(float(np.quantile(worst, 0.99)), rel=0.05)
