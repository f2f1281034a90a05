"""Every solver on every machine: one estimate, exact derivatives, outcomes that are told, bounds that hold or are refused."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from support import ROOT
from support.built_machines import FRAMES, POSE, manufactured, nominal
from support.command import input_error
from support.moving_machines import record, written
from support.solvers import ARM, GRAPHS, MACHINES, MADE, SAME, apart, bounded, hexapod, simulated
from truepose.arrays import Array
from truepose.errors import ConvergenceError
from truepose.identification.fit.bounds import Bounds, bounds_of
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.problem import Prior, Problem, prior_of
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.leaves.ipopt.solving import OPTIONS, Program
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine


def built(machines: Mapping[str, Machine], name: str, seed: int, **more: int) -> tuple[Machine, Recording]:
    """Return a machine, and a recording of it as it was made."""
    machine, rng = machines[name], np.random.default_rng(seed)
    return machine, simulated(machine, manufactured(machine, rng), rng, **more)


# ------------------------------------------------------------------------------------ one minimum


@pytest.mark.parametrize("name", [*MACHINES, *GRAPHS])
def test_all_solvers_find_one_minimum(machines: Mapping[str, Machine], name: str) -> None:
    machine, recording = built(machines, name, 1)
    gn, lm = (estimate(machine, recording, damping=damping, tolerance=1e-13) for damping in (0.0, 1e-4))
    ipopt = bounded(machine, recording)
    assert gn.chi2_per_dof == pytest.approx(1.0, abs=0.4)
    assert apart(lm, gn) < SAME
    assert apart(ipopt, gn) < SAME
    np.testing.assert_allclose(ipopt.std, gn.std, rtol=1e-5)
    np.testing.assert_allclose(ipopt.x, gn.x, atol=1e-5)
    assert type(ipopt) is type(gn) and ipopt.factor.shape == gn.factor.shape
    assert ipopt.solution.iterations < 30


def test_robust_fits_agree_too(machines: Mapping[str, Machine]) -> None:
    machine, clean = built(machines, "6-ups", 2)
    wild = {name: values.copy() for name, values in clean.observations.items()}
    wild["x"][::10] += 1.0
    recording = replace(clean, observations=wild)
    gn, ipopt = estimate(machine, recording, loss="huber"), bounded(machine, recording, loss="huber")
    assert gn.weights.min() < 0.1
    # weights settle to 3e-3, and each solver's own end decides where
    assert apart(ipopt, gn) < 1e-4
    np.testing.assert_allclose(ipopt.weights, gn.weights, atol=1e-3)


@pytest.mark.parametrize("name", MACHINES)
def test_the_programs_derivatives(machines: Mapping[str, Machine], name: str) -> None:
    """Readings and equations by every unknown, along random directions, against differences."""
    machine, recording = built(machines, name, 3, n=5)
    prior, rng = prior_of(machine), np.random.default_rng(15)
    problem = Problem(Predictor(machine, recording), prior, nominal(machine), ~recording.validation)
    program = Program(problem, np.zeros(len(prior.free)))
    v = np.append(rng.standard_normal(program.n), 0.1 * rng.standard_normal(program.size - program.n))
    v[: program.n] /= program.step  # one tolerance
    for function in (program.observations, program.equations):
        _, slopes = function(v)
        for _ in range(4):
            way = rng.standard_normal(program.size)
            ends = [function(v + sign * 1e-4 * way)[0] for sign in (-1, 1)]
            slope = slopes @ way
            scale = 1.0 + np.max(np.abs(slope), initial=0.0)
            np.testing.assert_allclose((ends[1] - ends[0]) / 2e-4, slope, atol=1e-6 * scale)


# ------------------------------------------------------------------------------------ outcomes


@pytest.mark.parametrize("name", ["arm", "6-ups"])
def test_an_end_that_is_no_minimum_names_what_still_moves(
    machines: Mapping[str, Machine], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = machines[name]
    truth = nominal(machine)
    truth[[p.name for p in machine.parameters].index("tool.x")] += 20.0
    recording = simulated(machine, truth, np.random.default_rng(9))
    monkeypatch.setitem(OPTIONS, "ipopt.max_iter", 0)
    with pytest.raises(ConvergenceError, match=r"iteration limit.*responsible: .*tool\.x"):
        bounded(machine, recording)


def test_rows_that_cannot_be_assembled_are_left_out(machines: Mapping[str, Machine]) -> None:
    machine, recording = built(machines, "6-ups", 10)
    q = recording.q.copy()
    q[5, 2] = 5000.0
    fit = bounded(machine, replace(recording, q=q))
    rest = estimate(machine, recording.subset(np.arange(len(q)) != 5))
    assert fit.unassembled == (5,)
    assert apart(fit, rest) < SAME


def test_lost_readings_are_left_out(machines: Mapping[str, Machine]) -> None:
    machine, recording = built(machines, "6-pus", 14)
    gaps = np.where(np.arange(len(recording)) % 5 == 0, np.nan, recording.observations["x"])
    lost = replace(recording, observations={**recording.observations, "x": gaps})
    assert apart(bounded(machine, lost), estimate(machine, lost)) < SAME


def test_validation_rows_are_not_fitted(machines: Mapping[str, Machine]) -> None:
    machine, recording = built(machines, "6-pus", 11)
    out = np.arange(len(recording)) % 4 == 0
    spoiled = {name: np.where(out, values + 1.0, values) for name, values in recording.observations.items()}
    fit = bounded(machine, replace(recording, observations=spoiled, validation=out))
    assert apart(fit, estimate(machine, recording.subset(~out))) < SAME


def test_readings_that_compare_rows(tmp_path: Path) -> None:
    """A cavity's change between two rows of a machine with loops couples the rows' coordinates."""
    sensor = (
        "sensor: [{type: position, sigma: {xyz: 0.05}}, {type: distance, sigma: {distance: 0.001}, "
        "beam: {xyz: [0, 0, 900]}, mirror: {in: tool, z: 2, rx: 3, ry: -4}}]\n"
    )
    machine = written(tmp_path, MADE + FRAMES + hexapod("6-ups", "range: [480, 560]") + sensor)
    rng = np.random.default_rng(12)
    truth, n = manufactured(machine, rng), 25
    q = 500.0 + rng.uniform(-15, 15, (n, 6))
    poses = record(machine, q)
    origin = np.maximum(np.arange(n) - 1, 0)
    poses = replace(poses, from_row=origin)
    predictor = Predictor(machine, poses)
    names, values, _, _ = predictor.columns(truth, predictor.assemble(truth)[0])
    noise = np.array([0.05, 0.05, 0.05, 0.001]) * rng.standard_normal(values.shape)
    recording = replace(poses, observations=dict(zip(names, (values + noise).T, strict=True)))
    assert apart(bounded(machine, recording), estimate(machine, recording)) < SAME


def narrowed(machine: Machine, **limits: tuple[float, float]) -> Bounds:
    """The machine's bounds, and these on some parameters (dots written as __)."""
    bounds = bounds_of(machine, machine.effects)
    low, high = bounds.low.copy(), bounds.high.copy()
    for name, (first, last) in limits.items():
        k = bounds.names.index(name.replace("__", "."))
        low[k], high[k] = first, last
    return replace(bounds, low=low, high=high)


