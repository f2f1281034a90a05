"""A user's own mechanism and sensor go the whole way: calibrated, written back, diagnosed, turned into C."""

from __future__ import annotations

import ctypes
import json
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from support.generated_c import COMPILER, Built, compile_library, needs_compiler
from support.two_joints import TWO_JOINTS
from truepose.cli import app
from truepose.identification.prediction.predict import predict, simulate
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.registry import load_plugin

Array = NDArray[np.float64]

SLIDES_AND_DIALS = '''
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from truepose.models.machine.builder import builders
from truepose.models.machine.mechanism import Actuator, Joint, Mechanism, Step
from truepose.models.machine.sensor import Channel, Sensor, sensors
from truepose.models.file.fields import Angle, Length, Section


class Slides(Section):
    type: str
    tilt: Angle = 0.0


class Dials(Section):
    type: str
    zero: Length = 0.0


@builders.add("two-slides")
def two_slides(section, context):
    """A slide along x that carries one along z."""
    tilt = context.parameter("tilt", "rad", context.parse(Slides, section).tilt, ("tilt",))
    x = Joint("sx", "prismatic", "base", "x", (), (1.0, 0.0, 0.0))
    z = Joint("sz", "prismatic", "x", "z", (Step("ry", "tilt"),))
    ends = {"sx": (-100.0, 100.0), "sz": (0.0, 200.0)}
    actuators = tuple(Actuator(n, n, "mm", "mm", range=r) for n, r in ends.items())
    return Mechanism((tilt,), (x, z), actuators, "z")


@sensors.add("two-dials")
@dataclass(frozen=True)
class TwoDials(Sensor):
    """Readings along x and z."""

    zero: object
    type: ClassVar[str] = "two-dials"
    columns = {"along": "mm", "height": "mm"}
    channels = tuple(Channel(name, "mm", 1e-3, "distance", name) for name in columns)
    parameters = property(lambda self: (self.zero,))

    @classmethod
    def build(cls, section, context):
        zero = context.parse(Dials, section).zero
        return cls(context.parameter("zero", "mm", zero, ("zero",), "sensor", 10.0))

    def predict(self, world, s):
        return world[[0, 2], 3] - s["zero"]
'''
SLIDES = """
schema: truepose/machine/1
name: slides
mechanism: {type: two-slides, tilt: 0}
frames: {base: {in: world, tolerance: {xyz: 0, rpy: 0}}, tool: {in: flange, tolerance: {xyz: 0, rpy: 0}}}
sensor: {type: two-dials, zero: 0}
tolerances: {angle: 0.5}
"""


@dataclass(frozen=True)
class Job:
    """A plugin, a machine file, a recording and what a command wrote."""

    plugin: Path
    machine: Path
    recording: Path
    out: Path

    def load(self, path: Path) -> Machine:
        load_plugin(self.plugin)
        return load_machine(path)


def run(*arguments: object) -> None:
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    assert result.exit_code == 0, result.output


def written(folder: Path, plugin: str, machine: str) -> Job:
    job = Job(folder / "plugin.py", folder / "machine.yaml", folder / "recording.csv", folder / "out")
    job.plugin.write_text(plugin)
    job.machine.write_text(machine)
    return job


@pytest.fixture(scope="module")
def slides(tmp_path_factory: pytest.TempPathFactory) -> Job:
    """Two slides, 3 mrad out of square, read by two dials whose zero is off by 0.7 mm; calibrated."""
    job = written(tmp_path_factory.mktemp("slides"), SLIDES_AND_DIALS, SLIDES)
    rng, tilt, zero = np.random.default_rng(7), 3e-3, 0.7
    x, z = rng.uniform(-100, 100, 30), rng.uniform(0, 200, 30)
    read = np.column_stack([x + z * np.sin(tilt) - zero, z * np.cos(tilt) - zero])
    read += 1e-3 * rng.standard_normal(read.shape)
    frame = pd.DataFrame({"sx": x, "sz": z, "along": read[:, 0], "height": read[:, 1]})
    frame.to_csv(job.recording, index=False)
    run("calibrate", job.machine, job.recording, "-o", job.out, "--plugin", job.plugin)
    return job


