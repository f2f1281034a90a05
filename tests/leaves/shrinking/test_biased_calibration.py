"""Biased estimators on a machine: ridge as tolerances, limits, uncertainty, files and the command."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from support.command import input_error, run
from support.machine_texts import machine_from
from truepose.arrays import Array, Mask
from truepose.errors import ConvergenceError
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.relinearised import LinearEstimate, Spectrum, decompose
from truepose.identification.fit.write_machine import covariance_of
from truepose.identification.leaves.shrinking.estimating import liu, pcr, ridge
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

TUNED: Mapping[str, Callable[[Spectrum], LinearEstimate]] = {"liu": liu, "ridge": ridge, "pcr": pcr}
FREE = ("q1.beta", "q1.alpha", "q1.d", "q2.d", "q2.theta", "q2.beta", "q3.d", "q3.alpha", "q3.r", "tool.z")
CHAIN = f"""
schema: truepose/machine/1
name: chain
mechanism:
  type: serial
  joints:
    - {{name: q1, kind: revolute, r: 100, range: [-90, 90]}}
    - {{name: q2, kind: revolute, alpha: 90, d: 50, range: [-60, 60]}}
    - {{name: q3, kind: prismatic, alpha: 90, r: 200, range: [-50, 50]}}
frames: {{tool: {{in: flange, xyz: [5, 0, 60]}}}}
tolerances: {{length: 0, angle: 0, {", ".join(f"{name}: 0.3" for name in FREE)}}}
sensor: {{type: position, sigma: {{xyz: 0.02}}}}
"""
"""Ten free parameters, two of which (q3.r and tool.z) do the same."""


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return machine_from(tmp_path_factory.mktemp("chain"), CHAIN, "chain")


def recorded(
    machine: Machine, rng: np.random.Generator, path: Path, truth: Array, noise: float = 1.0
) -> Recording:
    """A recording of the machine ``truth`` at poses that never change, noise from ``rng``."""
    ranges = np.array([a.range for a in machine.mechanism.actuators], dtype=float)
    q = np.random.default_rng(5).uniform(ranges[:, 0], ranges[:, 1], (25, len(ranges)))
    units = [1.0 if a.unit == "mm" else 180 / np.pi for a in machine.mechanism.actuators]
    np.savetxt(path, q * units, delimiter=",", header=",".join(machine.mechanism.readings), comments="")
    predictor = Predictor(machine, load_recording(machine, [path], need_observations=False))
    names, values, _, _ = predictor.columns(truth, predictor.assemble(truth)[0])
    read = values + noise * (machine.sensors[0].noisy(values, rng) - values)
    header = ",".join([*machine.mechanism.readings, *names])
    np.savetxt(path, np.hstack([q * units, read]), delimiter=",", header=header, comments="", fmt="%.17g")
    return load_recording(machine, [path])


def built(machine: Machine, rng: np.random.Generator) -> Array:
    return np.array([p.nominal + p.tolerance * rng.standard_normal() for p in machine.parameters])


def determined(fit: Estimate) -> Mask:
    """(np,) which parameters no unknown direction moves."""
    out = np.zeros(len(fit.p), dtype=bool)
    out[fit.prior.free] = ~np.any(fit.known.unknown != 0.0, axis=0)
    return out


@pytest.fixture
def recording(chain: Machine, rng: np.random.Generator, tmp_path: Path) -> Recording:
    return recorded(chain, rng, tmp_path / "r.csv", built(chain, rng))


def test_ridge_in_tolerances_is_the_fit_under_tolerances(chain: Machine, recording: Recording) -> None:
    """With k = 1 its cost is theirs; its variance is smaller, as tolerances are no noise to it."""
    held = calibrate(chain, recording).fit
    shrunk = calibrate(chain, recording, estimator="ridge", tuning=1.0).fit
    free, tolerance = held.prior.free, held.prior.sigma[held.prior.free]
    # both ends are at rest to 1e-7 of a 1-sigma
    assert np.max(np.abs(shrunk.p - held.p)[free] / tolerance) < 1e-7
    seen = determined(shrunk)[free]
    assert np.all(shrunk.std[free][seen] <= held.std[free][seen] * (1 + 1e-9))
    assert shrunk.effective_parameters == pytest.approx(held.effective_parameters, rel=1e-7)
    assert shrunk.chi2_per_dof == pytest.approx(held.chi2_per_dof, rel=1e-7)


@pytest.mark.parametrize(("name", "tuning"), [("liu", 1.0), ("ridge", 0.0), ("pcr", 99)])
def test_their_limit_on_a_machine_is_least_squares(
    chain: Machine, recording: Recording, name: str, tuning: float
) -> None:
    plain = calibrate(chain, recording, estimator="ols").fit
    limit = calibrate(chain, recording, estimator=name, tuning=tuning).fit
    np.testing.assert_allclose(limit.p, plain.p, atol=1e-9)
    seen = determined(plain)
    np.testing.assert_array_equal(determined(limit), seen)
    np.testing.assert_allclose(limit.std[seen], plain.std[seen], rtol=1e-6)
    assert np.all(limit.std[plain.prior.free][~seen[plain.prior.free]] > 1e6)  # unknown, not small


@pytest.mark.parametrize("name", ["liu", "ridge", "pcr"])
def test_the_estimate_is_what_its_own_linearisation_gives(
    chain: Machine, recording: Recording, name: str
) -> None:
    """Built here from the Jacobian at the estimate, in parameters from the drawing."""
    result = calibrate(chain, recording, estimator=name)
    fit = result.fit
    free = fit.prior.free
    predictor = Predictor(chain, recording)
    (block,) = predictor.blocks(fit.p, fit.x)
    j = block.jacobian[:, :, free].reshape(-1, len(free))
    drawing = np.array([p.nominal for p in chain.parameters])[free]
    tolerance = np.array([p.tolerance for p in chain.parameters])[free]
    y = j @ (fit.p[free] - drawing) - block.residual.ravel()
    again = TUNED[name](decompose(j, y, tolerance))
    np.testing.assert_allclose(drawing + again.b, fit.p[free], atol=1e-7 * tolerance.max())
    key = {"liu": "d", "ridge": "k", "pcr": "components"}[name]
    assert float(result.method[key]) == pytest.approx(float(again.tuning), rel=1e-4)


@pytest.mark.parametrize("name", ["liu", "pcr"])
def test_the_std_is_what_sampling_shows(
    chain: Machine, rng: np.random.Generator, tmp_path: Path, name: str
) -> None:
    """Thirty recordings of one machine, tuning fixed; unseen directions apart."""
    truth = built(chain, np.random.default_rng(3))
    tuning = {"liu": 0.5, "pcr": 8}[name]
    fits = [
        calibrate(chain, recorded(chain, rng, tmp_path / "r.csv", truth), estimator=name, tuning=tuning).fit
        for _ in range(30)
    ]
    seen = determined(fits[0])
    assert seen.sum() >= 5
    ratio = np.std([fit.p[seen] for fit in fits], axis=0, ddof=1) / fits[0].std[seen]
    # a deviation from 30 samples is known to 13 %; the worst of eight within 4 sigma
    assert np.all(np.abs(ratio - 1) < 0.52), ratio
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.15)


def test_the_machine_file_carries_the_estimators_own_covariance(chain: Machine, recording: Recording) -> None:
    fit = calibrate(chain, recording, estimator="liu", tuning=0.5).fit
    written = covariance_of(fit)
    known = determined(fit)[fit.prior.free]
    std = fit.std[fit.prior.free][known]
    np.testing.assert_allclose(np.linalg.norm(written.factor, axis=1)[known], std, rtol=1e-9)
    assert len(written.unknown) == len(fit.null_space)


def test_an_unknown_base_is_not_pulled_anywhere(tmp_path: Path) -> None:
    """Parameters without a tolerance follow by least squares: wherever the base stands, the arm is the same."""
    text = CHAIN.replace("frames: {", "frames: {base: {xyz: [0, 0, 0], tolerance: {xyz: .inf, rpy: 0}}, ")
    machine = machine_from(tmp_path, text, "open")
    truth = np.array([p.nominal for p in machine.parameters])
    names = [p.name for p in machine.parameters]
    truth[names.index("q2.d")] += 0.5
    fits = []
    for shift in (0.0, 1000.0):
        truth[names.index("base.x")] = shift
        seen = recorded(machine, np.random.default_rng(1), tmp_path / "r.csv", truth)
        fits.append(calibrate(machine, seen, estimator="liu").fit)
    arm = [k for k, name in enumerate(names) if not name.startswith("base")]
    np.testing.assert_allclose(fits[1].p[arm], fits[0].p[arm], atol=1e-8)
    assert fits[1].p[names.index("base.x")] == pytest.approx(1000.0, abs=0.5)


def test_an_iteration_that_does_not_rest_names_what_moves(
    chain: Machine, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("truepose.identification.fit.relinearised.LIMIT", 1)
    with pytest.raises(ConvergenceError, match=r"iteration limit.*1 iterations.*responsible: "):
        calibrate(chain, recording, estimator="liu", tuning=0.5)


def test_bounds_and_biased_estimators_do_not_go_together(chain: Machine, recording: Recording) -> None:
    with input_error(r"--solver: found 'ipopt' with --estimator ridge.*expected gn or lm"):
        calibrate(chain, recording, estimator="ridge", solver="ipopt")


@pytest.mark.parametrize(("name", "key"), [("liu", "d"), ("ridge", "k"), ("pcr", "components")])
def test_the_command_says_what_tuned_the_estimate(
    chain: Machine, recording: Recording, tmp_path: Path, name: str, key: str
) -> None:
    assert chain.file is not None
    arguments = [chain.file.path, recording.files[0], "-o", tmp_path / "out", "--estimator", name]
    result = run("calibrate", *arguments)
    assert "its bias towards the drawing is not in it" in result.stderr
    method = json.loads((tmp_path / "out/fit.json").read_text())["method"]
    assert method["estimator"] == name and float(method[key]) >= 0.0
    again = load_machine(tmp_path / "out/calibrated.yaml")
    assert again.file is not None and again.file.covariance is not None
