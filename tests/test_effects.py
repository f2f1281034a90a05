"""Laws that every physics effect keeps on every machine, and the signs and zeros of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from truepose.errors import InputError
from truepose.models.effects.base import (
    Coefficient,
    Effect,
    Place,
    PlacedEffect,
    Settings,
    Shifts,
    Site,
    effects,
)
from truepose.models.kinematics import SymbolicModel, symbolic_model
from truepose.models.load import load_machine
from truepose.models.machine import Machine, Mass
from truepose.models.statics import load_scale
from truepose.models.units import parse_unit

Array = NDArray[np.float64]

ARM = """
gravity: [0, 0, -9.80665]
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, d: 50, range: [-170, 170], gear_ratio: 121}
    - {name: q2, kind: revolute, alpha: 90, d: 150, range: [-90, 90], gear_ratio: 141}
    - {name: q3, kind: revolute, d: 700, r: 20, range: [-90, 90]}
frames: {tool: {in: flange, xyz: [300, 0, 40], rpy: [0, 0, 0], tolerance: {xyz: 1, rpy: 1}}}
sensor: {type: position, sigma: {xyz: 0.01}}
masses:
  link2: {kg: 20, com: [300, 10, 5], in: link2}
  payload: {kg: 3, com: [0, 20, 10], in: tool}
"""
STAGE = """
mechanism:
  type: serial
  joints:
    - {name: s1, kind: prismatic, range: [-150, 150], screw_pitch: 5}
    - {name: s2, kind: prismatic, alpha: -90, theta: -90, d: 30, range: [-20, 40], screw_pitch: 4}
    - {name: s3, kind: revolute, alpha: -90, r: 60, range: [-3, 3], gear_ratio: 100}
frames: {tool: {in: flange, xyz: [10, 20, 80], rpy: [5, 0, 0], tolerance: {xyz: 1, rpy: 1}}}
sensor: {type: pose, sigma: {xyz: 0.001, rot: 0.001}}
"""
ENDS = (
    ("[391.3, -83.2, 0]", "[173.6, -179.9, 0]"),
    ("[391.3, 83.2, 0]", "[173.6, 179.9, 0]"),
    ("[-123.6, 380.5, 0]", "[69, 240.3, 0]"),
    ("[-267.7, 297.3, 0]", "[-242.6, 60.4, 0]"),
    ("[-267.7, -297.3, 0]", "[-242.6, -60.4, 0]"),
    ("[-123.6, -380.5, 0]", "[69, -240.3, 0]"),
)
HEXAPOD = """
gravity: [0, 0, -9.80665]
mechanism:
  type: 6-pus
  home: [0, 0, 440, 0, 0, 0]
  legs:
"""
CARRIED = """
frames: {tool: {in: flange, xyz: [0, 0, 30], rpy: [0, 0, 0], tolerance: {xyz: 1, rpy: 1}}}
sensor: {type: pose, sigma: {xyz: 0.001, rot: 0.001}}
masses:
  platform: {kg: 8, com: [0, 0, 15], in: platform}
  payload: {kg: 2, com: [50, -20, 40], in: tool}
"""
_LEG = "    - {{name: leg{k}, joint: {joint}{k}, a: {a}, b: {b}, "
_PUS = _LEG + "length: 500, range: [-1.3, 1.3], screw_pitch: 1}}\n"
_UPS = _LEG + "offset: 500, gain: 5, range: [-9, 9], screw_pitch: 5}}\n"


def _legs(row: str, joint: str) -> str:
    return "".join(row.format(k=k, joint=joint, a=a, b=b) for k, (a, b) in enumerate(ENDS, 1))


TELESCOPE = HEXAPOD + _legs(_PUS, "rho") + "  flexure: {length: 30}\n" + CARRIED
GOUGH = "units: {joint: turn}" + HEXAPOD.replace("6-pus", "6-ups") + _legs(_UPS, "m") + CARRIED
GRAPH = """
gravity: [0, 0, -9.80665]
mechanism:
  type: graph
  bodies: [pedestal, trunk, arm, carriage, hand]
  joints:
    - {name: waist, kind: revolute, parent: pedestal, child: trunk, xyz: [0, 10, 300], actuated: true,
       range: [-170, 170], gear_ratio: 121}
    - {name: shoulder, kind: revolute, parent: trunk, child: arm, xyz: [40, 0, 100], rpy: [-90, 0, 0],
       axis: [0, 0.6, 0.8], actuated: true, range: [-90, 90], gear_ratio: 100}
    - {name: boom, kind: prismatic, parent: arm, child: carriage, xyz: [250, 0, 0], axis: [1, 0, 0], actuated: true,
       range: [-200, 200], screw_pitch: 10}
    - {name: bracket, kind: fixed, parent: carriage, child: hand, xyz: [60, 5, -20], rpy: [0, 30, 0]}
frames: {tool: {in: flange, xyz: [10, 20, 80], rpy: [5, 0, 0], tolerance: {xyz: 1, rpy: 1}}}
sensor: {type: pose, sigma: {xyz: 0.001, rot: 0.001}}
masses:
  arm: {kg: 9, com: [100, 10, 5], in: arm}
  payload: {kg: 3, com: [0, 20, 10], in: tool}
"""
CAMERA = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, d: 50, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: 90, d: 150, range: [-90, 90]}
frames:
  base: {in: world, xyz: [150, -100, 900], rpy: [5, -3, 40], tolerance: {xyz: 1, rpy: 1}}
  tool: {in: flange, xyz: [300, 0, 40], rpy: [0, 0, 0], tolerance: {xyz: 1, rpy: 1}}
sensor:
  type: targets
  points: {A1: [30, 0, 10], A2: [-20, 40, 0], A3: [0, -50, 5]}
  sigma: {xyz: 0.01}
"""
CAVITY = """
mechanism:
  type: serial
  joints:
    - {name: s1, kind: prismatic, alpha: 90, range: [-5, 5]}
    - {name: s2, kind: prismatic, alpha: 90, range: [-5, 5]}
    - {name: q3, kind: revolute, range: [-3, 3]}
sensor:
  type: distance
  beam: {in: world, xyz: [0.1, 0.9, 0.1], rx: 90.7, rz: -0.5}
  mirror: {in: flange, z: 0.2, rx: 88, ry: -0.6}
  sigma: {distance: 0.00001}
  tolerance: {beam.xyz: 2, beam.angle: 2, mirror.z: 1, mirror.angle: 2}
  wavelength: 0.00155
"""
TOLERANCES = "tolerances: {length: 0.1, angle: 0.1}\n"
HEAD = ("schema:", "name:", "tolerances:")


