"""Every derivative of a machine against one obtained another way.

By complex steps: the instructions of the value, not of its derivative, are run here with complex numbers,
f'(x) = Im f(x + ih)/h, which loses nothing to cancellation (h = 1e-30). Through closed loops: they are closed anew
with 40 digits and differenced with steps of 1e-12, whose error is the step squared. What is left is rounding of
the double arithmetic under test: measured 1.3e-12 by complex steps, 3e-15 through closed loops.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import mpmath  # type: ignore[import-untyped]
import numpy as np
import pytest
from numpy.typing import NDArray

from support.telescope_legs import UNEVEN, leg_rows
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.effects.of_rows import OF_ROWS
from truepose.models.kinematics import SymbolicModel, symbolic_model
from truepose.models.load import load_machine
from truepose.models.machine import Machine
from truepose.models.sensors.base import sensors

Array = NDArray[np.float64]
EXACT = 1e-11
"""Relative to a column's largest entry: rounding of a few thousand operations, cancellation included."""
LOST = 1e-2
"""Part of the value's size that a column is compared with at least: one that vanishes is a value's rounding."""
HEAD = "schema: truepose/machine/1\nname: {name}\ntolerances: {{length: 0.2, angle: 0.1}}\n"
FRAMES = """
gravity: [0.5, -0.3, -9.80665]
frames:
  base: {in: world, xyz: [10, -20, 30], rpy: [4, -3, 25], tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [5, -7, 60], rpy: [-8, 6, 12], tolerance: {xyz: 1, rpy: 1}}
"""
POSE = "sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.001}}\n"
ARM = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: prismatic, beta: 1, alpha: 2, d: 3, theta: 4, r: 20, range: [-90, 90], screw_pitch: 5}
    - {name: q2, kind: revolute, alpha: -90, r: 30, range: [-90, 90], gear_ratio: 50}
    - {name: q3, kind: revolute, beta: 1, d: 300, range: [-90, 90], gear_ratio: 80}
    - {name: q4, kind: revolute, alpha: 85, d: 20, r: 200, range: [-90, 90], gear_ratio: 100}
masses: {link3: {kg: 12, com: [150, 5, 40], in: link3}, payload: {kg: 4, com: [3, 20, 10], in: tool}}
"""
CARRIED = "masses: {platform: {kg: 8, com: [10, -5, 15], in: platform}, payload: {kg: 2, com: [5, -2, 40], in: tool}}\n"


def hexapod(kind: str, tail: str) -> str:
    legs = leg_rows(f"{tail}, screw_pitch: 4", UNEVEN)
    return f"mechanism:\n  type: {kind}\n  home: [0, 0, 440, 0, 0, 5]\n  legs:\n{legs}{CARRIED}"


HYBRID = """
mechanism: {type: 3ups-up-3r, base_radius: 350, platform_radius: 135, platform_offset: 345, wrist_offset: 405,
  head: 120, tool: 250, limb_range: [800, 1000], wrist_range: [-40, 40], screw_pitch: 10}
