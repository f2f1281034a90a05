"""The command line as a user meets it: exit codes, one-line errors, whole results or none, JSON alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from support import MACHINES
from support.slide_arm import TINY
from truepose.cli import app
from truepose.errors import ConvergenceError
from truepose.models.load import load_machine

SERIAL = MACHINES / "serial.yaml"


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def refused(result: Result, code: int, says: str) -> None:
    """The exit code, one line on standard error, nothing on standard output, no traceback."""
    assert result.exit_code == code, result.output
    assert result.stdout == ""
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("error: ")
    assert says in lines[0]


@pytest.fixture
def poses(tmp_path: Path) -> Path:
    """Random poses of the serial arm."""
    rng, machine = np.random.default_rng(2), load_machine(SERIAL)
    ranges = {a.reading: a.range for a in machine.mechanism.actuators if a.range is not None}
    data = {f"{name} [{'mm' if name == 'q1' else 'rad'}]": rng.uniform(*r, 30) for name, r in ranges.items()}
    pd.DataFrame(data).to_csv(tmp_path / "poses.csv", index=False)
    return tmp_path / "poses.csv"


@pytest.fixture
def recording(poses: Path, tmp_path: Path) -> Path:
    """A recording of the serial arm as it should be."""
    assert run("simulate", SERIAL, poses, "-o", tmp_path / "recording.csv").exit_code == 0
    return tmp_path / "recording.csv"


@dataclass(frozen=True)
class Diagnosed:
    """A machine of two joints, one joint's scale off by a percent, and what ``diagnose`` made of it."""

    machine: Path
    recording: Path
    output: Path
    result: Result
    diagnosis: Any


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Diagnosed:
    """One diagnosis on the command line, shared by the tests."""
    from truepose.identification.diagnosis import diagnose as engine

    folder = tmp_path_factory.mktemp("tiny")
    machine, grid, recording = folder / "tiny.yaml", folder / "grid.csv", folder / "tiny.csv"
    machine.write_text(TINY, encoding="utf-8")
    q1, q2 = np.meshgrid(np.linspace(-100, 100, 5), np.linspace(-90, 90, 6))
    pd.DataFrame({"q1": q1.ravel(), "q2": q2.ravel()}).to_csv(grid, index=False)
    made = run("simulate", machine, grid, "-o", recording, "--effect", "actuator-scale@q1:s=0.01")
    assert made.exit_code == 0, made.output
    kept: list[Any] = []
    diagnose = engine.diagnose

    def keeping(*arguments: Any, **options: Any) -> Any:
        kept.append(diagnose(*arguments, **options))
        return kept[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, "diagnose", keeping)
        result = run("diagnose", machine, recording, "-o", folder / "out", "--json")
    return Diagnosed(machine, recording, folder / "out", result, kept[-1] if kept else None)


