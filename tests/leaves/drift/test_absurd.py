"""Nothing absurd is called calibrated: first words, JSON, files, exit code; and ordinary fits pass."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import truepose
from support.command import invoke, refused, run
from support.examples import examples
from support.machine_texts import machine_from
from truepose.identification.diagnosis.null_fits import far_rows
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.fit.estimate import estimate, wrapped
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.summary import GROSS, judged, judged_diagnosis
from truepose.identification.prediction.predict import simulate
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.effect_text import parse_effect
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Mechanism

ARM = """
schema: truepose/machine/1
name: arm
tolerances: {length: 0.1, angle: 0.05}
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: 90, d: 50, range: [-100, 100]}
    - {name: q3, kind: revolute, d: 300, range: [-100, 100]}
frames:
  base: {in: world, xyz: [100, 50, 0], rpy: [0, 0, 30], tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [250, 0, 40], tolerance: {xyz: 0.5, rpy: 0}}
sensor: {type: position, sigma: {xyz: 0.02}}
"""
ROWS = 40
FORGOTTEN = ARM.replace(
    "  base: {in: world, xyz: [100, 50, 0], rpy: [0, 0, 30], tolerance: {xyz: 5, rpy: 1}}\n", ""
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The arm's file, the same without its base, and readings of an arm whose q2 has another scale; some with typing errors."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.yaml").write_text(ARM, encoding="utf-8")
    (folder / "forgotten.yaml").write_text(FORGOTTEN, encoding="utf-8")
    rng = np.random.default_rng(4)
    table = pd.DataFrame(
        rng.uniform(-1, 1, (ROWS, 3)) * [160, 90, 90], columns=["q1 [deg]", "q2 [deg]", "q3 [deg]"]
    )
    table.to_csv(folder / "poses.csv", index=False)
    machine = truepose.load_machine(folder / "arm.yaml")
    poses = load_recording(machine, [folder / "poses.csv"], need_observations=False)
    read = simulate(machine, poses, [parse_effect("actuator-scale@q2:s=0.002", machine)], seed=2)
    rows = pd.concat([table, read.reset_index(drop=True)], axis=1)
    rows.to_csv(folder / "rows.csv", index=False)
    far = rows.copy()
    far["x"] += np.where(far.index == 11, 3.0, 0.0)
    far["z"] -= np.where(far.index == 29, 5.0, 0.0)
    far.to_csv(folder / "far.csv", index=False)
    return folder


def test_a_fit_of_another_machine_is_no_calibration(folder: Path, tmp_path: Path) -> None:
    """Without its base the arm cannot be where it was measured; all says so, and nothing applies the file."""
    arguments = ("calibrate", folder / "forgotten.yaml", folder / "rows.csv", "-o", tmp_path / "out")
    refused(*arguments, said="base-missing")
    assert not (tmp_path / "out").exists()
    result = invoke(*arguments, "--anyway")
    assert result.exit_code == 2, result.output
    assert result.stdout.startswith("WRONG: base-missing: ") and "\nNOT CALIBRATED: " in result.stdout
    assert "not calibrated" in result.stderr
    fit = json.loads((tmp_path / "out" / "fit.json").read_text(encoding="utf-8"))
    assert fit["judgement"]["calibrated"] is False and fit["judgement"]["why"]
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "NOT CALIBRATED" in page and "is calibrated" not in page
    file = tmp_path / "out" / "calibrated.yaml"
    assert file.read_text(encoding="utf-8").startswith("# NOT CALIBRATED: ")
    for command in (
        ("codegen", file, "-o", tmp_path / "c"),
        ("compensate", file, folder / "poses.csv", "-o", tmp_path / "p.csv"),
    ):
        refused(*command, said="NOT CALIBRATED")
        assert "NOT CALIBRATED" not in invoke(*command, "--anyway").stderr
    again = invoke(*arguments, "--anyway", "--json")
    assert json.loads(again.stdout)["judgement"] == fit["judgement"] and again.exit_code == 2
    assert again.stderr.startswith("error: NOT CALIBRATED: ") and len(again.stderr.splitlines()) == 1


@pytest.mark.parametrize("command", ["calibrate", "diagnose", "drift"])
def test_every_command_that_fits_refuses_files_that_do_not_belong_together(
    command: str, folder: Path, tmp_path: Path
) -> None:
    files = (folder / "forgotten.yaml", folder / "rows.csv", "-o", tmp_path / "out")
    assert "--anyway" in refused(command, *files, said="base-missing")
    assert not (tmp_path / "out").exists()


def test_a_base_that_was_mounted_again_is_drift_and_no_mistake(folder: Path, tmp_path: Path) -> None:
    """The gate says it and goes on where another file begins: ``drift`` is there to find it."""
    later = pd.read_csv(folder / "rows.csv").assign(x=lambda rows: rows["x"] + 300.0)
    later.to_csv(tmp_path / "later.csv", index=False)
    files = (folder / "arm.yaml", folder / "rows.csv", tmp_path / "later.csv")
    result = run("drift", *files)
    assert "base.x" in result.stdout
    assert result.stdout.startswith("SUSPECT: sessions-mixed: ")


def test_physics_left_out_is_no_absurdity(folder: Path, tmp_path: Path) -> None:
    """A joint's scale off by 0.2 percent: far beyond sigma and tolerances, and still this machine."""
    run("calibrate", folder / "arm.yaml", folder / "rows.csv", "-o", tmp_path / "out")
    fit = json.loads((tmp_path / "out" / "fit.json").read_text(encoding="utf-8"))
    assert fit["judgement"] == {"calibrated": True, "why": []} and fit["chi2_per_dof"] > 30
    file = tmp_path / "out" / "calibrated.yaml"
    assert "judgement" not in file.read_text(encoding="utf-8")
    assert truepose.load_machine(file).file.refused == ()  # type: ignore[union-attr]