"""
MACHINES: Mapping[str, str] = {
    "arm": FRAMES + ARM + POSE,
    "6-pus": FRAMES + hexapod("6-pus", "u: [0.1, -0.05, 1], length: 500, range: [-60, 60]") + POSE,
    "6-ups": FRAMES + hexapod("6-ups", "gain: 1.02, offset: 3, range: [480, 540]") + POSE,
    "hybrid": HYBRID + POSE,
}
SENSORS: Mapping[str, str] = {
    "pose": "{type: pose, sigma: {xyz: 0.01, rot: 0.001}}",
    "position": "{type: position, sigma: {xyz: 0.02}}",
    "targets": "{type: targets, points: {P1: [1, 2, 3], P2: [40, 0, 5], P3: [0, 50, -6]}, sigma: {xyz: 0.01}}",
    "distance": "{type: distance, beam: {xyz: [1, 900, 3], rx: 91, rz: 4}, mirror: {in: tool, z: 2, rx: 3, ry: -4}, "
    "sigma: {distance: 0.001}}",
    "ballbar": "{type: ballbar, centre: [100, 20, 30], ball: [1, 2, 3], sigma: {distance: 0.001}}",
    "socket": "{type: socket, ball: [1, 2, 30], sigma: {xyz: 0.01}}",
}


def written(folder: Path, text: str, name: str = "m") -> Machine:
    path = folder / f"{name}.yaml"
    path.write_text(HEAD.format(name=name) + text)
    return load_machine(path)


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    folder = tmp_path_factory.mktemp("machines")
    return {name: written(folder, text, name) for name, text in MACHINES.items()}


def drawn(machine: Machine, rng: np.random.Generator) -> Array:
    """Parameters two tolerances off their drawing."""
    sigma = np.array([p.tolerance for p in machine.parameters])
    return np.array([p.nominal for p in machine.parameters]) + 2.0 * sigma * rng.uniform(-1, 1, len(sigma))


def readings(machine: Machine, rng: np.random.Generator, n: int = 1) -> Array:
    ranges = np.array([a.range for a in machine.mechanism.actuators], dtype=float)
    out: Array = ranges.mean(axis=1) + 0.3 * np.ptp(ranges, axis=1) * rng.uniform(-1, 1, (n, len(ranges)))
    return out


def as_recording(machine: Machine, q: Array, **more: Any) -> Recording:
    n = len(q)
    plain: dict[str, Any] = {"observations": {}, "labels": {}, "drivers": {}}
    return Recording(
        joints=machine.mechanism.readings,
        q=q,
        files=("f.csv",),
        source_file=np.zeros(n, dtype=np.int64),
        source_row=np.arange(1, n + 1),
        session=np.ones(n, dtype=np.int64),
        session_recorded=np.zeros(n, dtype=bool),
        validation=np.zeros(n, dtype=bool),
        **{**plain, **more},
    )


# ------------------------------------------------------------------------------- numbers of other kinds


def _complex_atan2(y: Any, x: Any) -> Any:
    """The angle and its derivative along the imaginary direction."""
    return np.arctan2(y.real, x.real) + 1j * (y.imag * x.real - x.imag * y.real) / (x.real**2 + y.real**2)


COMPLEX = SimpleNamespace(
    sin=np.sin,
    cos=np.cos,
    tan=np.tan,
    exp=np.exp,
    log=np.log,
    sqrt=np.sqrt,
    tanh=np.tanh,
    sinh=np.sinh,
    cosh=np.cosh,
    atan=np.arctan,
    asin=np.arcsin,
    acos=np.arccos,
    atan2=_complex_atan2,
    fabs=lambda a: a * np.sign(a.real),
    sign=lambda a: np.sign(a.real) + 0j,
    below=lambda a, b: a.real < b.real,
    where=np.where,
)
FUNCTIONS = (
    "sin",
    "cos",
    "tan",
    "exp",
    "log",
    "sqrt",
    "tanh",
    "sinh",
    "cosh",
    "atan",
    "asin",
    "acos",
    "fabs",
    "sign",
)
DIGITS = SimpleNamespace(
    **{name: getattr(mpmath, name) for name in (*FUNCTIONS, "atan2")},
    below=lambda a, b: a < b,
    where=lambda c, a, b: a if c else b,
)
UNARY = {getattr(ca, f"OP_{name.upper()}"): name for name in FUNCTIONS}
BINARY: Mapping[int, Callable[[Any, Any, Any], Any]] = {
    ca.OP_ADD: lambda _, a, b: a + b,
    ca.OP_SUB: lambda _, a, b: a - b,
    ca.OP_MUL: lambda _, a, b: a * b,
    ca.OP_DIV: lambda _, a, b: a / b,
    ca.OP_POW: lambda _, a, b: a**b,
    ca.OP_CONSTPOW: lambda _, a, b: a**b,
    ca.OP_ATAN2: lambda m, a, b: m.atan2(a, b),
    ca.OP_FMIN: lambda m, a, b: m.where(m.below(a, b), a, b),
    ca.OP_FMAX: lambda m, a, b: m.where(m.below(a, b), b, a),
    ca.OP_LT: lambda m, a, b: m.where(m.below(a, b), 1, 0),
    ca.OP_LE: lambda m, a, b: m.where(m.below(b, a), 0, 1),
    ca.OP_IF_ELSE_ZERO: lambda m, a, b: m.where(m.below(a * a, 0.25 + 0 * a), 0 * b, b),
}
PLAIN: Mapping[int, Callable[[Any], Any]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_NEG: lambda a: -a,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: a + a,
    ca.OP_INV: lambda a: 1 / a,
}


def run(function: ca.Function, inputs: Sequence[Any], numbers: SimpleNamespace) -> list[list[Any]]:
    """The function's instructions with other numbers than doubles: outputs by index, columns first."""
    work: list[Any] = [None] * function.sz_w()
    nothing = 0 * next(part[0] for part in inputs if len(part))  # of the right kind and shape
    outputs: list[list[Any]] = [[None] * function.nnz_out(k) for k in range(function.n_out())]
    for k in range(function.n_instructions()):
        code, into, out = (
            function.instruction_id(k),
            function.instruction_input(k),
            function.instruction_output(k),
        )
        if code == ca.OP_CONST:
            work[out[0]] = function.instruction_constant(k) + nothing
        elif code == ca.OP_INPUT:
            work[out[0]] = inputs[into[0]][into[1]]
        elif code == ca.OP_OUTPUT:
            outputs[out[0]][out[1]] = work[into[0]]
        elif code in PLAIN:
            work[out[0]] = PLAIN[code](work[into[0]])
        elif code in UNARY:
            work[out[0]] = getattr(numbers, UNARY[code])(work[into[0]])
        else:
            work[out[0]] = BINARY[code](numbers, work[into[0]], work[into[1]])
    return outputs


