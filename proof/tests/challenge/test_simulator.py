"""The independent simulator: campaigns, recordings, specimens, and what it may import."""

from __future__ import annotations

import ast
from dataclasses import fields, replace
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import challenge.simulator as package
from challenge.simulator.arm import Arm
from challenge.simulator.base import Campaign, Imperfection, Plan, SimulatedMachine
from challenge.simulator.campaigns import joined
from challenge.simulator.registry import MACHINES as REGISTERED
from challenge.simulator.writing import recording_text
from proof_support.simulated_machines import MACHINES, drawn
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

each_machine = pytest.mark.parametrize("machine", MACHINES, ids=lambda m: str(m.name))


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


def test_registered_machines_go_by_their_names() -> None:
    assert {"arm", "arm-targets", "stewart"} <= set(REGISTERED)
    for name in REGISTERED:
        assert issubclass(REGISTERED[name], SimulatedMachine)
        assert REGISTERED[name].name == name
    with pytest.raises(KeyError, match="expected one of"):
        REGISTERED["lathe"]


def test_the_simulator_imports_nothing_that_it_examines() -> None:
    """numpy, scipy, pandas, yaml and the standard library only; of truepose its own package alone."""
    allowed = {"numpy", "scipy", "pandas", "yaml", "__future__", "abc", "collections", "dataclasses", "enum"}
    allowed |= {"functools", "itertools", "math", "types", "typing", "contextlib"}
    root = Path(str(package.__file__)).parent
    seen = set()
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
                own = name.startswith("challenge.simulator")
                assert own or name.split(".")[0] in allowed, f"{path}: imports {name}"
                seen.add(name.split(".")[0])
    assert {"numpy", "scipy", "pandas", "yaml"} <= seen
