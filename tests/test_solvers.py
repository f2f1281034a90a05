"""Every solver on every machine: one estimate; bounds that hold; outcomes that are told."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from typer.testing import CliRunner

from support.telescope_legs import leg_rows
from truepose.cli import app
from truepose.errors import ConvergenceError, InputError
from truepose.identification.bounds import Bounds, bounds_of
from truepose.identification.calibrate import calibrate
from truepose.identification.estimate import Estimate, estimate
from truepose.identification.load import load_recording
from truepose.identification.prediction import Predictor
from truepose.identification.problem import Problem, prior_of
from truepose.identification.program import Program
from truepose.identification.recording import Recording
from truepose.identification.simultaneous import OPTIONS, simultaneous
from truepose.models.load import load_machine
from truepose.models.machine import Machine

Array = NDArray[np.float64]
HEAD = "schema: truepose/machine/1\nname: {name}\n"
FRAMES = """
frames:
  base: {in: world, xyz: [10, -20, 30], rpy: [4, -3, 25], tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [5, -7, 60], rpy: [-8, 6, 12], tolerance: {xyz: 1, rpy: 1}}
"""
BASE = "\n".join(line for line in FRAMES.splitlines() if "tool" not in line) + "\n"
MADE = "tolerances: {length: 0.2, angle: 0.05}\n"
POSE = "sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.005}}\n"
ARM = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: prismatic, r: 20, range: [-100, 100]}
    - {name: q2, kind: revolute, alpha: 90, d: 40, range: [-90, 90]}
    - {name: q3, kind: revolute, d: 300, range: [-90, 90]}
    - {name: q4, kind: revolute, alpha: 90, r: 200, range: [-90, 90]}
"""


def hexapod(kind: str, tail: str) -> str:
    return f"mechanism:\n  type: {kind}\n  home: [0, 0, 440, 0, 0, 5]\n  legs:\n{leg_rows(tail)}"


HYBRID = """
mechanism: {type: 3ups-up-3r, base_radius: 350, platform_radius: 135, platform_offset: 345, wrist_offset: 405,
  head: 120, tool: 250, limb_range: [800, 1000], wrist_range: [-40, 40], screw_pitch: 10}
"""
MACHINES: Mapping[str, str] = {
    "arm": MADE + FRAMES + ARM + POSE,
    "6-pus": MADE + FRAMES + hexapod("6-pus", "length: 500, range: [-80, 80]") + POSE,
    "6-ups": MADE + FRAMES + hexapod("6-ups", "range: [480, 560]") + POSE,
    "hybrid": MADE + BASE + HYBRID + POSE,
}
"""One of every kind: a chain, loops closed by rods, a graph as shorthand."""
GRAPHS = ("delta", "planar")
"""And written-out graphs, in the folder ``machines``: over-constrained limbs, a planar linkage."""
TELESCOPE = Path(__file__).parents[1] / "models/machines/telescope"
SAME = 1e-6
"""Tolerances by which solvers may differ; each ends within 1e-6 of a 1-sigma of the minimum."""


def written(folder: Path, text: str, name: str = "m") -> Machine:
    path = folder / f"{name}.yaml"
    path.write_text(HEAD.format(name=name) + text)
    return load_machine(path)


def as_recording(machine: Machine, q: Array, columns: Mapping[str, Array] | None = None) -> Recording:
    n = len(q)
    return Recording(
        joints=machine.mechanism.readings,
        q=q,
        readings=columns or {},
        labels={},
        drivers={},
        files=("simulated.csv",),
        source_file=np.zeros(n, dtype=np.int64),
        source_row=np.arange(1, n + 1),
        session=np.ones(n, dtype=np.int64),
        session_recorded=np.zeros(n, dtype=bool),
        validation=np.zeros(n, dtype=bool),
    )