def _machine(name: str) -> str:
    """A machine of the tests, without what ``_read`` writes itself."""
    lines = (Path(__file__).parent / "machines" / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
    return "".join(f"{line}\n" for line in lines if not line.startswith(HEAD))


UNWEIGHED = ARM.split("masses:", maxsplit=1)[0]
TEXTS = {
    "arm": ARM,
    "stage": STAGE,
    "telescope": TELESCOPE,
    "gough": GOUGH,
    "unweighed": UNWEIGHED,
    "hybrid": _machine("hybrid"),
    "planar": _machine("planar"),
    "graph": GRAPH,
    "camera": CAMERA,
    "cavity": CAVITY,
}
LOADED = ("arm", "telescope", "gough", "hybrid", "planar", "graph")
READINGS = {
    "arm": [0.5, -0.4, 0.8],
    "stage": [60.0, 13.0, 0.03],
    "unweighed": [0.5, -0.4, 0.8],
    "telescope": [0.9, -0.5, 0.3, 1.1, -0.8, 0.2],
    "gough": [2.0, -3.0, 1.0, 4.0, 0.5, -2.0],
    "hybrid": [700.0, 760.0, 730.0, 0.3, -0.4, 0.5],
    "planar": [0.55, 2.7, -1.5],
    "graph": [0.5, -0.4, 80.0],
    "camera": [0.5, -0.4],
    "cavity": [1.5, -0.7, 0.03],
}
STRAIGHT = {"hybrid": [730.0, 730.0, 730.0, 0.0, 0.0, 0.0]}
DRIVERS = {"time": 5000.0, "payload": 4.0, "temperature": 27.0, "approach": -1.0, "session": 1.0}
DRIVERS |= {"stop": 0.1, "loop": -0.1, "creep": 0.2}
DRIVERS |= {"velocity": 0.3, "pressure": 985.0}
EFFECTS = list(effects)


@dataclass(frozen=True)
class Campaign:
    """A recording as effects see it: two hours, three sessions, these columns."""

    columns: tuple[str, ...] = ("time", "temperature", "approach", "session", "velocity", "pressure")
    n_sessions: int = 3

    def driver(self, name: str) -> object | None:
        if name.split(".", maxsplit=1)[0] not in self.columns and name not in self.columns:
            return None
        return np.linspace(100.0, 7300.0, 5) if name == "time" else np.full(5, 21.0)


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    folder = tmp_path_factory.mktemp("machines")
    return {name: _read(folder, name, text) for name, text in TEXTS.items()}


def _read(folder: Path, name: str, text: str) -> Machine:
    path = folder / f"{name}.yaml"
    path.write_text(f"schema: truepose/machine/1\nname: {name}\n{TOLERANCES}{text}")
    return load_machine(path)


class Solved:
    """A symbolic model at one configuration; Newton closes the loops.

    jacobian (12 + k, np): of the pose, row by row of its 3 x 4, and of the k columns of the sensors. Loads are by
    case, states by name.
    """

    def __init__(self, model: SymbolicModel, q: Sequence[float] | Array, **drivers: float) -> None:
        m, self.model = model, model
        given = DRIVERS | drivers
        z = [given.get(name, given.get(name.split(".")[0], 0.0)) for name in model.drivers]
        at = [np.array(q), np.array(z), model.p_home]
        x, inputs = model.home, [m.x, m.q, m.z, m.p]
        flat = ca.vertcat(ca.vec(m.pose[:3, :]), _readings(model))
        g = ca.Function("g", inputs, [m.closure, ca.jacobian(m.closure, m.x), ca.jacobian(m.closure, m.p)])
        f = ca.Function("f", inputs, [m.pose, ca.jacobian(flat, m.x), ca.jacobian(flat, m.p), flat[12:]])
        for _ in range(12 if len(x) else 0):
            residual, gx, _ = (np.array(v) for v in g(x, *at))
            x = x - np.linalg.solve(gx, residual)[:, 0]
        _, gx, gp = (np.array(v) for v in g(x, *at))
        xp = -np.linalg.solve(gx, gp) if len(x) else np.zeros((0, len(model.names)))
        self.pose, fx, fp, readings = (np.array(v) for v in f(x, *at))
        self.jacobian: Array = fx @ xp + fp
        self.readings: Array = readings[:, 0]
        self.load: dict[str, float] = {}
        for case, energy in m.energies.items():
            e = ca.Function("e", inputs, [ca.jacobian(energy, m.x), ca.jacobian(energy, m.p)])
            ex, ep = (np.array(v) for v in e(x, *at))
            names = [f"{case}{name}" for name in model.names]
            self.load |= dict(zip(names, -(ex @ xp + ep)[0], strict=True))
        seen = ca.Function("states", inputs, [ca.vertcat(ca.SX(0, 1), *m.states.values())])
        self.states = dict(zip(m.states, np.array(seen(x, *at))[:, 0], strict=True))

    @property
    def position(self) -> Array:
        return np.asarray(self.pose[:3, 3])


def _readings(model: SymbolicModel) -> ca.SX:
    """(k,) what the columns of all sensors should read, with what effects add."""
    p = dict(zip(model.names, ca.vertsplit(model.p), strict=True))
    parts = [
        sensor.predict(model.world, {n: p[n] for n in (*(q.name for q in sensor.parameters), *sensor.reads)})
        for sensor in model.machine.sensors
    ]
    return ca.vertcat(*parts) + model.reading_shift


def candidates(machine: Machine, slug: str) -> list[PlacedEffect]:
    """The effect at every place with every setting (of long lists, the first and the last two)."""
    effect, out = effects.get(slug, "test")(), []
    for place in effect.places(machine):
        settings = list(effect.settings(machine, place, Campaign()))
        chosen = settings if len(settings) <= 5 else [settings[0], *settings[-2:]]
        out += [PlacedEffect.at(effect, machine, place, s) for s in chosen]
    return out


def bare(machine: Machine) -> Solved:
    """Every parameter and port as a variable, no effects; solved once a machine and gravity."""
    key = (machine.name, machine.gravity)
    if key not in _BARE:
        _BARE[key] = Solved(symbolic_model(machine, ports=True), READINGS[machine.name])
    return _BARE[key]


_BARE: dict[object, Solved] = {}


def with_effect(
    machine: Machine, slug: str, place: Place, settings: Settings | None = None, **values: float
) -> PlacedEffect:
    return PlacedEffect.at(effects.get(slug, "test")(), machine, place, settings, values)


def shift_slopes(machine: Machine, placed: PlacedEffect) -> dict[str, Array]:
    """Derivative of each port's shift by the coefficients, at the tests' configuration and drivers."""
    readings = dict(zip(machine.mechanism.readings, READINGS[machine.name], strict=True))
    reference = bare(machine)
    values = dict(zip(reference.model.names, map(ca.SX, reference.model.p_home), strict=True))
    loads = {
        name: ca.SX(load / load_scale(machine, name.rpartition("|")[2]))
        for name, load in reference.load.items()
    }
    c = {coefficient.name: ca.SX.sym(coefficient.name) for coefficient in placed.coefficients}
    z = {name: ca.SX(DRIVERS[name.split(".")[0]]) for name in placed.drivers}
    q = {name: ca.SX(value) for name, value in readings.items()}
    states = {name: ca.SX(value) for name, value in reference.states.items()}
    site = Site(machine, placed.place, placed.settings_map, c, q, z, values, loads, states)
    symbols = ca.vertcat(*c.values())
    return {
        port: np.array(ca.evalf(ca.substitute(ca.jacobian(shift, symbols), symbols, 0 * symbols)))[0]
        for port, shift in placed.effect.shifts(site).items()
    }


# -- laws of every effect -------------------------------------------------------------------------------


@pytest.mark.parametrize("slug", EFFECTS)
@pytest.mark.parametrize("name", TEXTS)
def test_zero_coefficients_leave_the_machine_and_slopes_follow_the_ports(
    machines: Mapping[str, Machine], name: str, slug: str
) -> None:
    machine, placed = machines[name], candidates(machines[name], slug)
    if not placed:
        return
    reference = bare(machine)
    solved = Solved(symbolic_model(machine, placed), READINGS[name])
    np.testing.assert_allclose(solved.pose, reference.pose, atol=1e-10)
    np.testing.assert_allclose(solved.readings, reference.readings, atol=1e-10)
    column = len(machine.parameters)
    place_of = {port: k for k, port in enumerate(reference.model.names)}
    for effect in placed:
        slopes = shift_slopes(machine, effect)
        by_port = reference.jacobian[:, [place_of[port] for port in slopes]]
        expected = by_port @ np.array(list(slopes.values()))
        found = solved.jacobian[:, column : column + len(effect.coefficients)]
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9, err_msg=effect.label)
        column += len(effect.coefficients)


