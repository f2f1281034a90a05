"""A user's own mechanism and sensor go the whole way: calibrated, written back, diagnosed, turned into C."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from support.generated_c import Built, compile_library, needs_compiler
from truepose.cli import app
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