def simulated(machine: Machine, truth: Array, rng: np.random.Generator, n: int = 30) -> Recording:
    """What the sensors read of the machine ``truth``, with their noise."""
    ranges = np.array([a.range for a in machine.mechanism.actuators], dtype=float)
    q = ranges.mean(axis=1) + 0.4 * np.ptp(ranges, axis=1) * rng.uniform(-1, 1, (n, len(ranges)))
    predictor = Predictor(machine, as_recording(machine, q))
    x, good = predictor.assemble(truth)
    assert good.all()
    names, values, _, _ = predictor.columns(truth, x)
    read = machine.sensors[0].noisy(values, rng)
    return as_recording(machine, q, dict(zip(names, read.T, strict=True)))


def nominal(machine: Machine) -> Array:
    return np.array([p.nominal for p in machine.parameters])


def built(machine: Machine, rng: np.random.Generator) -> Array:
    sigma = np.array([p.tolerance for p in machine.parameters])
    return nominal(machine) + np.where(np.isfinite(sigma), sigma, 0.0) * rng.standard_normal(len(sigma))


def apart(one: Estimate, other: Estimate) -> float:
    """Largest difference of two estimates, in tolerances."""
    free = one.prior.free
    return float(np.max(np.abs(one.p - other.p)[free] / one.prior.scale[free]))


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    folder = tmp_path_factory.mktemp("machines")
    known = {name: written(folder, text, name) for name, text in MACHINES.items()}
    return known | {name: load_machine(Path(__file__).parent / f"machines/{name}.yaml") for name in GRAPHS}


def bounded(machine: Machine, recording: Recording, bounds: Bounds | None = None, **more: object) -> Estimate:
    """The estimate by IPOPT."""
    solver = partial(simultaneous, bounds=bounds or bounds_of(machine, machine.effects))
    return estimate(machine, recording, machine.effects, solver=solver, **more)  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------ one minimum


@pytest.mark.parametrize("name", [*MACHINES, *GRAPHS])
def test_all_solvers_find_one_minimum(machines: Mapping[str, Machine], name: str) -> None:
    machine, rng = machines[name], np.random.default_rng(1)
    recording = simulated(machine, built(machine, rng), rng)
    gn, lm = (estimate(machine, recording, damping=damping, tolerance=1e-13) for damping in (0.0, 1e-4))
    ipopt = bounded(machine, recording)
    assert gn.chi2_per_dof == pytest.approx(1.0, abs=0.4)
    assert apart(lm, gn) < SAME
    assert apart(ipopt, gn) < SAME
    np.testing.assert_allclose(ipopt.std, gn.std, rtol=1e-5)
    np.testing.assert_allclose(ipopt.x, gn.x, atol=1e-5)
    assert type(ipopt) is type(gn) and ipopt.factor.shape == gn.factor.shape
    assert ipopt.solution.iterations < 30


def test_all_solvers_find_one_minimum_of_the_telescope() -> None:
    machine = load_machine(TELESCOPE / "machine.yaml")
    recording = load_recording(machine, [TELESCOPE / "recording.csv"])
    gn, lm = (estimate(machine, recording, damping=damping, tolerance=1e-13) for damping in (0.0, 1e-4))
    assert apart(lm, gn) < SAME
    assert apart(bounded(machine, recording), gn) < SAME


def test_robust_fits_agree_too(machines: Mapping[str, Machine]) -> None:
    machine, rng = machines["6-ups"], np.random.default_rng(2)
    clean = simulated(machine, built(machine, rng), rng)
    wild = {name: values.copy() for name, values in clean.readings.items()}
    wild["x"][::10] += 1.0
    recording = replace(clean, readings=wild)
    gn, ipopt = estimate(machine, recording, loss="huber"), bounded(machine, recording, loss="huber")
    assert gn.weights.min() < 0.1
    # weights settle to 3e-3, and each solver's own end decides where
    assert apart(ipopt, gn) < 1e-4
    np.testing.assert_allclose(ipopt.weights, gn.weights, atol=1e-3)