def complex_step(inputs: Sequence[ca.SX], at: Sequence[Array], value: ca.SX, by: int) -> Array:
    """(n, m) derivative of ``value`` by input number ``by``, all columns at once."""
    function = ca.Function("f", list(inputs), [ca.densify(ca.vec(value))])
    m = len(at[by])
    numbers = [np.asarray(a, dtype=complex)[:, None] + np.zeros(m) for a in at]
    numbers[by] = numbers[by] + 1e-30j * np.eye(m)
    (out,) = run(function, numbers, COMPLEX)
    return np.array([np.imag(row) for row in out]) / 1e-30


def check(inputs: Sequence[ca.SX], at: Sequence[Array], value: ca.SX, by: int, what: str = "") -> None:
    """CasADi's derivative is the complex step's."""
    own = ca.densify(ca.jacobian(ca.vec(value), inputs[by]))
    exact, here = ca.Function("j", list(inputs), [own, ca.densify(value)])(*at)
    stepped = complex_step(inputs, at, value, by)
    least = LOST * max(1.0, float(np.max(np.abs(here.full()))))
    size = np.maximum(np.max(np.abs(stepped), axis=0, initial=0.0), least)
    np.testing.assert_allclose(exact.full() / size, stepped / size, atol=EXACT, err_msg=what)


# ------------------------------------------------------------------------------- whole machines


def symbols_of(model: SymbolicModel) -> list[ca.SX]:
    return [model.x, model.q, model.z, model.p]