@pytest.mark.parametrize("slug", EFFECTS)
@pytest.mark.parametrize("name", TEXTS)
def test_descriptions_units_and_bounds(machines: Mapping[str, Machine], name: str, slug: str) -> None:
    kind = effects.get(slug, "test")
    assert kind.slug == slug
    assert all((kind.title, kind.formula, kind.size, kind.look_alikes, kind.experiment, kind.source))
    assert slug not in kind.look_alikes
    for placed in candidates(machines[name], slug):
        names = [c.name for c in placed.coefficients]
        assert len(set(names)) == len(names) > 0
        for c in placed.coefficients:
            assert parse_unit(c.unit, c.unit, "test") == c.unit
            assert 0 < c.scale < np.inf
            assert c.lower <= 0 < c.upper
        sentence = placed.effect.explain(machines[name], placed.place)
        assert sentence.endswith(".")
        assert 20 < len(sentence) < 200


@pytest.mark.parametrize("slug", EFFECTS)
def test_places_are_distinct_and_settings_default(machines: Mapping[str, Machine], slug: str) -> None:
    for machine in machines.values():
        effect = effects.get(slug, "test")()
        places = list(effect.places(machine))
        assert len(set(places)) == len(places)
        if places:  # a user may name a place without settings
            symbolic_model(machine, [PlacedEffect.at(effect, machine, places[0])])


def test_a_leg_and_its_actuator_are_one_place(machines: Mapping[str, Machine]) -> None:
    machine = machines["telescope"]
    joint_effects = ("actuator-scale", "backlash", "screw-periodic", "zero-shift", "axis-straightness")
    for slug in (*joint_effects, "leg-compliance"):
        slopes = [shift_slopes(machine, with_effect(machine, slug, (name,))) for name in ("leg2", "rho2")]
        assert slopes[0].keys() == slopes[1].keys()
        assert all(np.array_equal(slopes[0][port], slopes[1][port]) for port in slopes[0])


@pytest.mark.parametrize(("slug", "wrong"), [("actuator-scale", "rho7"), ("leg-compliance", "leg0")])
def test_unknown_places_are_told(machines: Mapping[str, Machine], slug: str, wrong: str) -> None:
    with pytest.raises(InputError, match=rf"found '{wrong}' on telescope, expected .* did you mean"):
        symbolic_model(machines["telescope"], [with_effect(machines["telescope"], slug, (wrong,))])


@pytest.mark.parametrize("name", TEXTS)
def test_effects_of_weight_need_masses_and_gravity(machines: Mapping[str, Machine], name: str) -> None:
    for slug in ("joint-compliance", "leg-compliance", "gravity-sag"):
        assert effects.get(slug, "test").needs_load
        probed = slug == "joint-compliance" and name == "unweighed"
        if name not in LOADED and not probed:
            assert not effects.get(slug, "test")().places(machines[name])


