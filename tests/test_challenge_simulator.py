"""The independent simulator: operators, heat, campaigns, recordings, the arm and the Stewart platform."""

from __future__ import annotations

import ast
from dataclasses import fields, replace
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

import truepose.challenge.simulator as package
from truepose.challenge.simulator import heat, operators
from truepose.challenge.simulator.arm import Arm, ArmTargets
from truepose.challenge.simulator.base import (
    Array,
    Campaign,
    Imperfection,
    Place,
    Plan,
    SimulatedMachine,
    Specimen,
)
from truepose.challenge.simulator.campaigns import joined
from truepose.challenge.simulator.cantilever import Section, cantilever
from truepose.challenge.simulator.ported import PortedMachine, Work
from truepose.challenge.simulator.registry import MACHINES as REGISTERED
from truepose.challenge.simulator.stewart import Stewart
from truepose.challenge.simulator.stewart_closure import StewartPose
from truepose.challenge.simulator.stewart_drawing import PAYLOAD_COM, PLATFORM_COM, PLATFORM_KG
from truepose.challenge.simulator.stewart_physics import ring_compliance
from truepose.challenge.simulator.writing import recording_text
from truepose.identification.load import load_recording
from truepose.identification.prediction import Predictor
from truepose.models.load import load_machine

MACHINES: tuple[SimulatedMachine, ...] = (Arm(), ArmTargets(), Stewart())
ONLY_TARGETS = ("target-offset", "sensor-scale")
"""What three reflectors change; the rest of ``arm-targets`` is ``arm``."""
KINDS = [
    pytest.param(m, kind.name, place, id=f"{m.name}-{kind.name}-{'+'.join(place)}")
    for m in MACHINES
    for kind in m.kinds()
    for place in dict.fromkeys((kind.places[0], kind.places[-1]))
    if m.name != "arm-targets" or kind.name in ONLY_TARGETS
]
each_machine = pytest.mark.parametrize("machine", MACHINES, ids=lambda m: str(m.name))
signals = arrays(np.float64, st.integers(2, 30), elements=st.floats(-5, 5, width=32))


def plan_for(kind: str, poses: int = 12) -> Plan:
    return Plan(poses=poses, sessions=2, moving=kind == "latency")


def drawn(machine: SimulatedMachine, kind: str = "") -> tuple[Specimen, Campaign]:
    rng = np.random.default_rng(5)
    return machine.specimen(rng), machine.campaign(plan_for(kind), rng)


def imperfection(machine: SimulatedMachine, kind: str, place: Place, seed: int = 1) -> Imperfection:
    typical = next(k.typical for k in machine.kinds() if k.name == kind)
    return Imperfection(kind, place, typical, machine.shape(kind, place, np.random.default_rng(seed)))