def by_another_code(machine: Machine, recording: Recording, bounds: Bounds) -> tuple[Array, float]:
    """Steps and cost at the minimum of SciPy's trust region reflective method on the reduced problem."""
    problem = Problem(
        Predictor(machine, recording), prior_of(machine), nominal(machine), ~recording.validation
    )

    def residual(t: Array) -> Array:
        return np.vstack([np.asarray(block) for block in problem.blocks(t)])[:, -1]

    def slopes(t: Array) -> Array:
        return np.vstack([np.asarray(block) for block in problem.blocks(t)])[:, :-1]

    found = least_squares(
        residual,
        np.zeros(len(problem.prior.free)),
        slopes,
        bounds=bounds.steps(problem),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-12,
    )
    return found.x, float(found.cost)


@pytest.mark.parametrize("name", ["arm", "6-pus"])
def test_within_bounds_the_minimum_is_that_of_another_code(
    machines: Mapping[str, Machine], name: str
) -> None:
    """With two bounds active."""
    machine, rng = machines[name], np.random.default_rng(4)
    recording = simulated(machine, manufactured(machine, rng), rng, n=20)
    plain = estimate(machine, recording)
    free = plain.prior.free
    # two parameters that the readings pull well away from the drawing may not go there
    pulled = free[np.argsort(-np.abs(plain.p - nominal(machine))[free] / plain.std[free])[:2]]
    limits = {}
    for k in pulled:
        edge = nominal(machine)[k] + 0.5 * (plain.p - nominal(machine))[k]
        upper = plain.p[k] > edge
        limits[plain.prior.names[k]] = (-np.inf, edge) if upper else (edge, np.inf)
    bounds = narrowed(machine, **limits)
    fit = bounded(machine, recording, bounds)
    assert np.all(fit.p[free] >= bounds.low[free]) and np.all(fit.p[free] <= bounds.high[free])
    active = (fit.p == bounds.low) | (fit.p == bounds.high)
    assert set(np.flatnonzero(active)) == set(pulled)
    assert fit.chi2 > plain.chi2
    x, cost = by_another_code(machine, recording, bounds)
    steps = (fit.p - nominal(machine))[free] / fit.prior.scale[free]
    np.testing.assert_allclose(steps, x, atol=1e-4)  # SciPy stays a little inside its bounds
    assert np.sum(fit.residual**2) + np.sum((steps) ** 2) <= 2 * cost * (1 + 1e-9)