@pytest.mark.parametrize("slug", EFFECTS)
@pytest.mark.parametrize("name", TEXTS)
def test_weights_are_positive_and_twins_are_the_same_function(
    machines: Mapping[str, Machine], name: str, slug: str
) -> None:
    """What a twin does at a place, whatever its settings, the effect can do there too."""
    machine, effect = machines[name], effects.get(slug, "test")()
    for placed in candidates(machine, slug):
        assert 0 < effect.weight(placed.settings_map) < np.inf
        twins = effect.twins(placed.settings_map)
        own = shift_slopes(machine, placed) if twins else {}
        for twin, relative in twins.items():
            assert 0 < relative <= 1
            assert twin != slug
            same = [other for other in candidates(machine, twin) if other.place == placed.place]
            assert same
            for other in same:
                for port, slopes in shift_slopes(machine, other).items():
                    np.testing.assert_allclose(
                        np.min(abs(slopes[:, None] - own[port]), axis=1), 0, atol=1e-12
                    )


# -- signs and zeros of the specification ---------------------------------------------------------------


def _position(machine: Machine, q: Sequence[float] | Array, *placed: PlacedEffect, **drivers: float) -> Array:
    return Solved(symbolic_model(machine, placed), q, **drivers).position


def test_a_compliant_joint_of_a_horizontal_arm_gives_way_downwards(machines: Mapping[str, Machine]) -> None:
    arm, level = machines["arm"], [0.0, 0.0, 0.0]
    c = 1e-6
    moved = _position(arm, level, with_effect(arm, "joint-compliance", ("q2",), c=c)) - _position(arm, level)
    torque = 9.80665 * (20 * 0.3 + 4 * 1.0)  # 20 kg at 0.3 m, the payload of 4 kg at 0.7 + 0.3 m
    assert moved[2] == pytest.approx(-c * torque * 1000, rel=1e-4)


def test_the_vertical_axis_of_a_level_arm_carries_nothing(machines: Mapping[str, Machine]) -> None:
    arm = machines["arm"]
    moved = _position(arm, [0.3, 0.2, 0.1], with_effect(arm, "joint-compliance", ("q1",), c=1e-4))
    np.testing.assert_allclose(moved, _position(arm, [0.3, 0.2, 0.1]), atol=1e-9)


def test_a_sagging_base_turns_the_arm_downwards(machines: Mapping[str, Machine]) -> None:
    arm, level, c = machines["arm"], [0.0, 0.0, 0.0], 1e-6
    start = _position(arm, level)
    moved = _position(arm, level, with_effect(arm, "gravity-sag", ("base",), c=c)) - start
    moment = 9.80665 * (20 * 0.5 + 4 * 1.2)  # levers from the base's origin: 50 + 150 mm more than from q2
    assert moved[2] == pytest.approx(-c * moment * start[0], rel=1e-2)
    assert moved[0] > 0  # the tool stands above the mount and tips forward


# -- unknown masses ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("body", ["link2", "link3", "tool"])
def test_a_probe_is_one_kilogram_at_the_origin_of_a_body(machines: Mapping[str, Machine], body: str) -> None:
    unweighed = machines["unweighed"]
    weighed = replace(unweighed, masses=(Mass("probe", 1.0, (0.0, 0.0, 0.0), body),))
    assert unweighed.load_cases == ("link2|", "link3|", "tool|")
    assert weighed.load_cases == ("",)
    probe = Solved(symbolic_model(unweighed, ports=True), READINGS["arm"])
    mass = Solved(symbolic_model(weighed, ports=True), READINGS["arm"])
    expected = {f"{body}|{name}": load for name, load in mass.load.items()}
    assert any(abs(load) > 1.0 for load in expected.values())
    for name, load in expected.items():
        assert probe.load[name] == pytest.approx(load, rel=1e-12, abs=1e-9), name


@pytest.mark.parametrize(("case", "body"), [(0, "link2"), (1, "link3")])
@pytest.mark.parametrize("joint", ["q1", "q2"])
def test_compliance_times_a_mass_is_that_mass_on_that_compliance(
    machines: Mapping[str, Machine], joint: str, case: int, body: str
) -> None:
    unweighed, c, kg, q = machines["unweighed"], 2e-6, 7.0, READINGS["arm"]
    weighed = replace(unweighed, masses=(Mass("arm", kg, (0.0, 0.0, 0.0), body),))
    product = with_effect(unweighed, "joint-compliance", (joint,), {"carries": float(case)}, c_kg=c * kg)
    assert product.coefficients[0].unit == "rad/(N*m)*kg"
    found = _position(unweighed, q, product)
    expected = _position(weighed, q, with_effect(weighed, "joint-compliance", (joint,), c=c))
    np.testing.assert_allclose(found, expected, atol=1e-9)
    if (joint, body) == ("q2", "link3"):
        assert _position(unweighed, q)[2] - found[2] > 1e-3  # it gives way downwards


def test_candidates_of_unknown_masses_are_the_bodies_beyond_the_joint(
    machines: Mapping[str, Machine],
) -> None:
    unweighed, effect = machines["unweighed"], effects.get("joint-compliance", "test")()
    assert effect.places(unweighed) == [("q1",), ("q2",), ("q3",)]
    found = [[s["carries"] for s in effect.settings(unweighed, (f"q{k}",), Campaign())] for k in (1, 2, 3)]
    assert found == [[0, 1, 2], [1, 2], [2]]  # a body's origin lies on its own joint's axis
    last = with_effect(unweighed, "joint-compliance", ("q2",))  # as a user may write it
    assert [c.name for c in last.coefficients] == ["c_kg"]
    named = with_effect(unweighed, "joint-compliance", ("q2",), {"carries": 2.0})
    slopes = [shift_slopes(unweighed, placed)["q2.displacement"] for placed in (last, named)]
    np.testing.assert_array_equal(slopes[0], slopes[1])
    with pytest.raises(InputError, match="found carries = 5, expected 0 to 2"):
        with_effect(unweighed, "joint-compliance", ("q2",), {"carries": 5.0})
    # stated masses: the whole load, and gears that give way otherwise than in proportion
    assert effect.settings(machines["arm"], ("q2",), Campaign()) == ({}, {"bend": 2.0}, {"bend": 3.0})
    assert "masses are not stated" in effect.explain(unweighed, ("q2",))
    assert "masses are not stated" not in effect.explain(machines["arm"], ("q2",))