def test_a_refused_file_that_is_calibrated_anew_is_free(folder: Path, tmp_path: Path) -> None:
    text = f"{ARM}judgement: {{calibrated: false, why: [it left its drawing]}}\n"
    machine = machine_from(tmp_path, text, "refused")
    assert machine.file is not None and machine.file.refused == ("it left its drawing",)
    run("calibrate", tmp_path / "refused.yaml", folder / "rows.csv", "-o", tmp_path / "out")
    assert "judgement" not in (tmp_path / "out" / "calibrated.yaml").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def fitted(folder: Path) -> tuple[Machine, Recording, Estimate]:
    machine = truepose.load_machine(folder / "arm.yaml")
    recording = truepose.load_recording(machine, [folder / "rows.csv"])
    return machine, recording, estimate(machine, recording)


@given(st.floats(0.0, 3.0), st.sampled_from(["q3.d", "q2.alpha", "tool.x", "base.x"]))
@settings(max_examples=examples(20))
def test_constants_are_judged_by_their_tolerances_and_frames_are_not(
    fitted: tuple[Machine, Recording, Estimate], decades: float, name: str
) -> None:
    machine, _, fit = fitted
    k = fit.prior.names.index(name)
    p, away = fit.p.copy(), 10.0**decades
    p[k] = machine.parameters[k].nominal + away * machine.parameters[k].tolerance
    gross = away > GROSS and not name.startswith(("tool", "base"))
    found = judged(replace(fit, p=p))
    assert found.calibrated is not gross
    assert [n for n, _ in found.departures] == ([name] if gross else [])