@pytest.mark.parametrize("kind", ["mm and deg", "um and mrad"])
def test_bounds_of_the_file_are_in_its_units_and_hold(tmp_path: Path, kind: str) -> None:
    unit, angle, k, turn = {
        "mm and deg": ("mm", "deg", 1.0, 1.0),
        "um and mrad": ("um", "mrad", 1e3, np.pi / 0.18),
    }[kind]
    text = (
        f"units: {{length: {unit}, angle: {angle}}}\n"
        f"bounds: {{q2.d: [-.inf, {k * 40.1}], q1.alpha: [{-0.02 * turn}, {0.01 * turn}]}}\n"
        f"tolerances: {{length: {k * 0.5}, angle: {turn * 0.1}}}\n"
        "mechanism:\n  type: serial\n  joints:\n"
        f"    - {{name: q1, kind: revolute, range: [{-90 * turn}, {90 * turn}]}}\n"
        f"    - {{name: q2, kind: revolute, alpha: {90 * turn}, d: {40 * k}, range: [{-90 * turn}, {90 * turn}]}}\n"
        f"    - {{name: q3, kind: prismatic, alpha: {90 * turn}, r: {200 * k}, range: [{-50 * k}, {50 * k}]}}\n"
        f"sensor: {{type: pose, sigma: {{xyz: {0.01 * k}, rot: {0.005 * turn}}}}}\n"
    )
    machine = written(tmp_path, text)
    truth, names = nominal(machine), [p.name for p in machine.parameters]
    truth[names.index("q2.d")] += 0.4
    truth[names.index("q1.alpha")] += np.radians(0.05)
    recording = simulated(machine, truth, np.random.default_rng(5), n=20)
    free = calibrate(machine, recording)
    assert any(
        re.match(r"q2\.d = 40\.[234]\d* mm is out of its bounds \[-inf, 40\.1\]", n) for n in free.notes
    )
    held = calibrate(machine, recording, solver="ipopt")
    assert held.fit.p[names.index("q2.d")] == pytest.approx(40.1, abs=1e-12)
    assert held.fit.p[names.index("q1.alpha")] == pytest.approx(np.radians(0.01), abs=1e-15)
    at = [note for note in held.notes if "stands at its bound" in note]
    assert sorted(note.split(" = ")[0] for note in at) == ["q1.alpha", "q2.d"]
    write_calibrated(tmp_path / "calibrated.yaml", held.fit, recording)
    again = load_machine(tmp_path / "calibrated.yaml").file
    assert again is not None and set(again.bounds) == {"q1.alpha", "q2.d"}  # which go on with the machine


def test_coefficients_keep_their_physical_bounds(tmp_path: Path) -> None:
    """A joint that gives way upwards is no joint: the fit says none rather than a negative compliance."""
    effect = "effects:\n  - {effect: joint-compliance, place: [q3], parameters: {c: {value: 0, unit: rad/(N*m)}}}\n"
    masses = "gravity: [0, 0, -9.80665]\nmasses: {load: {kg: 20, com: [0, 0, 0], in: tool}}\n"
    machine = written(tmp_path, MADE + FRAMES + masses + ARM + POSE + effect)
    (placed,) = machine.effects
    rng = np.random.default_rng(6)
    truth = np.append(manufactured(machine, rng), -2e-6)
    q = simulated(machine, truth[:-1], rng).q
    predictor = Predictor(machine, record(machine, q), machine.effects)
    names, values, _, _ = predictor.columns(truth, predictor.assemble(truth)[0])
    read = machine.sensors[0].noisy(values, rng)
    recording = record(machine, q, dict(zip(names, read.T, strict=True)))
    assert placed.coefficients[0].lower == 0.0
    assert calibrate(machine, recording).fit.p[-1] < 0.0
    held = calibrate(machine, recording, solver="ipopt")
    assert held.fit.p[-1] == 0.0
    assert any("joint-compliance@q3:c = 0 rad/(N*m) stands at its bound" in note for note in held.notes)