class TestOperators:
    @given(signals, st.floats(0, 3))
    def test_play_is_exact_between_turning_points(self, path: Array, r: float) -> None:
        """Rate independence: points added on the way change nothing."""
        fine = np.interp(np.arange(0, len(path) - 0.9, 0.25), np.arange(len(path)), path)
        np.testing.assert_allclose(
            operators.play(fine[:, None], r)[::4], operators.play(path[:, None], r), atol=1e-13
        )

    @given(signals, st.floats(0.01, 3))
    def test_play_stays_within_its_width_and_lags(self, path: Array, r: float) -> None:
        out = operators.play(path, r)
        assert np.all(np.abs(path - out) <= r + 1e-12)
        assert np.all(np.diff(out) * np.diff(path) >= 0)

    @given(signals, st.floats(0.01, 3))
    def test_play_of_a_rising_path_is_idempotent(self, path: Array, r: float) -> None:
        rising = np.sort(path)
        once = operators.play(rising, r)
        np.testing.assert_array_equal(operators.play(once, 0.0, start=once[0]), once)
        np.testing.assert_allclose(operators.play(rising, r, start=once[0]), once, atol=0)

    @given(signals, st.floats(0.01, 2))
    def test_larger_turning_points_wipe_out_smaller_ones(self, path: Array, r: float) -> None:
        """After a sweep that is wider than all before it, no memory of them is left."""
        sweep = np.array([20.0, -20.0, 3.0])
        after = operators.play(np.concatenate([path, sweep]), r)[-1]
        assert after == operators.play(sweep, r)[-1]

    @given(signals)
    def test_no_width_no_memory(self, path: Array) -> None:
        np.testing.assert_array_equal(operators.play(path, 0.0), path)

    def test_the_approach_side_decides_after_an_overshoot(self) -> None:
        q = np.array([[0.3], [0.3], [-0.2]])
        side = np.array([[1.0], [-1.0], [1.0]])
        stood = operators.at_rows(operators.play(operators.waypoints(q, side, 0.1), 0.01))
        np.testing.assert_allclose(stood, q - 0.01 * side, atol=1e-15)

    def test_presliding_saturates_at_the_coulomb_limit(self) -> None:
        path = np.linspace(0, 1, 50)
        share = operators.presliding(path, [0.1, 0.4], [0.7, 0.3])
        assert share[-1] == pytest.approx(1.0)
        assert np.all(np.diff(share) >= -1e-15)

    @given(signals)
    def test_prandtl_ishlinskii_without_weights_is_nothing(self, path: Array) -> None:
        np.testing.assert_array_equal(
            operators.prandtl_ishlinskii(path, [0.1, 1.0], [0.0, 0.0]), np.zeros_like(path)
        )

    def test_creep_grows_with_the_logarithm_of_time(self) -> None:
        waits = np.array([10.0, 100.0, 1000.0])
        crept = [
            operators.creep(np.array([[0.0], [1.0]]), np.array([0.0, w]), 0.01, dwell=np.array([0.0, w]))[
                1, 0
            ]
            for w in waits
        ]
        # three elements to a decade follow the logarithm to a few percent
        np.testing.assert_allclose(np.diff(crept), 0.01, rtol=0.05)

    def test_creep_of_a_still_machine_is_nothing(self) -> None:
        still = np.full((5, 2), 0.7)
        np.testing.assert_array_equal(operators.creep(still, np.arange(5.0), 0.1), np.zeros((5, 2)))

    @given(st.floats(-1e3, 1e3), st.floats(1, 50))
    def test_a_stiffening_spring_balances_its_torque(self, torque: float, ratio: float) -> None:
        spring = operators.StiffeningSpring(1e6, ratio, 1e-3)
        w = float(spring.windup(np.array([torque]))[0])
        assert 1e6 * w + 1e6 * (ratio - 1) * w**3 / 1e-6 == pytest.approx(torque, rel=1e-9, abs=1e-6)

    @given(st.floats(0, 0.2), st.floats(-3, 3), st.floats(-3, 3))
    def test_an_eccentric_disc_reads_the_direction_of_its_head(
        self, e: float, phase: float, reading: float
    ) -> None:
        true = float(operators.eccentric_disc(np.array([reading]), e, phase)[0])
        centre = e * np.array([np.cos(true + phase), np.sin(true + phase)])
        seen = np.arctan2(*(np.array([1.0, 0.0]) - centre)[::-1])
        assert np.exp(1j * (true - seen)) == pytest.approx(np.exp(1j * reading), abs=1e-12)

    @given(arrays(np.float64, 6, elements=st.floats(-3, 3)))
    def test_a_centred_disc_reads_true(self, reading: Array) -> None:
        np.testing.assert_array_equal(operators.eccentric_disc(reading, 0.0, 1.0), reading)


class TestHeat:
    def test_a_lump_follows_a_ramp_by_its_lag(self) -> None:
        time = np.linspace(0, 1e5, 500)
        body = heat.lump(time, 1e-3 * time, 600.0)
        assert 1e-3 * time[-1] - body[-1] == pytest.approx(0.6, rel=1e-9)

    @settings(max_examples=30)
    @given(st.floats(10, 3000), st.integers(2, 6))
    def test_more_instants_change_nothing(self, lag: float, parts: int) -> None:
        time, drive = np.array([0.0, 400.0, 700.0, 2000.0]), np.array([20.0, 26.0, 21.0, 24.0])
        fine = np.unique(np.concatenate([np.linspace(0, 2000, 20 * parts), time]))
        body = heat.lump(fine, np.interp(fine, time, drive), lag)
        np.testing.assert_allclose(body[np.searchsorted(fine, time)], heat.lump(time, drive, lag), atol=1e-9)

    def test_skin_leads_core_and_both_arrive(self) -> None:
        time = np.linspace(0, 40_000, 300)
        skin, core = heat.skin_and_core(time, np.where(time > 0, 30.0, 20.0), 300.0, 1200.0)
        assert np.all(skin[1:] >= core[1:])
        assert skin[-1] == pytest.approx(30.0, abs=1e-3)
        assert core[-1] == pytest.approx(30.0, abs=1e-3)

    def test_no_strain_at_twenty_degrees(self) -> None:
        assert heat.strain(20.0, 1e-5) == 0.0