@pytest.mark.parametrize("name", MACHINES)
def test_pose_and_closure_by_everything(machines: Mapping[str, Machine], name: str) -> None:
    """By passive coordinates, readings and parameters, off the drawing and off closure."""
    machine, rng = machines[name], np.random.default_rng(6)
    model = symbolic_model(machine)
    x = model.home * (1 + 0.02 * rng.uniform(-1, 1, len(model.home))) + 0.02 * rng.uniform(
        -1, 1, len(model.home)
    )
    at = [x, readings(machine, rng)[0], model.z_home, drawn(machine, rng)]
    checked: set[str] = set()
    for value, what in ((model.world[:3, :], "world"), (model.closure, "closure"), (model.gap, "gap")):
        for by, symbol in ((0, "x"), (1, "q"), (3, "p")):
            if value.numel() and len(at[by]):
                check(symbols_of(model), at, value, by, f"{what} by {symbol}")
                checked.add(f"{what} by {symbol}")
    # an open chain has nothing passive and closes nothing
    looped = {f"{what} by x" for what in ("world", "closure", "gap")} if len(model.home) else set()
    assert checked >= {"world by q", "world by p"} | looped


@pytest.mark.parametrize("sensor", SENSORS)
def test_sensors_by_pose_and_constants(tmp_path: Path, sensor: str) -> None:
    """Predictions and residuals by a small twist and by every constant of the sensor."""
    machine = written(tmp_path, FRAMES + ARM + f"sensor: {SENSORS[sensor]}\n")
    (instrument,) = machine.sensors
    own = [*(p.name for p in instrument.parameters), *instrument.reads]
    rng = np.random.default_rng(7)
    at = np.array([30.0, 500.0, -20.0])
    turn = lie.exp_so3(np.array([-np.pi / 2 + 0.2, 0.1, -0.2]))
    small, c, y = ca.SX.sym("small", 6), ca.SX.sym("c", len(own)), ca.SX.sym("y", len(instrument.columns))
    moved = lie.transform((ca.SX.eye(3) + lie.skew(small[3:])) @ ca.DM(turn), ca.DM(at) + small[:3])
    named = dict(zip(own, ca.vertsplit(c), strict=True)) if own else {}
    constants = np.array([machine.geometry[name].nominal for name in own]) + 0.01 * rng.uniform(
        -1, 1, len(own)
    )
    values = [np.zeros(6), constants, np.zeros(len(instrument.columns))]
    predicted = instrument.predict(moved, named)
    outputs = {"prediction": predicted}
    if not instrument.compares:
        read = ca.Function("read", [small, c, y], [predicted])(*values).full()[:, 0]
        values[2] = read + 0.01 * rng.uniform(-1, 1, len(read))
        outputs["residual"] = instrument.residual(moved, named, y)
    for what, value in outputs.items():
        for by in (0, 1):
            if len(values[by]):
                check([small, c, y], values, value, by, what)


def test_every_sensor_was_checked() -> None:
    """A sensor that is added meets these tests by an entry in SENSORS; irradiance is turned into distances."""
    assert set(sensors) <= set(SENSORS) | {"irradiance"}


class _Logged:
    """A recording in which everything was logged, over three sessions."""

    n_sessions = 3

    def driver(self, name: str) -> Array:
        return np.linspace(0.0, 1000.0, 5)


def _somewhere(machines: Mapping[str, Machine], slug: str) -> list[tuple[str, PlacedEffect]]:
    """The effect at its first and last place on every machine that has one, with coefficients of some size."""
    out = []
    for name, machine in machines.items():
        effect = effects.get(slug, "test")()
        places = list(effect.places(machine))
        if effect.needs_load and name == "hybrid":
            continue  # weights nothing
        for place in dict.fromkeys(tuple(p) for p in places[:1] + places[-1:]):
            settings = dict(next(iter(effect.settings(machine, place, _Logged())), {}))
            placed = PlacedEffect.at(effect, machine, place, settings)
            sizes = [0.05 * c.scale if np.isfinite(c.scale) else 1e-3 for c in placed.coefficients]
            out.append((name, placed.with_values(sizes)))
    return out