@pytest.mark.parametrize("name", ["telescope", "gough"])
def test_closed_loops_and_weightless_machines_have_no_probes(
    machines: Mapping[str, Machine], name: str
) -> None:
    machine = replace(machines[name], masses=())
    floating = replace(machines["unweighed"], gravity=None)
    for weightless in (machine, floating, replace(floating, gravity=(0.0, 0.0, 0.0))):
        assert weightless.load_cases == ()
        assert not effects.get("joint-compliance", "test")().places(weightless)


# -- closed loops -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["telescope", "gough", "hybrid"])
def test_legs_shorten_under_a_platform_they_carry_and_grow_where_it_hangs(
    machines: Mapping[str, Machine], name: str
) -> None:
    standing = machines[name]
    hanging = replace(standing, gravity=(0.0, 0.0, 9.80665))
    legs = tuple(limb.name for limb in standing.mechanism.limbs)
    for machine, sign in ((standing, -1), (hanging, 1)):
        soft = with_effect(machine, "leg-compliance", legs, c=1e-3)
        before, after = (_position(machine, STRAIGHT.get(name, [0.0] * 6), *e) for e in ((), (soft,)))
        assert sign * (after - before)[2] > 0
        assert sign * sum(float(slope[0]) for slope in shift_slopes(machine, soft).values()) > 0


def test_leg_forces_balance_the_weight(machines: Mapping[str, Machine]) -> None:
    machine = machines["telescope"]
    reference = bare(machine)
    values = dict(zip(reference.model.names, reference.model.p_home, strict=True))
    pose = reference.pose  # of the tool, 30 mm above the platform
    up = 0.0
    for k, limb in enumerate(machine.mechanism.limbs):
        end = np.array([values[n] for n in limb.platform_point]) - [0, 0, 30]
        top = pose[:3, :3] @ end
        foot = np.add([values[n] for n in limb.base_point], [0, 0, READINGS["telescope"][k]])
        leg = pose[:3, 3] + top - foot
        up -= reference.load[limb.length] * leg[2] / np.linalg.norm(leg)
    assert up == pytest.approx(9.80665 * (8 + 4), rel=1e-9)


def test_limbs_of_the_hybrid_share_a_centred_weight(machines: Mapping[str, Machine]) -> None:
    weighed = replace(machines["hybrid"], masses=(Mass("ring", 12.0, (0.0, 0.0, 30.0), "platform"),))
    solved = Solved(symbolic_model(weighed, ports=True), STRAIGHT["hybrid"])
    lean = np.sqrt(730.0**2 - (340.0 - 165.0) ** 2) / 730.0  # cosine: the limbs lean inwards
    for k in (1, 2, 3):
        assert solved.load[f"q{k}.displacement"] == pytest.approx(-12 * 9.80665 / 3 / lean, rel=1e-9)


def test_a_wrist_on_a_parallel_machine_carries_what_it_holds(machines: Mapping[str, Machine]) -> None:
    """4 kg, 50 mm aside along x and 20 mm along -y of the wrist that stands straight: only gravity's levers count."""
    hybrid = machines["hybrid"]
    solved = Solved(symbolic_model(hybrid, ports=True), STRAIGHT["hybrid"])
    torques = [solved.load[f"q{k}.displacement"] / 1000 for k in (4, 5, 6)]
    np.testing.assert_allclose(torques, np.array([0.0, 50.0, 20.0]) * 4 * 9.80665 / 1000, atol=1e-9)
    soft = with_effect(hybrid, "joint-compliance", ("q5",), c=1e-3)
    bent = _position(hybrid, STRAIGHT["hybrid"], soft) - _position(hybrid, STRAIGHT["hybrid"])
    assert bent[0] == pytest.approx(
        1e-3 * torques[1] * 210, rel=1e-2
    )  # the tool, 210 mm up, tips with the load


def test_a_limb_that_is_a_slide_gives_way_in_one_place(machines: Mapping[str, Machine]) -> None:
    """Joint and leg are the same port there: a diagnosis looks for one of the two."""
    hybrid, effect = machines["hybrid"], effects.get("joint-compliance", "test")()
    joint = shift_slopes(hybrid, with_effect(hybrid, "joint-compliance", ("q1",)))
    leg = shift_slopes(hybrid, with_effect(hybrid, "leg-compliance", ("leg1",)))
    np.testing.assert_allclose(joint["q1.displacement"], leg["q1.displacement"])
    assert [effect.screened(hybrid, place) for place in effect.places(hybrid)] == 3 * [False] + 3 * [True]


def test_parts_of_a_graph_heat_up_together(machines: Mapping[str, Machine]) -> None:
    def parts(name: str) -> dict[str, set[str]]:
        lengths = machines[name].mechanism.lengths
        return {part: {port.rsplit(".", 1)[0] for port in ports} for part, ports in lengths.items()}

    assert parts("hybrid")["platform"] == {"mount1", "mount2", "mount3", "q4"}
    assert parts("hybrid")["leg2"] == {"u2b", "q2", "s2"}  # its base point belongs to the base
    crank = {f"a{k}": {f"b{k}", f"p{k}"} for k in (1, 2, 3)}
    # the corner told from the limb's side is part of the platform all the same
    assert parts("planar") == {
        **crank,
        "base": {"a1", "a2", "a3"},
        "platform": {"mount1", "mount2", "mount3"},
    }
    assert parts("graph") == {
        "base": {"waist"},
        "trunk": {"shoulder"},
        "arm": {"boom"},
        "carriage": {"bracket"},
    }
    assert machines["hybrid"].mechanism.limbs[1].platform_point == ("mount2.x", "mount2.y", "mount2.z")


def test_a_slide_in_a_loop_only_bends_aside(machines: Mapping[str, Machine]) -> None:
    limb = with_effect(machines["hybrid"], "axis-straightness", ("q1",))
    assert [c.name for c in limb.coefficients] == ["x2", "y2"]
    boom = with_effect(machines["graph"], "axis-straightness", ("boom",))
    assert [c.name for c in boom.coefficients] == ["x2", "y2", "z2", "rx1", "ry1", "rz1"]