class TestCantilever:
    def test_textbook_deflections(self) -> None:
        """F L^3 / 3 EI, F L^2 / 2 EI, w L^4 / 8 EI of a slender bar; shear is left, (d / L)^2 of it."""
        section, length = Section.tube(20.0, 18.0), 4000.0
        by_wrench, by_weight = cantilever(np.zeros(3), np.array([0.0, 0.0, length]), section)
        ei = section.young * section.second
        assert by_wrench[0, 0] == pytest.approx(length**3 / 3 / ei, rel=1e-3)
        assert by_wrench[4, 0] == pytest.approx(length**2 / 2 / ei, rel=1e-9)
        assert by_weight[0, 0] == pytest.approx(length**3 / 8 / ei, rel=1e-3)
        assert by_weight[4, 0] == pytest.approx(length**2 / 6 / ei, rel=1e-9)

    def test_compliance_is_symmetric_and_positive(self) -> None:
        for C in (
            cantilever(np.ones(3), np.array([300.0, 80.0, -50.0]), Section.box(50, 44))[0],
            ring_compliance(),
        ):
            np.testing.assert_allclose(C, C.T, atol=1e-9 * np.max(C))
            assert np.min(np.linalg.eigvalsh(C)) > 0


class TestCampaigns:
    @each_machine
    def test_the_same_seed_gives_the_same_campaign(self, machine: SimulatedMachine) -> None:
        one, two = (machine.campaign(Plan(), np.random.default_rng(3)) for _ in range(2))
        for f in fields(Campaign):
            if f.name not in ("temperatures", "velocity"):
                np.testing.assert_array_equal(getattr(one, f.name), getattr(two, f.name))
        assert list(one.temperatures) == list(two.temperatures)

    @each_machine
    def test_what_is_not_varied_stays_nominal(self, machine: SimulatedMachine) -> None:
        c = machine.campaign(
            Plan(both_sides=False, loads=False, heat=False, held_out=0), np.random.default_rng(3)
        )
        assert np.all(c.payload == 0)
        assert np.all(c.approach == 1)
        assert np.all(c.session == 1)
        assert not c.validation.any()
        assert all(np.all(t == 20.0) for t in c.temperatures.values())

    @each_machine
    def test_repeats_come_from_the_other_side_under_the_same_load(self, machine: SimulatedMachine) -> None:
        c = machine.campaign(Plan(poses=15, repeats=2), np.random.default_rng(4))
        for number in np.unique(c.pose):
            first, second = np.flatnonzero(c.pose == number)
            np.testing.assert_array_equal(c.q[first], c.q[second])
            np.testing.assert_array_equal(c.approach[first], -c.approach[second])
            assert c.payload[first] == c.payload[second]
            assert c.validation[first] == c.validation[second]

    @each_machine
    def test_an_extreme_campaign_leaves_the_common_ones_behind(self, machine: SimulatedMachine) -> None:
        common = machine.campaign(Plan(), np.random.default_rng(5))
        extreme = machine.campaign(Plan(extreme=True), np.random.default_rng(6))
        assert np.all(extreme.validation)
        assert extreme.payload.max() > common.payload.max()
        assert np.abs(extreme.q).max() > np.abs(common.q).max()
        both = joined(common, extreme)
        assert len(both) == len(common) + len(extreme)
        assert np.all(np.diff(both.time) > 0)
        assert np.all(np.diff(np.unique(both.pose)) == 1)

    @each_machine
    def test_a_file_holds_joints_exactly(self, machine: SimulatedMachine) -> None:
        spec, c = drawn(machine)
        table = pd.read_csv(StringIO(recording_text(machine, c, machine.measure(spec, (), c))))
        q = table[list(machine.readings)].to_numpy()
        scale = np.where(machine.revolute, np.pi / 180, 1.0)
        np.testing.assert_allclose(q * scale, c.q, rtol=4e-16, atol=0)

    @each_machine
    def test_what_is_withheld_is_not_written(self, machine: SimulatedMachine) -> None:
        spec, c = drawn(machine)
        text = recording_text(machine, c, machine.measure(spec, (), c), withhold=("temperature", "payload"))
        head = text.splitlines()[0]
        assert "temperature" not in head
        assert "payload" not in head
        assert "approach" in head

    def test_an_origin_that_the_file_cannot_name_is_refused(self) -> None:
        machine = Arm()
        spec, c = drawn(machine)
        first = int(np.flatnonzero(c.pose == c.pose[-1])[0])
        wrong = c.origin.copy()
        wrong[first + 1] = 0 if first else 1
        c = replace(c, origin=wrong, pose=np.ones(len(c), dtype=np.int64))
        with pytest.raises(ValueError, match="origin"):
            recording_text(machine, c, machine.measure(spec, (), c))