@pytest.mark.parametrize("slug", [slug for slug in effects if slug not in (*OF_ROWS, "target-offset")])
def test_shifts_of_every_effect(machines: Mapping[str, Machine], slug: str) -> None:
    """Pose and closure by coefficients and parameters, the effect's shifts woven in.

    Effects of rows have no shifts; a target's offset moves its reading alone (tests/test_sensor_effects.py).
    """
    rng = np.random.default_rng(8)
    found = _somewhere(machines, slug)
    assert found
    for name, placed in found[:3]:
        machine = machines[name]
        model = symbolic_model(machine, [placed])
        x = model.home + 0.01 * rng.uniform(-1, 1, len(model.home))
        z = np.where(model.z_home == 0.0, 0.7, model.z_home + 1.5)
        at = [x, readings(machine, rng)[0], z, model.p_home]
        for value, what in ((model.world[:3, :], "world"), (model.closure, "closure")):
            if value.numel():
                check(symbols_of(model), at, value, 3, f"{placed.label} on {name}: {what} by p")
                check(symbols_of(model), at, value, 1, f"{placed.label} on {name}: {what} by q")


def _closed(model: SymbolicModel, at: Sequence[Any], rough: Array) -> list[Any]:
    """The passive coordinates that close the loops, to 30 digits, from doubles: Newton with a double's slope."""
    function = ca.Function("closure", symbols_of(model), [ca.densify(model.closure)])
    slope = ca.Function("slope", symbols_of(model), [ca.densify(ca.jacobian(model.closure, model.x))])
    doubles = [np.array([float(v) for v in part]) for part in at]
    inverse = np.linalg.inv(slope(rough, *doubles).full())
    x = [mpmath.mpf(float(v)) for v in rough]
    for _ in range(60):
        (gap,) = run(function, [x, *at], DIGITS)
        step = [mpmath.fdot([mpmath.mpf(float(v)) for v in row], gap) for row in inverse]
        x = [a - b for a, b in zip(x, step, strict=True)]
        if max(abs(s) for s in step) < mpmath.mpf(10) ** -34:
            return x
    raise AssertionError("the loops did not close")


@pytest.mark.parametrize("name", ["6-pus", "6-ups", "hybrid"])
def test_total_derivatives_through_closed_loops(machines: Mapping[str, Machine], name: str) -> None:
    """The implicit function theorem against loops closed anew with 40 digits, along random directions."""
    machine, rng = machines[name], np.random.default_rng(9)
    q, p = readings(machine, rng, 2), drawn(machine, rng)
    predictor = Predictor(machine, as_recording(machine, q))
    x, good = predictor.assemble(p)
    assert good.all()
    pose, twists = predictor.twists(p, x)
    model = predictor.model
    world = ca.Function("world", symbols_of(model), [ca.densify(ca.vec(model.world[:3, :]))])
    sigma = np.array([parameter.tolerance for parameter in machine.parameters])
    worst = 0.0
    with mpmath.workdps(40):
        h = mpmath.mpf(10) ** -12
        for row in range(2):
            z = [mpmath.mpf(float(v)) for v in predictor.z[row]]
            reading = [mpmath.mpf(float(v)) for v in q[row]]
            for _ in range(3):
                way = sigma * rng.uniform(-1, 1, len(p))
                ends = []
                for sign in (-1, 1):
                    moved = [
                        mpmath.mpf(float(a)) + sign * h * mpmath.mpf(float(b))
                        for a, b in zip(p, way, strict=True)
                    ]
                    closed = _closed(model, [reading, z, moved], x[row])
                    ends.append(run(world, [closed, reading, z, moved], DIGITS)[0])
                slope = (
                    np.array([float((b - a) / (2 * h)) for a, b in zip(*ends, strict=True)]).reshape(4, 3).T
                )
                spin = slope[:, :3] @ pose[row, :3, :3].T
                expected = np.array([*slope[:, 3], spin[2, 1], spin[0, 2], spin[1, 0]])
                exact = twists[row] @ way
                for part in (slice(0, 3), slice(3, 6)):
                    off = np.max(np.abs(exact - expected)[part]) / np.max(np.abs(expected[part]))
                    worst = max(worst, float(off))
    assert worst < 1e-12