@given(st.floats(0.0, 4.0))
@settings(max_examples=examples(20))
def test_a_misfit_is_absurd_only_beyond_sigma_and_beyond_what_tolerances_make(
    fitted: tuple[Machine, Recording, Estimate], decades: float
) -> None:
    """Residuals scaled: both limits must be passed; where tolerances are a hundred times wider, later."""
    _, _, fit = fitted
    large = replace(fit, residual=fit.residual * 10.0**decades / np.sqrt(fit.chi2_per_dof))
    wide = replace(large, nominal=replace(fit.nominal, mechanism=_wider(fit.nominal)))
    strict, lenient = judged(large).misfit, judged(wide).misfit
    assert strict is None or large.chi2_per_dof > GROSS**2
    assert lenient is None or strict is not None
    if strict is not None:
        assert strict.sigmas > strict.expected and strict.rms["position"][1] == "mm"


def test_what_tolerances_allow_does_not_hang_on_the_steps_in_which_constants_are_counted(
    fitted: tuple[Machine, Recording, Estimate],
) -> None:
    """Nor is it anything but the sum over constants, each by its tolerance."""
    _, _, fit = fitted
    large = replace(fit, residual=fit.residual * 1e6)
    told = judged(large).misfit
    assert told is not None
    steps, scale = 2.0 ** np.arange(-2, len(fit.prior.free) - 2), fit.prior.scale.copy()
    scale[fit.prior.free] *= steps
    factor = np.hstack([fit.factor[:, :-1] * steps, fit.factor[:, -1:]])
    other = judged(replace(large, prior=replace(fit.prior, scale=scale), factor=factor)).misfit
    assert other is not None and other.expected == pytest.approx(told.expected, rel=1e-9)


def _wider(machine: Machine) -> Mechanism:
    wide = tuple(replace(p, tolerance=100 * p.tolerance) for p in machine.mechanism.parameters)
    return replace(machine.mechanism, parameters=wide)


def test_a_diagnosis_is_judged_by_what_it_ends_with_unless_what_it_found_explains_all(
    fitted: tuple[Machine, Recording, Estimate],
) -> None:
    _, _, fit = fitted
    bad = replace(fit, residual=fit.residual * 1e5)
    assert judged_diagnosis(fit, fit, named=False).calibrated
    assert not judged_diagnosis(bad, bad, named=True).calibrated
    assert judged_diagnosis(bad, fit, named=True).calibrated
    assert not judged_diagnosis(bad, fit, named=False).calibrated


@given(st.integers(-3, 3), st.floats(-3.1, 3.1))
@settings(max_examples=examples(20))
def test_angles_come_out_within_half_a_turn_of_their_drawing(
    fitted: tuple[Machine, Recording, Estimate], turns: int, away: float
) -> None:
    """Whole turns change no reading; lengths are left alone."""
    machine, _, fit = fitted
    k, length = fit.prior.names.index("q2.theta"), fit.prior.names.index("q3.d")
    p = fit.p.copy()
    p[k] = machine.parameters[k].nominal + away + 2 * np.pi * turns
    p[length] += 100.0
    out = wrapped(machine, p)
    assert out[k] == pytest.approx(machine.parameters[k].nominal + away, abs=1e-12)
    assert np.delete(out, k).tolist() == np.delete(p, k).tolist()


def test_rows_that_are_out_are_named_before_the_model_is_suspected(folder: Path, tmp_path: Path) -> None:
    """Two typing errors in forty rows, beside physics that is missing."""
    machine = truepose.load_machine(folder / "arm.yaml")
    clean = truepose.load_recording(machine, [folder / "rows.csv"])
    assert far_rows(calibrate(machine, clean)) == ()
    result = invoke("calibrate", folder / "arm.yaml", folder / "far.csv", "-o", tmp_path / "out")
    assert "rows 12, 30 of far.csv do not fit" in result.stdout
    fit = json.loads((tmp_path / "out" / "fit.json").read_text(encoding="utf-8"))
    assert sorted(row["row"] for row in fit["rows_that_do_not_fit"]) == [12, 30]
    assert all(row["sigma"] > 10 for row in fit["rows_that_do_not_fit"])
    assert "rows 12, 30 of far.csv do not fit" in (tmp_path / "out" / "report.html").read_text(
        encoding="utf-8"
    )
