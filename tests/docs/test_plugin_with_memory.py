"""The documentation's plug-in with memory goes the whole way: named, predicted, and an input of the C."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from support import ROOT
from support.simulated import readings_of
from support.two_joints import TWO_JOINTS
from truepose.cli import app
from truepose.identification.prediction.predict import predict, simulate
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.registry import load_plugin

TRUE_K, ROWS = 0.8, 80


@dataclass(frozen=True)
class Job:
    """The plug-in as documented, a machine, what was recorded and what ``diagnose`` wrote."""

    plugin: Path
    recording: Path
    out: Path


def run(*arguments: object) -> None:
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    assert result.exit_code == 0, result.output


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Job:
    folder = tmp_path_factory.mktemp("cable")
    text = (ROOT / "docs" / "reference" / "architecture.md").read_text(encoding="utf-8")
    (code,) = [
        block for block in re.findall(r"```python\n(.*?)```", text, flags=re.S) if "cable-drag" in block
    ]
    made = Job(folder / "cable.py", folder / "recording.csv", folder / "out")
    made.plugin.write_text(code)
    (folder / "machine.yaml").write_text(TWO_JOINTS)
    load_plugin(made.plugin)
    machine = load_machine(folder / "machine.yaml")
    written(machine, made.recording, seed=4)
    run("diagnose", folder / "machine.yaml", made.recording, "-o", made.out, "--plugin", made.plugin)
    return made


def written(machine: Machine, path: Path, seed: int) -> Recording:
    """Readings of a walk of both joints in small and large steps, the tool dragged by a cable at q1."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0, 1, (ROWS, 2)) * np.where(rng.random((ROWS, 2)) < 0.5, 0.15, 1.5)
    way = np.abs((np.cumsum(steps, axis=0) + 1.8) % 7.2 - 3.6) - 1.8  # it turns back at 1.8 rad
    frame = pd.DataFrame(way, columns=["q1 [rad]", "q2 [rad]"])
    cable = PlacedEffect.at(effects.get("cable-drag", "test")(), machine, ("q1",), None, {"k": TRUE_K})
    readings_of(machine, frame, cable, seed=seed).to_csv(path, index=False)
    return load_recording(machine, [path])


def test_an_effect_with_memory_is_named_where_it_acts(job: Job) -> None:
    found = json.loads((job.out / "diagnosis.json").read_text())
    screened = {tuple(c["place"]) for c in found["candidates"] if c["effect"] == "cable-drag"}
    assert screened == {("q1",), ("q2",)} and found["verdict"] == "missing-physics"
    assert "cable-drag" in (job.out / "report.html").read_text()
    (finding,) = found["findings"]
    assert (finding["effect"], finding["place"]) == ("cable-drag", ["q1"])
    k = finding["parameters"]["k"]
    assert k["value"] == pytest.approx(TRUE_K, abs=4 * k["std"])
    assert k["std"] < 0.1 * TRUE_K


def test_its_memory_predicts_another_recording(job: Job, tmp_path: Path) -> None:
    """Rows it never saw, in any order: the sensor's own noise is left."""
    improved = load_machine(job.out / "improved.yaml")
    other = written(improved.with_effects(()), tmp_path / "other.csv", seed=9)
    foreseen = predict(improved, other)
    off = np.concatenate([foreseen[c] - other.observations[c] for c in ("x", "y", "z")])
    assert np.sqrt(np.mean(off**2)) == pytest.approx(0.02, rel=0.25)
    blind = simulate(improved.with_effects(()), other, seed=None)
    worse = np.concatenate([blind[c] - other.observations[c] for c in ("x", "y", "z")])
    assert np.sqrt(np.mean(worse**2)) > 0.1


def test_memory_is_an_input_of_the_controllers_code(job: Job, tmp_path: Path) -> None:
    run("codegen", job.out / "improved.yaml", "-o", tmp_path, "--plugin", job.plugin)
    assert "_Z_stop_q1_0_4" in (tmp_path / "arm_kin.h").read_text()