def test_a_scale_multiplies_the_reading_before_the_offset(machines: Mapping[str, Machine]) -> None:
    machine, q = machines["gough"], np.array(READINGS["gough"])
    s = 0.02
    one = _position(machine, q, with_effect(machine, "actuator-scale", ("m3",), s=s))
    np.testing.assert_allclose(one, _position(machine, q * (1 + s * (np.arange(6) == 2))), atol=1e-9)
    every = with_effect(machine, "actuator-scale", machine.mechanism.readings, s=s)
    np.testing.assert_allclose(_position(machine, q, every), _position(machine, q * (1 + s)), atol=1e-9)


@pytest.mark.parametrize("approach", [1.0, -1.0])
def test_backlash_leaves_the_joint_behind(machines: Mapping[str, Machine], approach: float) -> None:
    arm, b = machines["arm"], 1e-3
    found = _position(arm, [0.3, 0.2, 0.1], with_effect(arm, "backlash", ("q2",), b=b), approach=approach)
    np.testing.assert_allclose(found, _position(arm, [0.3, 0.2 - b / 2 * approach, 0.1]), atol=1e-9)


def test_periodic_errors_have_their_period(machines: Mapping[str, Machine]) -> None:
    stage, arm = machines["stage"], machines["arm"]
    screw = with_effect(stage, "screw-periodic", ("s2",), {"harmonic": 2.0}, a=0.01, b=0.02)
    off = [_position(stage, [0, s, 0], screw) - _position(stage, [0, s, 0]) for s in (0.3, 2.3, 1.3)]
    np.testing.assert_allclose(off[0], off[1], atol=1e-10)  # half of a pitch of 4 mm
    np.testing.assert_allclose(off[0], -off[2], atol=1e-10)
    gear = with_effect(arm, "transmission-error", ("q1",), {"order": 7.0}, a=1e-3)
    expected = _position(arm, [0.3 + 1e-3 * np.sin(2.1), 0.2, 0.1])
    np.testing.assert_allclose(_position(arm, [0.3, 0.2, 0.1], gear), expected, atol=1e-9)
    again = shift_slopes(machines["gough"], with_effect(machines["gough"], "screw-periodic", ("m1",)))
    np.testing.assert_allclose(again["m1.displacement"], [0, 1], atol=1e-12)  # two whole turns of the motor


def test_orders_are_those_that_the_range_can_show(machines: Mapping[str, Machine]) -> None:
    effect = effects.get("transmission-error", "test")()
    *single, together = effect.settings(machines["arm"], ("q1",), Campaign())
    assert [s["order"] for s in single] == [*map(float, range(1, 31)), 121.0, 242.0]
    assert together == {"orders": 60.0}
    *small, together = effect.settings(machines["stage"], ("s3",), Campaign())
    assert [s["order"] for s in small] == [
        *map(float, range(15, 31)),
        100.0,
        200.0,
    ]  # a quarter period in 6 deg
    assert together == {"orders": 60.0}


def test_a_series_is_the_sum_of_its_orders(machines: Mapping[str, Machine]) -> None:
    arm, q = machines["arm"], [0.7, 0.2, 0.1]
    amplitudes = {1: (4e-3, -2e-3), 2: (1e-3, 3e-3), 17: (5e-4, 2e-4), 60: (-3e-4, 1e-4)}
    values = {
        f"{letter}{k}": v for k, pair in amplitudes.items() for letter, v in zip("ab", pair, strict=True)
    }
    together = with_effect(arm, "transmission-error", ("q1",), {"orders": 60.0}, **values)
    single = [
        with_effect(arm, "transmission-error", ("q1",), {"order": float(k)}, a=a, b=b)
        for k, (a, b) in amplitudes.items()
    ]
    found = _position(arm, q, together)
    np.testing.assert_allclose(found, _position(arm, q, *single), atol=1e-9)
    assert np.linalg.norm(found - _position(arm, q)) > 1.0
    assert len(together.coefficients) == 120
    scales = np.array([c.scale for c in together.coefficients])
    assert (np.diff(scales) <= 0).all()
    assert scales[-1] < 0.02 * scales[0]
    assert scales[0] == 6e-4  # 2 arcmin, what the catalogue states
    sentence = together.effect.explain(arm, ("q1",))
    assert "q1" in sentence
    assert "gear" in sentence


def test_coupling_moves_the_driven_joint_by_the_driving_one(machines: Mapping[str, Machine]) -> None:
    stage, k = machines["stage"], 0.5
    placed = with_effect(stage, "axis-coupling", ("s1", "s3"), k=k)
    assert placed.coefficients[0].unit == "mm/rad"
    np.testing.assert_allclose(
        _position(stage, [60, 13, 0.03], placed), _position(stage, [60 + k * 0.03, 13, 0.03]), atol=1e-9
    )
    with pytest.raises(InputError, match="expected two joints: driven, driving"):
        with_effect(stage, "axis-coupling", ("s1",))


def test_heat_stretches_its_own_place_and_counts_from_20_degrees(machines: Mapping[str, Machine]) -> None:
    arm, hexapod, alpha = machines["arm"], machines["telescope"], 2e-5
    q = READINGS["arm"]
    cold = _position(arm, q)
    for place in effects.get("thermal-expansion", "test")().places(arm):
        heated = with_effect(arm, "thermal-expansion", place, alpha=alpha)
        np.testing.assert_allclose(_position(arm, q, heated, temperature=20.0), cold, atol=1e-10)
    ports = {
        place: shift_slopes(arm, with_effect(arm, "thermal-expansion", (place,)))
        for place in ("base", "link1", "link2", "tool")
    }
    assert {place: set(slopes) for place, slopes in ports.items()} == {
        "base": {"q1.r", "q1.d"},
        "link1": {"q2.d"},
        "link2": {"q2.r", "q3.d"},
        "tool": {"tool.x", "tool.y", "tool.z"},
    }
    assert ports["base"]["q1.r"] == pytest.approx(7 * 400)
    base = shift_slopes(hexapod, with_effect(hexapod, "thermal-expansion", ("base",)))
    assert base["leg1.a.x"] == pytest.approx(7 * 391.3)
    rho = shift_slopes(machines["gough"], with_effect(machines["gough"], "thermal-expansion", ("leg1",)))
    assert rho["m1.displacement"] == pytest.approx(7 * (500 + 5 * READINGS["gough"][0]))


