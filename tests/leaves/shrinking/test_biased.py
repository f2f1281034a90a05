"""Biased estimators by their formulas and on a machine: limits, estimated errors, sampling, files, the command."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
import sympy as sp  # type: ignore[import-untyped]
from scipy.optimize import minimize_scalar

from support.command import input_error, run
from support.machine_texts import machine_from
from truepose.arrays import Array, Mask
from truepose.errors import ConvergenceError
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.relinearised import LinearEstimate, Spectrum, decompose, ols
from truepose.identification.fit.write_machine import covariance_of
from truepose.identification.leaves.shrinking.estimating import Rule, liu, liu_parameter, pcr, ridge
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

ESTIMATORS: Mapping[str, Callable[[Spectrum], LinearEstimate]] = MappingProxyType(
    {"ols": ols, "liu": liu, "ridge": ridge, "pcr": pcr}
)
FIXED: Mapping[str, Callable[[Spectrum], LinearEstimate]] = MappingProxyType(
    {
        "ols": ols,
        "liu": lambda problem: liu(problem, 0.4),
        "ridge": lambda problem: ridge(problem, 0.03),
        "pcr": lambda problem: pcr(problem, 4),
    }
)
NOISE = 0.1


def collinear(rng: np.random.Generator, n: int = 40, m: int = 6) -> Array:
    """A design (n, m) whose singular values span three decades."""
    left, right = np.linalg.qr(rng.standard_normal((n, m)))[0], np.linalg.qr(rng.standard_normal((m, m)))[0]
    out: Array = left @ np.diag(np.logspace(1, -2, m)) @ right
    return out


def drawn(rng: np.random.Generator, noise: float = NOISE) -> tuple[Array, Array]:
    """Return a design and what is read of it."""
    h = collinear(rng)
    return h, h @ rng.standard_normal(6) + noise * rng.standard_normal(40)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


# -- definitions ---------------------------------------------------------------------------------------


def test_each_estimator_is_its_formula(rng: np.random.Generator) -> None:
    h, y = drawn(rng)
    problem, square, eye = decompose(h, y), h.T @ h, np.eye(6)
    plain = np.linalg.lstsq(h, y, rcond=None)[0]
    close = partial(np.testing.assert_allclose, rtol=1e-8, atol=1e-10)  # normal equations square 1e3
    close(ols(problem).b, plain)
    close(liu(problem, 0.3).b, np.linalg.solve(square + eye, h.T @ y + 0.3 * plain))
    close(ridge(problem, 0.2).b, np.linalg.solve(square + 0.2 * eye, h.T @ y))
    leading = np.linalg.svd(h)[2][:3].T
    shares = np.linalg.lstsq(h @ leading, y, rcond=None)[0]
    close(pcr(problem, 3).b, leading @ shares)


def test_their_limits_are_least_squares_and_each_other(rng: np.random.Generator) -> None:
    problem = decompose(*drawn(rng))
    for limit in (liu(problem, 1.0), ridge(problem, 0.0), pcr(problem, 6)):
        np.testing.assert_allclose(limit.b, ols(problem).b, rtol=1e-12)
    np.testing.assert_allclose(liu(problem, 0.0).b, ridge(problem, 1.0).b, rtol=1e-12)


def test_what_no_reading_sees_stays_at_zero(rng: np.random.Generator) -> None:
    h = collinear(rng) @ np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.0])
    h[:, 4] = h[:, 3]
    problem = decompose(h, rng.standard_normal(40))
    assert len(problem.values) == 4
    for estimator in ESTIMATORS.values():
        found = estimator(problem)
        assert found.b[5] == pytest.approx(0.0, abs=1e-12)
        assert found.b[3] == pytest.approx(found.b[4], rel=1e-9)  # the shortest of all that fit


@pytest.mark.parametrize("name", ESTIMATORS)
def test_many_right_hand_sides_are_each_of_them(rng: np.random.Generator, name: str) -> None:
    h, estimator = collinear(rng), ESTIMATORS[name]
    y = (h @ rng.standard_normal(6))[:, None] + NOISE * rng.standard_normal((40, 7))
    together = estimator(decompose(h, y))
    for k in range(7):
        alone = estimator(decompose(h, y[:, k]))
        np.testing.assert_allclose(together.b[:, k], alone.b, rtol=1e-9)
        assert together.tuning[k] == pytest.approx(float(alone.tuning), rel=1e-9)
        assert together.spectrum.noise[k] == pytest.approx(float(alone.spectrum.noise), rel=1e-9)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_triangular_factor_is_as_good_as_its_rows(rng: np.random.Generator, name: str) -> None:
    h, y = drawn(rng)
    r = np.asarray(np.linalg.qr(np.column_stack([h, y]), mode="r"))
    rows, factor = decompose(h, y), decompose(r[:, :6], r[:, 6], n_observations=40)
    np.testing.assert_allclose(ESTIMATORS[name](factor).b, ESTIMATORS[name](rows).b, rtol=1e-8)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_columns_of_length_one_forget_their_units(rng: np.random.Generator, name: str) -> None:
    h, units = collinear(rng), np.array([1e-3, 1.0, 1e3, 57.3, 25.4, 1.0])
    y = h @ rng.standard_normal(6) + NOISE * rng.standard_normal(40)
    here, there = (
        ESTIMATORS[name](decompose(h * k, y, 1.0 / np.linalg.norm(h * k, axis=0))).b * k
        for k in (np.ones(6), units)
    )
    np.testing.assert_allclose(there, here, rtol=1e-9)


def test_a_problem_counted_from_elsewhere_is_the_same_problem(rng: np.random.Generator) -> None:
    h, away = collinear(rng), 100.0 * rng.standard_normal(6)
    y = h @ rng.standard_normal(6) + NOISE * rng.standard_normal(40)
    whole, moved = decompose(h, y + h @ away), decompose(h, y).counted_from(away)
    np.testing.assert_allclose(moved.alpha, whole.alpha, rtol=1e-9)
    np.testing.assert_allclose(ridge(moved, 0.1).b, ridge(whole, 0.1).b, rtol=1e-9)


def test_no_reading_left_over_is_refused(rng: np.random.Generator) -> None:
    with input_error("found 6 readings for 6 combinations"):
        decompose(rng.standard_normal((6, 6)), rng.standard_normal(6))


# -- the error and what tunes it -----------------------------------------------------------------------


def error(problem: Spectrum, d: float, square: Array) -> float:
    """Equation 13."""
    lam = problem.values**2
    noise = float(problem.noise)
    own = noise * (lam + d) ** 2 / (lam * (lam + 1) ** 2) + (d - 1) ** 2 * square / (lam + 1) ** 2
    return float(np.sum(own))


@pytest.mark.parametrize("rule", ["plug-in", "unbiased"])
def test_the_parameter_is_where_the_estimated_error_is_least(rng: np.random.Generator, rule: Rule) -> None:
    problem = decompose(*drawn(rng))
    square = problem.alpha**2 - (problem.noise / problem.values**2 if rule == "unbiased" else 0.0)
    best = minimize_scalar(
        lambda d: error(problem, d, square), bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-10}
    )
    # a parabola's minimum is found to the root of its rounding
    assert float(liu_parameter(problem, rule)) == pytest.approx(float(best.x), abs=1e-5)


@pytest.mark.parametrize("name", FIXED)
def test_the_covariance_is_what_sampling_shows(rng: np.random.Generator, name: str) -> None:
    """The estimator's variance with its tuning fixed; bias is not in it, and is there."""
    h, b, runs = collinear(rng), rng.standard_normal(6), 20000
    y = (h @ b)[:, None] + NOISE * rng.standard_normal((40, runs))
    found = FIXED[name](decompose(h, y)).b
    said = FIXED[name](decompose(h, y[:, 0])).covariance(NOISE**2)
    scale = np.sqrt(np.outer(np.diag(said), np.diag(said)))
    # a covariance of n samples is known to root(2 / n) = 1 % of its scale
    np.testing.assert_allclose(np.cov(found) / scale, said / scale, atol=0.05)
    bias = np.linalg.norm(found.mean(axis=1) - b)
    assert bool(bias > 0.05) == (name != "ols")


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