def test_a_new_mechanism_and_sensor_are_calibrated_and_written_back(slides: Job) -> None:
    fit = json.loads((slides.out / "fit.json").read_text())["parameters"]
    for name, true in (("tilt", 3e-3), ("zero", 0.7)):
        assert fit[name]["value"] == pytest.approx(true, abs=4 * fit[name]["std"])
    assert fit["tilt"]["std"] < 1e-5
    machine = slides.load(slides.out / "calibrated.yaml")
    assert machine.geometry["tilt"].nominal == pytest.approx(fit["tilt"]["value"], rel=1e-12)
    assert "two-dials" in (slides.out / "calibrated.yaml").read_text()
    assert (slides.out / "report.html").stat().st_size > 0


def test_a_new_mechanism_and_sensor_are_diagnosed(slides: Job) -> None:
    out = slides.out.with_name("diagnosed")
    run("diagnose", slides.machine, slides.recording, "-o", out, "--plugin", slides.plugin)
    assert json.loads((out / "diagnosis.json").read_text())["verdict"] == "adequate"


@needs_compiler
def test_a_new_mechanism_is_compiled(slides: Job, tmp_path: Path) -> None:
    job = Job(slides.plugin, slides.out / "calibrated.yaml", slides.recording, tmp_path / "c")
    machine = job.load(job.machine)
    run("codegen", job.machine, "-o", job.out, "--plugin", job.plugin)
    library = compile_library(job.out, [f"{machine.name}_kin.c"], "-O1")
    built = Built(machine, symbolic_model(machine, machine.effects), "double", job.out, library)
    for row in np.array([[0.0, 0.0], [50.0, 150.0], [-80.0, 20.0]]):
        code, pose = built.fk(row)
        assert code == 0
        np.testing.assert_allclose(pose, built.pose(row), rtol=0, atol=1e-9)
        tilt = machine.geometry["tilt"].nominal
        expected = [row[0] + row[1] * np.sin(tilt), 0.0, row[1] * np.cos(tilt)]
        np.testing.assert_allclose(pose[3::4], expected, atol=1e-9)


TRUE_K, ROWS = -1e-4, 60


STRETCHED_BELT = '''
from truepose.models.effects.base import Coefficient, Effect, effects


@effects.add("stretched-belt")
class StretchedBelt(Effect):
    """A belt that runs out of round: dq = k q^3."""

    slug = "stretched-belt"

    def places(self, machine):
        return [(a.reading,) for a in machine.mechanism.actuators if a.unit == "rad"]

    def coefficients(self, machine, place, settings):
        return (Coefficient("k", "1/rad^2", 0.01),)

    def shifts(self, site):
        return {site.port(site.place[0]): site.c["k"] * site.displacement(site.place[0]) ** 3}
'''


@pytest.fixture(scope="module")
def belt(tmp_path_factory: pytest.TempPathFactory) -> Job:
    """A recording of an arm whose second joint truly stands at q + k q^3, diagnosed with the plugin."""
    folder = tmp_path_factory.mktemp("belt")
    job = written(folder, STRETCHED_BELT, TWO_JOINTS)
    machine, rng = load_machine(job.machine), np.random.default_rng(4)
    limits = [a.range for a in machine.mechanism.actuators if a.range is not None]
    q = np.column_stack([rng.uniform(*limit, ROWS) for limit in limits])
    stands = q + np.outer(TRUE_K * q[:, 1] ** 3, [0, 1])
    names = [f"{name} [rad]" for name in machine.mechanism.readings]
    pd.DataFrame(stands, columns=names).to_csv(job.recording, index=False)
    readings = simulate(machine, load_recording(machine, [job.recording], need_observations=False), seed=5)
    pd.concat([pd.DataFrame(q, columns=names), readings], axis=1).to_csv(job.recording, index=False)
    run("diagnose", job.machine, job.recording, "-o", job.out, "--plugin", job.plugin)
    return job