def test_lags_and_thermometers_follow_the_recording(machines: Mapping[str, Machine]) -> None:
    effect, machine = effects.get("thermal-expansion", "test")(), machines["telescope"]
    legs = tuple(f"leg{k}" for k in range(1, 7))
    assert [s["lag"] for s in effect.settings(machine, ("base",), Campaign())] == [0, 300, 900, 1800, 3600]
    assert [s["lag"] for s in effect.settings(machine, ("base",), Campaign(("temperature",)))] == [0]
    lagging = with_effect(machine, "thermal-expansion", ("base",), {"lag": 900.0})
    assert lagging.drivers == ("temperature.base~900",)
    own = effect.settings(machine, legs, Campaign())[0]
    assert effect.drivers(machine, legs, own) == tuple(f"temperature.{leg}" for leg in legs)
    shared = effect.settings(machine, legs, Campaign(("temperature.leg2",)))[0]
    assert effect.drivers(machine, legs, shared) == ("temperature.leg2",)


def test_a_gear_that_stiffens_gives_way_by_odd_powers_of_its_load(machines: Mapping[str, Machine]) -> None:
    arm = machines["arm"]
    straight = shift_slopes(arm, with_effect(arm, "joint-compliance", ("q2",)))["q2.displacement"][0]
    for bend in (2.0, 3.0):
        placed = with_effect(arm, "joint-compliance", ("q2",), {"bend": bend})
        bent = shift_slopes(arm, placed)["q2.displacement"][0]
        share = abs(straight) / 100.0  # of 100 N m, at which the term is told in units of c
        assert bent == pytest.approx(straight * share ** (bend - 1))


def test_mounts_drift_shift_and_settle(machines: Mapping[str, Machine]) -> None:
    arm, q = machines["arm"], [0.3, 0.2, 0.1]
    still = _position(arm, q)
    steady = with_effect(arm, "mount-drift", ("base",), {"tau": 0.0, "start": 1000.0}, x=0.02)
    moved = _position(arm, q, steady, time=1000 + 1800) - still
    np.testing.assert_allclose(moved, [0.01, 0, 0], atol=1e-9)
    settling = with_effect(arm, "mount-drift", ("base",), {"tau": 600.0, "start": 1000.0}, z=0.05)
    assert settling.coefficients[2].unit == "mm"
    assert _position(arm, q, settling, time=1600)[2] - still[2] == pytest.approx(0.05 * (1 - np.exp(-1)))
    taus = [s["tau"] for s in settling.effect.settings(arm, ("base",), Campaign())]
    assert taus == [0, 580, 1100, 2200, 4300, 8600]  # of a campaign of 7200 s, neighbours twice as long
    bumped = with_effect(arm, "frame-shift", ("base",), {"session": 2.0}, y=0.3)
    assert bumped.drivers == ("session.after.2",)
    np.testing.assert_allclose(_position(arm, q, bumped, session=1.0) - still, [0, 0.3, 0], atol=1e-9)
    np.testing.assert_allclose(_position(arm, q, bumped, session=0.0), still, atol=1e-12)
    assert [s["session"] for s in bumped.effect.settings(arm, ("base",), Campaign())] == [1, 2]
    assert not bumped.effect.settings(arm, ("base",), Campaign(n_sessions=1))
    homed = with_effect(arm, "zero-shift", ("q2",), {"session": 1.0}, zero=0.01)
    np.testing.assert_allclose(_position(arm, q, homed), _position(arm, [0.3, 0.21, 0.1]), atol=1e-9)


def test_a_bent_guideway_of_an_arm(machines: Mapping[str, Machine]) -> None:
    stage = machines["stage"]
    bent = with_effect(stage, "axis-straightness", ("s1",), {"degree": 2.0}, x2=0.01, rz1=1e-4)
    assert [c.name for c in bent.coefficients] == ["x2", "y2", "z2", "rx1", "ry1", "rz1"]
    start, end = (_position(stage, [s, 13, 0], bent) - _position(stage, [s, 13, 0]) for s in (0, 150))
    np.testing.assert_allclose(start, 0, atol=1e-12)
    assert end[0] - 0.01 == pytest.approx(-1e-4 * _position(stage, [0, 13, 0])[1], rel=1e-2)
    known = bent.effect.settings(stage, ("s1",), Campaign())
    assert [*known] == [
        *({"degree": n} for n in (2.0, 3.0, 4.0)),
        *({"waves": n} for n in (2.0, 3.0, 4.0, 6.0)),
    ]
    assert not effects.get("axis-straightness", "test")().places(machines["gough"])


@pytest.mark.parametrize(
    ("wave", "at"), [(1, {0: 1}), (2, {-75: 1, 0: 0, 75: -1}), (3, {-100: 1, 0: -1, 100: 1})]
)
def test_half_waves_stand_between_the_ends_of_the_range(
    machines: Mapping[str, Machine], wave: int, at: Mapping[float, float]
) -> None:
    stage, size = machines["stage"], 0.02
    bent = with_effect(stage, "axis-straightness", ("s1",), {"waves": 3.0}, **{f"yw{wave}": size})
    assert [c.name for c in bent.coefficients[:6]] == ["xw1", "yw1", "zw1", "rxw1", "ryw1", "rzw1"]
    for s, expected in {-150: 0, 150: 0, **at}.items():
        moved = _position(stage, [s, 13, 0], bent) - _position(stage, [s, 13, 0])
        np.testing.assert_allclose(moved, [0, size * expected, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        ({"degree": 3.0}, ["e2", "e3"]),
        ({"degree": 4.0}, ["e2", "e3", "e4"]),
        ({"waves": 2.0}, ["ew1", "ew2"]),
    ],
)
def test_a_bent_rail_shows_only_along_its_leg(
    machines: Mapping[str, Machine], settings: Settings, names: Sequence[str]
) -> None:
    """Sideways of the leg the slide may go where it likes; the first shapes are the largest to expect."""
    machine, reference = machines["telescope"], bare(machines["telescope"])
    rail = with_effect(machine, "axis-straightness", ("rho1",), settings)
    assert [c.name for c in rail.coefficients] == names
    assert (np.diff([c.scale for c in rail.coefficients]) < 0).all()
    moved = shift_slopes(machine, rail)
    motion = np.array([moved[f"rho1.motion.{axis}"] for axis in "xyz"])  # (axis, coefficient)
    leg = np.array([173.6 - 391.3, -179.9 + 83.2, 0])
    leg /= np.linalg.norm(leg)
    np.testing.assert_allclose(motion, np.outer(leg, leg @ motion), atol=1e-12)
    columns = [reference.model.names.index(f"rho1.motion.{axis}") for axis in "xyz"]
    seen = reference.jacobian[:, columns]
    assert np.linalg.norm(seen @ leg) > 0.1
    assert np.linalg.norm(seen @ [-leg[1], leg[0], 0]) < 0.05 * np.linalg.norm(seen @ leg)