@pytest.mark.parametrize("name", MACHINES)
def test_the_programs_derivatives(machines: Mapping[str, Machine], name: str) -> None:
    """Readings and equations by every unknown, along random directions, against differences."""
    machine, rng = machines[name], np.random.default_rng(3)
    recording = simulated(machine, built(machine, rng), rng, n=5)
    prior = prior_of(machine)
    problem = Problem(Predictor(machine, recording), prior, nominal(machine), ~recording.validation)
    program = Program(problem, np.zeros(len(prior.free)))
    v = np.append(rng.standard_normal(program.n), 0.1 * rng.standard_normal(program.size - program.n))
    v[: program.n] /= program.step  # one tolerance
    for function in (program.readings, program.equations):
        _, slopes = function(v)
        for _ in range(4):
            way = rng.standard_normal(program.size)
            ends = [function(v + sign * 1e-4 * way)[0] for sign in (-1, 1)]
            slope = slopes @ way
            scale = 1.0 + np.max(np.abs(slope), initial=0.0)
            np.testing.assert_allclose((ends[1] - ends[0]) / 2e-4, slope, atol=1e-6 * scale)


# ------------------------------------------------------------------------------------ bounds


def narrowed(machine: Machine, **limits: tuple[float, float]) -> Bounds:
    """The machine's bounds, and these on some parameters (dots written as __)."""
    bounds = bounds_of(machine, machine.effects)
    low, high = bounds.low.copy(), bounds.high.copy()
    for name, (first, last) in limits.items():
        k = bounds.names.index(name.replace("__", "."))
        low[k], high[k] = first, last
    return replace(bounds, low=low, high=high)


@pytest.mark.parametrize("name", ["arm", "6-pus"])
def test_within_bounds_the_minimum_is_that_of_another_code(
    machines: Mapping[str, Machine], name: str
) -> None:
    """Against SciPy's trust region reflective method on the reduced problem, two bounds active."""
    machine, rng = machines[name], np.random.default_rng(4)
    recording = simulated(machine, built(machine, rng), rng, n=20)
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
    problem = Problem(
        Predictor(machine, recording), prior_of(machine), nominal(machine), ~recording.validation
    )

    def residual(t: Array) -> Array:
        return np.vstack([*problem.blocks(t)])[:, -1]

    def slopes(t: Array) -> Array:
        return np.vstack([*problem.blocks(t)])[:, :-1]

    other = least_squares(
        residual,
        np.zeros(len(free)),
        slopes,
        bounds=bounds.steps(problem),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-12,
    )
    steps = (fit.p - nominal(machine))[free] / fit.prior.scale[free]
    np.testing.assert_allclose(steps, other.x, atol=1e-4)  # SciPy stays a little inside its bounds
    assert np.sum(fit.residual**2) + np.sum((steps) ** 2) <= 2 * other.cost * (1 + 1e-9)


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


def test_coefficients_keep_their_physical_bounds(tmp_path: Path) -> None:
    """A joint that gives way upwards is no joint: the fit says none rather than a negative compliance."""
    effect = "effects:\n  - {effect: joint-compliance, place: [q3], parameters: {c: {value: 0, unit: rad/(N*m)}}}\n"
    masses = "gravity: [0, 0, -9.80665]\nmasses: {load: {kg: 20, com: [0, 0, 0], in: tool}}\n"
    machine = written(tmp_path, MADE + FRAMES + masses + ARM + POSE + effect)
    (placed,) = machine.effects
    rng = np.random.default_rng(6)
    truth = np.append(built(machine, rng), -2e-6)
    q = simulated(machine, truth[:-1], rng).q
    predictor = Predictor(machine, as_recording(machine, q), machine.effects)
    names, values, _, _ = predictor.columns(truth, predictor.assemble(truth)[0])
    read = machine.sensors[0].noisy(values, rng)
    recording = as_recording(machine, q, dict(zip(names, read.T, strict=True)))
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
    with pytest.raises(InputError, match=message):
        machine = written(tmp_path, f"bounds: {section}\n" + MADE + FRAMES + ARM + POSE)
        calibrate(machine, simulated(machine, nominal(machine), np.random.default_rng(8), n=12))