@each_machine
class TestMachines:
    def test_truepose_predicts_the_exact_readings(self, machine: SimulatedMachine, tmp_path: Path) -> None:
        """Two programs, one drawing: with a specimen's own parameters they agree to 1e-9 mm and 1e-12 rad."""
        spec, c = drawn(machine)
        exact = machine.measure(spec, (), c)
        (tmp_path / "m.yaml").write_text(machine.machine_text())
        (tmp_path / "r.csv").write_text(recording_text(machine, c, exact))
        loaded = load_machine(tmp_path / "m.yaml")
        predictor = Predictor(loaded, load_recording(loaded, [tmp_path / "r.csv"]))
        p = np.array([spec.parameters[name] for name in predictor.model.names])
        x, good = predictor.assemble(p)
        assert good.all()
        _, values, _, _ = predictor.columns(p, x)
        units = np.array([1.0 if u == "mm" else 1e3 for u in machine.column_units])
        np.testing.assert_allclose(values * units, exact * units, atol=1e-9, rtol=0)

    def test_the_specimen_knows_every_parameter_and_its_tolerance(
        self, machine: SimulatedMachine, tmp_path: Path
    ) -> None:
        (tmp_path / "m.yaml").write_text(machine.machine_text())
        loaded = load_machine(tmp_path / "m.yaml")
        many = [machine.specimen(np.random.default_rng(k)).parameters for k in range(200)]
        assert set(many[0]) == {p.name for p in loaded.parameters}
        for parameter in loaded.parameters:
            values = np.array([s[parameter.name] for s in many])
            assert values.mean() == pytest.approx(parameter.nominal, abs=0.3 * parameter.tolerance + 1e-12)
            # 200 draws tell a standard deviation to 5 %; five of those
            assert values.std() == pytest.approx(parameter.tolerance, rel=0.25, abs=1e-12)

    def test_factors_misstate_the_drawing(self, machine: SimulatedMachine, tmp_path: Path) -> None:
        (tmp_path / "m.yaml").write_text(machine.machine_text())
        (tmp_path / "w.yaml").write_text(machine.machine_text(sigma_factor=3.0, tolerance_factor=0.5))
        right, wrong = load_machine(tmp_path / "m.yaml"), load_machine(tmp_path / "w.yaml")
        for said, misstated in zip(right.sensors[0].channels, wrong.sensors[0].channels, strict=True):
            assert misstated.sigma == pytest.approx(3 * said.sigma)
        for a, b in zip(right.parameters, wrong.parameters, strict=True):
            assert b.tolerance == pytest.approx(0.5 * a.tolerance)

    def test_the_noise_is_that_of_the_drawing(self, machine: SimulatedMachine, tmp_path: Path) -> None:
        rng = np.random.default_rng(8)
        spec = machine.specimen(rng)
        c = machine.campaign(Plan(poses=200), rng)
        exact = machine.measure(spec, (), c)
        (tmp_path / "m.yaml").write_text(machine.machine_text())
        loaded = load_machine(tmp_path / "m.yaml")
        sigma = np.array([channel.sigma for channel in loaded.sensors[0].channels])
        for factor in (1.0, 3.0):
            noise = (machine.noisy(exact, c, np.random.default_rng(9), factor=factor) - exact) / sigma
            # 400 rows tell a standard deviation to 3.5 %; rotation vectors differ by little from small turns
            np.testing.assert_allclose(noise.std(axis=0), factor, rtol=0.15)

    def test_unknown_kinds_and_places_are_refused(self, machine: SimulatedMachine) -> None:
        spec, c = drawn(machine)
        with pytest.raises(ValueError, match="expected one of"):
            machine.measure(spec, (Imperfection("magic", ("q1",), 1.0),), c)
        with pytest.raises(ValueError, match="expected one of"):
            machine.measure(spec, (Imperfection("backlash", ("nowhere",), 1.0),), c)

    def test_kinds_have_names_of_their_own(self, machine: SimulatedMachine) -> None:
        names = [kind.name for kind in machine.kinds()]
        assert len(set(names)) == len(names)
        assert sum(not kind.in_library for kind in machine.kinds()) >= (3 if machine.name == "stewart" else 5)