def test_a_bending_platform_moves_its_leg_ends(machines: Mapping[str, Machine]) -> None:
    machine = machines["telescope"]
    rho = np.array(READINGS["telescope"])
    common = shift_slopes(machine, with_effect(machine, "platform-deformation", ("platform",)))
    np.testing.assert_allclose([common[f"leg{k}.b.z"][0] for k in range(1, 7)], rho)
    full = with_effect(machine, "platform-deformation", ("platform",), {"form": 2.0})
    assert len(full.coefficients) == 36
    assert (full.coefficients[0].name, full.coefficients[35].name) == ("K[1,1]", "K[6,6]")
    np.testing.assert_allclose(shift_slopes(machine, full)["leg2.b.z"][6:12], rho)
    rigid = replace(machine, mechanism=replace(machine.mechanism, flexure_length=None))
    balls, flexures = (
        [s["form"] for s in full.effect.settings(m, ("platform",), Campaign())] for m in (rigid, machine)
    )
    assert balls == [4, 5]  # ball joints pass no moment on; weights bend either
    assert flexures == [0, 1, 3, 2, 4, 5]


def test_the_symmetric_platform_repeats_its_first_row_round_the_ring(machines: Mapping[str, Machine]) -> None:
    machine = machines["telescope"]
    placed = with_effect(machine, "platform-deformation", ("platform",), {"form": 3.0})
    slopes = shift_slopes(machine, placed)
    names = [c.name for c in placed.coefficients]
    assert sorted(names) == [f"K[1,{k}]" for k in range(1, 7)]
    rho = READINGS["telescope"]
    neighbour = names.index("K[1,6]")  # legs 1 and 6 hold one side of the platform, so do 2 and 3, 4 and 5
    for leg, other in ((1, 6), (6, 1), (2, 3), (3, 2), (4, 5), (5, 4)):
        assert slopes[f"leg{leg}.b.z"][neighbour] == pytest.approx(rho[other - 1])
        assert slopes[f"leg{leg}.b.z"][names.index("K[1,1]")] == pytest.approx(rho[leg - 1])


def test_the_measured_ring_of_the_telescope_has_its_symmetry(machines: Mapping[str, Machine]) -> None:
    """Equation 4 of INRIA RR-8096, measured: six numbers in place of 36 leave little of it."""
    measured = np.array(
        [
            [16, 0, -8, 12, -2, -20],
            [0, 20, -17, -1, 13, -13],
            [-2, -15, 14, 2, -9, 9],
            [6, -12, 4, 14, -16, 2],
            [-12, 7, 0, -15, 14, 4],
            [-20, -1, 10, -10, 2, 19],
        ]
    )
    machine = machines["telescope"]
    placed = with_effect(machine, "platform-deformation", ("platform",), {"form": 3.0})
    slopes, rho = shift_slopes(machine, placed), np.array(READINGS["telescope"])
    leg_of = np.array([[np.argmin(abs(rho - v)) for v in slopes[f"leg{k}.b.z"]] for k in range(1, 7)])
    entries = np.take_along_axis(measured, leg_of, axis=1)  # (leg, coefficient)
    assert np.linalg.norm(entries - entries.mean(axis=0)) < 0.3 * np.linalg.norm(measured)


def test_rails_tilt_alike_towards_their_legs(machines: Mapping[str, Machine]) -> None:
    machine = machines["telescope"]
    effect = effects.get("wrong-constant", "test")()
    together = max(effect.places(machine), key=len)
    assert len(together) == 12
    slopes = shift_slopes(machine, PlacedEffect.at(effect, machine, together))
    leg = np.array([173.6 - 391.3, -179.9 + 83.2])
    np.testing.assert_allclose(
        [slopes["leg1.u.x"][0], slopes["leg1.u.y"][0]], leg / np.linalg.norm(leg), atol=1e-9
    )
    one = with_effect(machine, "wrong-constant", ("leg3.length",), value=2.0)
    assert one.coefficients[0].unit == "mm"
    assert shift_slopes(machine, one) == {"leg3.length": np.array([1.0])}
    assert ("leg3.gain",) not in effect.places(machine)  # exactly known
    with pytest.raises(InputError, match=r"found no port 'leg9\.length'"):
        symbolic_model(machine, [with_effect(machine, "wrong-constant", ("leg9.length",))])


# -- a user's own effect --------------------------------------------------------------------------------


def test_a_new_effect_is_a_dozen_lines(machines: Mapping[str, Machine]) -> None:
    @effects.add("cable-pull")
    class CablePull(Effect):
        """A cable pulls the tool sideways in proportion to the first joint's reading."""

        slug: ClassVar[str] = "cable-pull"

        def places(self, machine: Machine) -> Sequence[Place]:
            return [("tool",)]

        def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
            return (Coefficient("k", "mm/rad", 0.1),)

        def shifts(self, site: Site) -> Shifts:
            return {"tool.motion.y": site.c["k"] * site.moved("q1")}

    try:
        assert "cable-pull" in list(effects)
        arm, q = machines["arm"], [0.5, 0.0, 0.0]
        moved = _position(arm, q, with_effect(arm, "cable-pull", ("tool",), k=0.2)) - _position(arm, q)
        assert np.linalg.norm(moved) == pytest.approx(0.1)
    finally:
        effects.discard("cable-pull")
    assert "cable-pull" not in list(effects)