def test_bounds_against_physics_are_refused(tmp_path: Path) -> None:
    text = "bounds: {leg2.length: [-20, -10]}\n" + MACHINES["6-pus"]
    with pytest.raises(InputError, match=r"bounds\.leg2\.length: found \[-20.0, -10.0\].*physics"):
        bounds_of(written(tmp_path, text))


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
    machine, rng = machines["6-ups"], np.random.default_rng(10)
    recording = simulated(machine, built(machine, rng), rng)
    q = recording.q.copy()
    q[5, 2] = 5000.0
    fit = bounded(machine, replace(recording, q=q))
    rest = estimate(machine, recording.subset(np.arange(len(q)) != 5))
    assert fit.unassembled == (5,)
    assert apart(fit, rest) < SAME


def test_validation_rows_are_not_fitted(machines: Mapping[str, Machine]) -> None:
    machine, rng = machines["6-pus"], np.random.default_rng(11)
    recording = simulated(machine, built(machine, rng), rng)
    out = np.arange(len(recording)) % 4 == 0
    spoiled = {name: np.where(out, values + 1.0, values) for name, values in recording.readings.items()}
    fit = bounded(machine, replace(recording, readings=spoiled, validation=out))
    assert apart(fit, estimate(machine, recording.subset(~out))) < SAME


def test_readings_that_compare_rows(tmp_path: Path) -> None:
    """A cavity's change between two rows of a machine with loops couples the rows' coordinates."""
    sensor = (
        "sensor: [{type: position, sigma: {xyz: 0.05}}, {type: distance, sigma: {distance: 0.001}, "
        "beam: {xyz: [0, 0, 900]}, mirror: {in: tool, z: 2, rx: 3, ry: -4}}]\n"
    )
    machine = written(tmp_path, MADE + FRAMES + hexapod("6-ups", "range: [480, 560]") + sensor)
    rng = np.random.default_rng(12)
    truth, n = built(machine, rng), 25
    q = 500.0 + rng.uniform(-15, 15, (n, 6))
    poses = as_recording(machine, q)
    origin = np.maximum(np.arange(n) - 1, 0)
    poses = replace(poses, from_row=origin)
    predictor = Predictor(machine, poses)
    names, values, _, _ = predictor.columns(truth, predictor.assemble(truth)[0])
    noise = np.array([0.05, 0.05, 0.05, 0.001]) * rng.standard_normal(values.shape)
    recording = replace(poses, readings=dict(zip(names, (values + noise).T, strict=True)))
    assert apart(bounded(machine, recording), estimate(machine, recording)) < SAME


def test_the_command_keeps_bounds(tmp_path: Path) -> None:
    machine = written(tmp_path, "bounds: {q3.d: [299.9, 300.1]}\n" + MADE + FRAMES + ARM + POSE)
    truth = nominal(machine)
    truth[[p.name for p in machine.parameters].index("q3.d")] += 0.4
    recording = simulated(machine, truth, np.random.default_rng(13))
    table = dict(zip(machine.mechanism.readings, recording.q.T, strict=True))
    headers = [f"{name} [{'mm' if name == 'q1' else 'rad'}]" for name in table]
    headers += [f"{name} [{'rad' if name[0] == 'r' else 'mm'}]" for name in recording.readings]
    columns = np.column_stack([*table.values(), *recording.readings.values()])
    np.savetxt(tmp_path / "r.csv", columns, delimiter=",", header=",".join(headers), comments="", fmt="%.17g")
    arguments = [str(tmp_path / "m.yaml"), str(tmp_path / "r.csv"), "-o", str(tmp_path / "out")]
    result = CliRunner().invoke(app, ["calibrate", *arguments, "--solver", "ipopt"])
    assert result.exit_code == 0, result.output
    assert "note: q3.d = 300.1 mm stands at its bound" in result.stderr
    found = json.loads((tmp_path / "out/fit.json").read_text())
    assert found["method"] == {"estimator": "map", "solver": "ipopt"}
    assert found["parameters"]["q3.d"]["value"] == pytest.approx(300.1, abs=1e-12)
    # the bounds go on with the machine
    again = load_machine(tmp_path / "out/calibrated.yaml")
    assert again.file is not None and again.file.bounds == {"q3.d": (299.9, 300.1)}