def compiled_poses(job: Job, machine: Machine, q: Array) -> tuple[Array, list[Array]]:
    """``truepose codegen`` with the plugin, compiled: readings and the C's base-to-tool poses (4, 4)."""
    assert COMPILER is not None
    run("codegen", job.machine, "-o", job.out, "--plugin", job.plugin)
    name = machine.name
    flags: Sequence[str] = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "-shared", "-fPIC")
    subprocess.run([COMPILER, *flags, f"{name}_kin.c", "-lm", "-o", "lib.so"], cwd=job.out, check=True)
    forward = getattr(ctypes.CDLL(str(job.out / "lib.so")), f"{name}_fk")
    numbers = ctypes.POINTER(ctypes.c_double)
    poses = []
    for row in q:
        out, inputs = np.zeros(12), np.ascontiguousarray(row)
        code = forward(None, None, inputs.ctypes.data_as(numbers), out.ctypes.data_as(numbers))
        assert code == 0
        poses.append(np.vstack([out.reshape(3, 4), [0, 0, 0, 1]]))
    return q, poses


def modelled_pose(machine: Machine, q: Array) -> Array:
    """The Python model's pose, nominal base to tool, of an open chain with its effects."""
    model = symbolic_model(machine, machine.effects)
    pose = ca.Function("pose", [model.q, model.z, model.p], [model.pose])
    return np.array(pose(q, model.z_home, model.p_home))


@needs_compiler
def test_a_new_effect_is_compiled_into_the_controllers_code(belt: Job, tmp_path: Path) -> None:
    job = Job(belt.plugin, belt.out / "improved.yaml", belt.recording, tmp_path / "c")
    machine = job.load(job.machine)
    rng = np.random.default_rng(6)
    for q, pose in zip(*compiled_poses(job, machine, rng.uniform(-1.8, 1.8, (20, 2))), strict=True):
        np.testing.assert_allclose(pose, modelled_pose(machine, q), rtol=0, atol=1e-9)
        still = modelled_pose(machine.with_effects(()), q)
        assert np.linalg.norm((pose - still)[:3, 3]) > 0.5 * abs(TRUE_K * 500 * q[1] ** 3)


def diagnosis_of(job: Job) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((job.out / "diagnosis.json").read_text())
    return content


def test_a_new_effect_is_screened_everywhere_and_named_where_it_acts(belt: Job) -> None:
    found = diagnosis_of(belt)
    screened = {tuple(c["place"]) for c in found["candidates"] if c["effect"] == "stretched-belt"}
    assert screened == {("q1",), ("q2",)}
    assert found["verdict"] == "missing-physics"
    (finding,) = found["findings"]
    assert (finding["effect"], finding["place"]) == ("stretched-belt", ["q2"])
    assert finding["probability"] > 0.9
    k = finding["parameters"]["k"]
    assert k["unit"] == "1/rad^2"
    assert k["value"] == pytest.approx(TRUE_K, abs=4 * k["std"])
    assert k["std"] < 0.1 * abs(TRUE_K)


def test_a_new_effect_is_part_of_the_improved_machine_and_predicts(belt: Job) -> None:
    machine = belt.load(belt.out / "improved.yaml")
    (placed,) = machine.effects
    assert placed.label == "stretched-belt@q2"
    recording = load_recording(machine, [belt.recording])
    foreseen = predict(machine, recording)
    off = np.concatenate([foreseen[c] - recording.observations[c] for c in ("x", "y", "z")])
    assert np.sqrt(np.mean(off**2)) == pytest.approx(0.02, rel=0.25)