@pytest.mark.parametrize("name", ["liu", "ridge", "pcr"])
def test_near_dependence_pays_for_bias(rng: np.random.Generator, name: str) -> None:
    """Where least squares blows up, each of them varies less and errs less, by its own rule."""
    h, b = collinear(rng), np.array([0.3, -0.2, 0.1, 0.4, -0.1, 0.2])
    y = (h @ b)[:, None] + NOISE * rng.standard_normal((40, 5000))
    problem = decompose(h, y)
    biased, plain = ESTIMATORS[name](problem).b, ols(problem).b
    assert np.sum(np.var(biased, axis=1)) < 0.8 * np.sum(np.var(plain, axis=1))
    assert np.mean((biased.T - b) ** 2) < 0.8 * np.mean((plain.T - b) ** 2)


def test_ridge_follows_hoerl_kennard_and_baldwin(rng: np.random.Generator) -> None:
    h = collinear(rng)
    problem = decompose(h, h @ rng.standard_normal(6) + NOISE * rng.standard_normal(40))
    plain = ols(problem).b
    assert float(ridge(problem).tuning) == pytest.approx(6 * float(problem.noise) / float(plain @ plain))


def test_the_error_formula_is_what_sampling_shows(rng: np.random.Generator) -> None:
    h, b, d, runs = collinear(rng), rng.standard_normal(6), 0.4, 20000
    y = (h @ b)[:, None] + NOISE * rng.standard_normal((40, runs))
    seen = np.mean(np.sum((liu(decompose(h, y), d).b.T - b) ** 2, axis=1))
    _, s, directions = np.linalg.svd(h, full_matrices=False)
    truth = Spectrum(s, directions.T, np.ones(6), directions @ b, np.array(NOISE**2))
    # squares of one leading coordinate: relative error of their mean is root(2 / runs) = 1 %
    assert seen == pytest.approx(error(truth, d, truth.alpha**2), rel=0.04)