@pytest.mark.parametrize(("machine", "kind", "place"), KINDS)
class TestKinds:
    def test_size_none_leaves_readings_as_they_are(
        self, machine: SimulatedMachine, kind: str, place: Place
    ) -> None:
        spec, c = drawn(machine, kind)
        none = imperfection(machine, kind, place).scaled(0.0)
        np.testing.assert_array_equal(machine.measure(spec, (none,), c), machine.measure(spec, (), c))

    def test_readings_move_and_scale_continuously(
        self, machine: SimulatedMachine, kind: str, place: Place
    ) -> None:
        """Small sizes act in proportion; a tenth of a thousandth more of it changes readings by about as much."""
        spec, c = drawn(machine, kind)
        exact = machine.measure(spec, (), c)
        typical = imperfection(machine, kind, place)
        change = machine.measure(spec, (typical,), c) - exact
        assert np.max(np.abs(change)) > 1e-5
        more = machine.measure(spec, (typical.scaled(1 + 1e-4),), c) - exact
        assert np.linalg.norm(more - change) < 3e-4 * np.linalg.norm(change)
        small = machine.measure(spec, (typical.scaled(1e-2),), c) - exact
        assert np.linalg.norm(small - 1e-2 * change) < 1e-3 * np.linalg.norm(change)

    def test_the_same_again(self, machine: SimulatedMachine, kind: str, place: Place) -> None:
        spec, c = drawn(machine, kind)
        one, two = (machine.measure(spec, (imperfection(machine, kind, place),), c) for _ in range(2))
        np.testing.assert_array_equal(one, two)


class TestPhysics:
    def test_what_yields_lets_the_tool_fall_and_further_under_load(self) -> None:
        machine = Arm()
        spec, c = drawn(machine)
        heavy = replace(c, payload=np.full(len(c), 16.0))
        weak_parts = (
            ("joint-compliance", ("q2",)),
            ("joint-compliance", ("q3",)),
            ("link-bending", ("link2",)),
            ("link-bending", ("link4",)),
            ("gravity-sag", ("base",)),
        )
        for kind, place in weak_parts:
            weak = imperfection(machine, kind, place)
            empty, full = (
                _height(spec, machine.measure(spec, (weak,), k)) - _height(spec, machine.measure(spec, (), k))
                for k in (c, heavy)
            )
            assert np.mean(full) < np.mean(empty) < 0

    def test_pressed_legs_shorten(self) -> None:
        machine = Stewart()
        spec, c = drawn(machine)
        soft = tuple(imperfection(machine, "leg-compliance", (f"leg{k}",)) for k in range(1, 7))
        change = machine.measure(spec, soft, c) - machine.measure(spec, (), c)
        assert np.all(change[:, 2] < 0)

    def test_backlash_shows_only_between_sides(self) -> None:
        machine = Arm()
        spec, c = drawn(machine)
        one_sided = replace(c, approach=np.ones_like(c.approach))
        play = imperfection(machine, "backlash", ("q1",))
        zero = dict(spec.parameters)
        zero["q1.theta"] -= play.size / 2
        np.testing.assert_allclose(
            machine.measure(spec, (play,), one_sided),
            machine.measure(Specimen(zero), (), one_sided),
            atol=1e-9,
        )