def test_calibrate_writes_three_files(recording: Path, tmp_path: Path) -> None:
    result = run("calibrate", SERIAL, recording, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    names = sorted(file.name for file in (tmp_path / "out").iterdir())
    assert names == ["calibrated.yaml", "fit.json", "report.html"]
    fit = json.loads((tmp_path / "out" / "fit.json").read_text(encoding="utf-8"))
    assert fit["status"] == "converged" and 0.5 < fit["chi2_per_dof"] < 1.5
    assert fit["rank"] < fit["free_parameters"]
    meanings = [direction["meaning"] for direction in fit["unseen"]]
    assert "moving base.z together with q1.r is not seen; tolerances decided" in meanings
    held = fit["parameters"]["q1.r"]
    assert held["unit"] == "mm" and held["nominal"] == 100.0 and held["identifiable"] is False
    assert fit["parameters"]["q3.d"]["identifiable"] is True
    assert fit["free"]["chi2_per_dof"] > 0


def test_calibrate_prints_json_and_nothing_else(recording: Path, tmp_path: Path) -> None:
    result = run("calibrate", SERIAL, recording, "-o", tmp_path / "out", "--json")
    summary = json.loads(result.stdout)
    assert summary["command"] == "calibrate" and len(summary["files"]) == 3
    assert result.stderr == ""


@pytest.mark.parametrize("estimator", ["map", "ols", "huber"])
@pytest.mark.parametrize("solver", ["gn", "lm"])
def test_estimators_and_solvers(estimator: str, solver: str, recording: Path, tmp_path: Path) -> None:
    options = ("--estimator", estimator, "--solver", solver, "--json")
    result = run("calibrate", SERIAL, recording, "-o", tmp_path / "out", *options)
    assert result.exit_code == 0, result.output
    assert 0.5 < json.loads(result.stdout)["chi2_per_dof"] < 1.5


@pytest.mark.parametrize(("option", "name"), [("--estimator", "lasso"), ("--solver", "simplex")])
def test_an_unknown_method_is_told(option: str, name: str, recording: Path, tmp_path: Path) -> None:
    refused(run("calibrate", SERIAL, recording, "-o", tmp_path / "out", option, name), 2, "expected one of")
    assert not (tmp_path / "out").exists()


def test_the_same_input_gives_the_same_bytes(recording: Path, tmp_path: Path) -> None:
    for name in ("one", "two"):
        assert run("calibrate", SERIAL, recording, "-o", tmp_path / name).exit_code == 0
    for file in ("calibrated.yaml", "fit.json"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


def test_diagnose_writes_three_files_and_names_the_cause(tiny: Diagnosed, tmp_path: Path) -> None:
    assert tiny.result.exit_code == 0, tiny.result.output
    assert json.loads(tiny.result.stdout)["verdict"] in {"missing-physics", "unknown"}
    names = sorted(file.name for file in tiny.output.iterdir())
    assert names == ["diagnosis.json", "improved.yaml", "report.html"]
    text = (tiny.output / "diagnosis.json").read_text(encoding="utf-8")
    diagnosis = json.loads(text, parse_constant=_no_constant)
    assert set(diagnosis["parameters"]) == {p.name for p in load_machine(tiny.machine).parameters if p.free}
    named = [f["effect"] for f in diagnosis["findings"]]
    assert "actuator-scale" in named or diagnosis["verdict"] == "unknown"
    improved = run("predict", tiny.output / "improved.yaml", tiny.recording, "-o", tmp_path / "predicted.csv")
    assert improved.exit_code == 0, improved.output


def _no_constant(name: str) -> None:
    raise AssertionError(f"{name} in JSON")


def test_demo_tells_the_truth_that_the_diagnosis_never_saw(
    tiny: Diagnosed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from truepose.identification.diagnosis import diagnose as engine

    seen: dict[str, Any] = {}

    def diagnose(machine: Any, recording: Any, **_: Any) -> Any:
        seen.update(name=machine.name, rows=len(recording))
        return tiny.diagnosis

    monkeypatch.setattr(engine, "diagnose", diagnose)
    monkeypatch.chdir(tmp_path)
    done = run("demo")
    assert done.exit_code == 0, done.output
    assert seen["name"] == "telescope" and seen["rows"] > 40
    assert "simulated with: platform-deformation at platform" in done.stdout
    assert "platform-deformation" not in (tmp_path / "truepose-demo" / "diagnosis.json").read_text("utf-8")


def test_predict_and_simulate_write_tables(poses: Path, tmp_path: Path) -> None:
    for name in ("out.csv", "out.parquet"):
        assert run("simulate", SERIAL, poses, "-o", tmp_path / name, "--seed", 3).exit_code == 0
        result = run("predict", SERIAL, tmp_path / name, "-o", tmp_path / f"predicted-{name}", "--json")
        summary = json.loads(result.stdout)
        assert summary["rows"] == 30 and summary["columns"][:2] == ["x", "x.std"]
    csv = pd.read_csv(tmp_path / "predicted-out.csv")
    pd.testing.assert_frame_equal(csv, pd.read_parquet(tmp_path / "predicted-out.parquet"))


def test_codegen_keeps_the_drawing_for_compensation(recording: Path, tmp_path: Path) -> None:
    assert run("calibrate", SERIAL, recording, "-o", tmp_path / "fit").exit_code == 0
    result = run("codegen", tmp_path / "fit" / "calibrated.yaml", "-o", tmp_path / "c", "--json")
    assert result.exit_code == 0, result.output
    assert {Path(file).name for file in json.loads(result.stdout)["files"]} >= {"arm_kin.c", "arm_kin.h"}
    refused(run("codegen", SERIAL, "-o", tmp_path / "d", "--real", "half"), 2, "'double' or 'float'")


def test_effects_lists_and_tells() -> None:
    entries = json.loads(run("effects", "--json").stdout)["effects"]
    assert {"actuator-scale", "outliers"} <= {entry["effect"] for entry in entries}
    told = run("effects", "backlash").stdout
    assert all(word in told for word in ("formula", "size", "looks like", "told apart by", "source"))
    refused(run("effects", "backlas"), 2, "did you mean backlash")


BAD: dict[str, Callable[[Path], tuple[object, ...]]] = {
    "no such machine": lambda d: ("calibrate", d / "none.yaml", d / "recording.csv", "-o", d / "out"),
    "no such recording": lambda d: ("calibrate", SERIAL, d / "none.csv", "-o", d / "out"),
    "poses are no recording": lambda d: ("calibrate", SERIAL, d / "poses.csv", "-o", d / "out"),
    "diagnose without readings": lambda d: ("diagnose", SERIAL, d / "poses.csv", "-o", d / "out"),
    "output is a file": lambda d: ("calibrate", SERIAL, d / "recording.csv", "-o", d / "poses.csv"),
    "output below a file": lambda d: ("diagnose", SERIAL, d / "recording.csv", "-o", d / "poses.csv" / "x"),
    "table is a directory": lambda d: ("predict", SERIAL, d / "recording.csv", "-o", d),
    "no directory": lambda d: ("predict", SERIAL, d / "recording.csv", "-o", d / "no" / "x.csv"),
    "unknown effect": lambda d: (
        "simulate",
        SERIAL,
        d / "poses.csv",
        "-o",
        d / "x.csv",
        "--effect",
        "a@b:c=1",
    ),
    "no plugin": lambda d: ("effects", "--plugin", d / "none.py"),
    "unknown demo": lambda d: ("demo", "teapot", "-o", d / "out"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_leaves_nothing(case: str, recording: Path, tmp_path: Path) -> None:
    before = sorted(tmp_path.rglob("*"))
    refused(run(*BAD[case](tmp_path)), 2, "")
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("command", ["calibrate", "diagnose"])
def test_a_fit_without_a_minimum_names_parameters_and_leaves_nothing(
    command: str, recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The iteration limit is put below what the fit needs."""
    from truepose.identification.fit import estimate, leastsquares

    minimise = leastsquares.minimise

    def hurried(*arguments: Any, **options: Any) -> leastsquares.Solution:
        return minimise(*arguments, **{**options, "limit": 1, "tolerance": 0.0})

    monkeypatch.setattr(estimate, "minimise", hurried)
    before = sorted(tmp_path.rglob("*"))
    result = run(command, SERIAL, recording, "-o", tmp_path / "out", "--json")
    refused(result, 3, "did not converge")
    assert any(p.name in result.stderr for p in load_machine(SERIAL).parameters)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_failure_while_writing_leaves_nothing(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any) -> str:
        raise ConvergenceError("late\nand long")

    monkeypatch.setattr("truepose.identification.report.files.page", fails)
    before = sorted(tmp_path.rglob("*"))
    refused(run("calibrate", SERIAL, recording, "-o", tmp_path / "out"), 3, "late and long")
    assert sorted(tmp_path.rglob("*")) == before


def test_a_plugin_brings_an_effect_of_its_own(poses: Path, tmp_path: Path) -> None:
    plugin = tmp_path / "mine.py"
    plugin.write_text(PLUGIN, encoding="utf-8")
    listed = run("effects", "my-creep", "--plugin", plugin)
    assert listed.exit_code == 0 and "Creeping slide" in listed.stdout
    options = ("--plugin", plugin, "--effect", "my-creep@q1:c=0.5[mm]")
    assert run("simulate", SERIAL, poses, "-o", tmp_path / "x.csv", *options).exit_code == 0
    plugin.write_text("1 / 0", encoding="utf-8")
    refused(run("effects", "--plugin", plugin), 2, "ZeroDivisionError")


PLUGIN = """
from truepose.models.effects.base import Coefficient, Effect, effects


@effects.add("my-creep")
class Creep(Effect):
    slug = "my-creep"
    title = "Creeping slide"

    def places(self, machine):
        return [("q1",)]

    def coefficients(self, machine, place, settings):
        return (Coefficient("c", "mm", 1.0),)

    def shifts(self, site):
        return {site.port("q1"): site.c["c"]}
"""