def test_directions_and_rods_have_bounds(machines: Mapping[str, Machine]) -> None:
    machine = machines["6-pus"]
    bounds = bounds_of(machine)
    at = dict(zip(bounds.names, zip(bounds.low, bounds.high, strict=True), strict=True))
    assert at["leg1.length"] == (0.0, np.inf)
    assert at["leg1.u.x"] == at["leg6.u.y"] == (-1.0, 1.0)
    assert at["leg1.a.x"] == (-np.inf, np.inf)
    recording = simulated(machine, nominal(machine), np.random.default_rng(7), n=8)
    prior = prior_of(machine)
    start = nominal(machine)
    start[bounds.names.index("leg3.u.x")], start[bounds.names.index("leg3.u.y")] = 0.03, -0.04
    problem = Problem(Predictor(machine, recording), prior, start, ~recording.validation)
    program = Program(problem, np.zeros(len(prior.free)))
    value, _ = program.equations(program.unknowns(np.zeros(len(prior.free))))
    np.testing.assert_allclose(value[-6:], np.array([0, 0, 0.0025, 0, 0, 0]) - 1.0, atol=1e-12)
    assert np.all(np.isinf(program.least[-6:])) and np.all(program.least[:-6] == 0.0)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ("{q2.d: [3, 1]}", r"m\.yaml: bounds\.q2\.d: .*\[low, high\].*found \[3, 1\]"),
        ("{q2.d: [1]}", r"m\.yaml: bounds\.q2\.d: .*\[low, high\]"),
        ("{q2.d: [a, b]}", r"m\.yaml: bounds\.q2\.d: .*\[low, high\]"),
        ("{q2.d: 7}", r"m\.yaml: bounds\.q2\.d: .*\[low, high\]"),
        ("{q2.dd: [1, 2]}", r"m\.yaml: bounds\.q2\.dd: no such parameter; did you mean .*'q2\.d'"),
    ],
)
def test_bounds_that_mean_nothing_are_refused(tmp_path: Path, section: str, message: str) -> None:
    with input_error(message):
        machine = written(tmp_path, f"bounds: {section}\n" + MADE + FRAMES + ARM + POSE)
        calibrate(machine, simulated(machine, nominal(machine), np.random.default_rng(8), n=12))


def test_bounds_against_physics_are_refused(tmp_path: Path) -> None:
    text = "bounds: {leg2.length: [-20, -10]}\n" + MACHINES["6-pus"]
    with input_error(r"bounds\.leg2\.length: found \[-20.0, -10.0\].*physics"):
        bounds_of(written(tmp_path, text))


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_what_stands_at_a_bound_is_the_same_in_every_unit(unit: float) -> None:
    step = 0.01
    low, high = np.full(5, -2.0), np.full(5, 3.0)
    at = np.array([3.0 + 1e-12, 3.0 - 1e-3 * step, 3.0 + 1e-3 * step, -2.0 + 1e-12, -2.0 - 1e-3 * step])
    names, sizes = tuple("abcde"), np.full(5, unit * step)
    prior = Prior(names, np.zeros(5), np.ones(5), sizes, names)
    bounds = Bounds(names, ("mm",) * 5, unit * low, unit * high, np.ones(5, dtype=bool))
    kept, beyond = (bounds.notes(prior, unit * at, kept=kept) for kept in (True, False))
    assert [note[0] for note in kept] == ["a", "d"]
    assert [note[0] for note in beyond] == ["c", "e"]


TELESCOPE = ROOT / "models/machines/telescope"


def test_all_solvers_find_one_minimum_of_the_telescope() -> None:
    machine = load_machine(TELESCOPE / "machine.yaml")
    recording = load_recording(machine, [TELESCOPE / "recording.csv"])
    gn, lm = (estimate(machine, recording, damping=damping, tolerance=1e-13) for damping in (0.0, 1e-4))
    assert apart(lm, gn) < SAME
    assert apart(bounded(machine, recording), gn) < SAME