class TestStatics:
    def test_arm_torques_are_slopes_of_the_potential_energy(self) -> None:
        """Central differences of the weights' energy by each joint, mJ to N*m; loads from summed moments."""
        machine = Arm()
        spec, c = drawn(machine)
        solved = machine.solve(_work(machine, spec, c))
        h = 1e-5
        for k in range(6):
            ends = []
            for side in (h, -h):
                work = _work(machine, spec, c)
                work.moved[:, k] += side
                there = machine.solve(work)
                ends.append(-np.einsum("nmi,nmi->n", there.weights, there.spots) * 1e-3)
            np.testing.assert_allclose(solved.torque(k), -(ends[0] - ends[1]) / (2 * h), atol=1e-5)

    def test_leg_forces_are_slopes_of_the_potential_energy(self) -> None:
        """A leg that grows by dl lifts the load by -F dl: Castigliano without any statics."""
        machine = Stewart()
        spec, c = drawn(machine)
        solved = machine.solve(_work(machine, spec, c))
        h = 1e-4
        for k in range(6):
            ends = []
            for side in (h, -h):
                work = _work(machine, spec, c)
                work.moved[:, k] += side
                ends.append(_energy(machine.solve(work), spec, c))
            np.testing.assert_allclose(solved.forces[:, k], -(ends[0] - ends[1]) / (2 * h), atol=1e-4)


def _work(machine: PortedMachine, spec: Specimen, c: Campaign) -> Work:
    values = {name: np.full(len(c), value) for name, value in spec.parameters.items()}
    return Work(c, values, np.zeros_like(c.q))


def _energy(there: StewartPose, spec: Specimen, c: Campaign) -> Array:
    """(n,) N*mm of platform and payload, from heights above the base's origin."""
    body = there.position + there.rotation @ np.array(PLATFORM_COM)
    hand = Rotation.from_euler("xyz", [spec.parameters[f"tool.r{a}"] for a in "xyz"]).apply(PAYLOAD_COM)
    hand = hand + np.array([spec.parameters[f"tool.{a}"] for a in "xyz"])
    load = there.position + there.rotation @ hand
    energy: Array = 9.80665 * (PLATFORM_KG * body[:, 2] + c.payload * load[:, 2])
    return energy


def test_registered_machines_go_by_their_names() -> None:
    assert {"arm", "arm-targets", "stewart"} <= set(REGISTERED)
    for name in REGISTERED:
        assert issubclass(REGISTERED[name], SimulatedMachine)
        assert REGISTERED[name].name == name
    with pytest.raises(KeyError, match="expected one of"):
        REGISTERED["lathe"]


def _height(spec: Specimen, readings: Array) -> Array:
    """Along the vertical of the base as built, mm."""
    p = spec.parameters
    up = Rotation.from_euler("xyz", [p[f"base.r{a}"] for a in "xyz"]).apply([0.0, 0.0, 1.0])
    height: Array = readings @ up
    return height


def test_the_simulator_imports_nothing_that_it_examines() -> None:
    """numpy, scipy, pandas, yaml and the standard library only; of truepose its own package alone."""
    allowed = {"numpy", "scipy", "pandas", "yaml", "__future__", "abc", "collections", "dataclasses", "enum"}
    allowed |= {"functools", "itertools", "math", "types", "typing", "contextlib"}
    root = Path(str(package.__file__)).parent
    for path in root.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                depth = len(path.relative_to(root).parts)
                assert node.level <= depth, f"{path}: leaves the simulator"
                names = [] if node.level else [str(node.module)]
            for name in names:
                own = name.startswith("truepose.challenge.simulator")
                assert own or name.split(".")[0] in allowed, f"{path}: imports {name}"