def test_the_papers_parameter_minimises_the_papers_error() -> None:
    """Equation 14 is right: derived from equation 13 for two coordinates."""
    d, variance = sp.symbols("d s2", positive=True)
    lam, a = sp.symbols("l1:3", positive=True), sp.symbols("a1:3", real=True)
    error = sum(
        variance * (k + d) ** 2 / (k * (k + 1) ** 2) + (d - 1) ** 2 * b**2 / (k + 1) ** 2
        for k, b in zip(lam, a, strict=True)
    )
    (best,) = sp.solve(sp.diff(error, d), d)
    above = sum((b**2 - variance) / (k + 1) ** 2 for k, b in zip(lam, a, strict=True))
    below = sum((variance + k * b**2) / (k * (k + 1) ** 2) for k, b in zip(lam, a, strict=True))
    assert sp.simplify(best - above / below) == 0
    # with the unbiased estimate of each square it becomes Liu's own
    seen = sp.symbols("b1:3", real=True)
    unbiased = best.subs({b: sp.sqrt(c**2 - variance / k) for k, b, c in zip(lam, a, seen, strict=True)})
    own = 1 - variance * sum(1 / (k * (k + 1)) for k in lam) / sum(
        c**2 / (k + 1) ** 2 for k, c in zip(lam, seen, strict=True)
    )
    assert sp.simplify(unbiased - own) == 0


def test_the_number_of_components_has_the_least_estimated_error(rng: np.random.Generator) -> None:
    h = collinear(rng)
    problem = decompose(h, h @ rng.standard_normal(6) + 3 * NOISE * rng.standard_normal(40))
    spread, square = problem.noise / problem.values**2, problem.alpha**2
    errors = [np.sum(spread[:k]) + np.sum((square - spread)[k:]) for k in range(7)]
    assert int(pcr(problem).tuning) == int(np.argmin(errors))
