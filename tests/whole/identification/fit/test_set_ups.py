"""What a fit owes recordings between which base and tool were set up anew: stated, or as another campaign of a known arm.

Recordings come from ``support.drifting_arm``, a forward model in numpy apart from the library's.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from support.drifting_arm import write_sequence
from truepose.cli import app
from truepose.errors import InputError
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.fit.calibrate import Calibration, calibrate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.leaves.check.run import check_loaded
from truepose.identification.leaves.drift.analysis import drift
from truepose.identification.prediction.covariance import Covariance
from truepose.identification.prediction.predict import predict, unknown_frames
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

DEG = np.pi / 180.0
FAR: Mapping[str, Sequence[float]] = {
    "base.x": [0, 3000, -1500],
    "base.y": [0, -800, 2000],
    "base.rx": [0, 20 * DEG, 5 * DEG],
    "base.rz": [0, 170 * DEG, -75 * DEG],
    "tool.x": [0, 20, -10],
    "tool.z": [0, -15, 5],
    "tool.ry": [0, 5 * DEG, -3 * DEG],
}
"""A tracker put down elsewhere and a tool taken off, mm and rad."""
BASE = "base: {tolerance: {xyz: .inf, rpy: .inf}%s}"
TOOL = "tolerance: {xyz: 10, rpy: 5}%s"
SURE = 5.0
"""Sigmas of the farthest of some 30 constants: beyond 5, once in a hundred thousand."""


@dataclass(frozen=True)
class Campaign:
    """A machine file, the files of its sessions, and what was changed."""

    path: Path
    files: list[Path]

    @property
    def machine(self) -> Machine:
        return load_machine(self.path)

    def rows(self, *which: int) -> Recording:
        return load_recording(self.machine, [self.files[k] for k in which] or self.files)


def campaign(folder: Path, *, stated: bool = True, n: int = 30) -> Campaign:
    """Three sessions of one arm; where ``stated``, the file says that base and tool are set up anew."""
    path, files = write_sequence(folder, 1, FAR, sessions=3, every=None, n=n)
    per = ", per: session" if stated else ""
    text = path.read_text(encoding="utf-8")
    text = re.sub(r"base: \{tolerance.*\}\}", BASE % per, text)
    text = re.sub(r"(tool: .*)tolerance: \{[^}]*\}", rf"\g<1>{TOOL % per}", text)
    path.write_text(text, encoding="utf-8")
    return Campaign(path, files)


def standing(found: Calibration, session: int) -> dict[str, tuple[float, float]]:
    """By how much each frame's constant changed at a boundary (mm, rad), and its 1-sigma."""
    ends = f",session={session}:"
    every = zip(found.fit.prior.names, found.fit.p, found.fit.std, strict=True)
    named = [(name, float(value), float(std)) for name, value, std in every if ends in name]
    return {
        f"{name.partition('@')[2].partition(',')[0]}.{name.rpartition(':')[2]}": (value, std)
        for name, value, std in named
    }


def test_frames_set_up_anew_are_found_wherever_they_are(tmp_path: Path) -> None:
    one = campaign(tmp_path)
    found = calibrate(one.machine, one.rows())
    assert found.judgement.calibrated
    assert 0.8 < found.fit.chi2_per_dof < 1.2  # 450 readings less 49 constants: 0.07
    for boundary in (1, 2):
        told = standing(found, boundary)
        assert len(told) == 12
        for name, (value, std) in told.items():
            moves = FAR.get(name, (0.0, 0.0, 0.0))
            away = value - (moves[boundary] - moves[boundary - 1])
            if name.partition(".")[2].startswith("r"):
                away = (away + np.pi) % (2 * np.pi) - np.pi
            assert abs(away) < SURE * std, name


@pytest.mark.nightly
def test_what_is_stated_is_no_finding_and_no_movement(tmp_path: Path) -> None:
    one = campaign(tmp_path)
    assert check_loaded(one.machine, one.rows()).verdict == "ok"
    said = diagnose(one.machine, one.rows())
    assert said.verdict == "adequate"
    assert not said.findings
    moved = drift(one.machine, one.rows())
    assert not moved.moved
    assert {m.name for m in moved.movements if m.status == "anew"} == {
        f"{frame}.{axis}" for frame in ("base", "tool") for axis in ("x", "y", "z", "rx", "ry", "rz")
    }
    assert moved.noise == pytest.approx(1.0, abs=0.1)
    assert all(check is not None and check.holds for check in moved.durability.carried)


def test_a_session_that_the_fit_has_not_seen_is_said_to_stand_anywhere(tmp_path: Path) -> None:
    one = campaign(tmp_path)
    for k, file in enumerate(one.files):
        pd.read_csv(file).assign(session=k + 1).to_csv(file, index=False)
    fit = calibrate(one.machine, one.rows(0, 1))
    write_calibrated(tmp_path / "calibrated.yaml", fit.fit, fit.recording)
    known = load_machine(tmp_path / "calibrated.yaml")
    for seen in (0, 1):
        rows = load_recording(known, [one.files[seen]])
        assert not unknown_frames(known, rows)
        off = predict(known, rows)["x"].to_numpy() - rows.observations["x"]
        assert np.std(off) < 0.1  # of a sigma of 0.02 mm; the sessions stand metres apart
    (note,) = unknown_frames(known, load_recording(known, [one.files[2]]))
    assert "session 3 was not in the fit" in note and "--only base,tool" in note


def test_only_frames_are_fitted_and_all_else_stays(tmp_path: Path) -> None:
    one = campaign(tmp_path, stated=False)
    known = calibrate(one.machine, one.rows(0))
    write_calibrated(tmp_path / "one.yaml", known.fit, known.recording)
    first = load_machine(tmp_path / "one.yaml")
    found = calibrate(first, load_recording(first, [one.files[1]]), only=("base", "tool"))
    write_calibrated(tmp_path / "two.yaml", found.fit, found.recording, kept=found.kept)
    second = load_machine(tmp_path / "two.yaml")
    mine, others = second.geometry, first.geometry
    held = [name for name in mine if not name.startswith(("base.", "tool."))]
    for name in held:  # written in deg, read in rad
        assert mine[name].nominal == pytest.approx(others[name].nominal, rel=1e-14, abs=1e-300), name
    assert mine["base.x"].nominal - others["base.x"].nominal == pytest.approx(3000.0, abs=0.2)
    assert mine["tool.ry"].nominal - others["tool.ry"].nominal == pytest.approx(5 * DEG, abs=1e-3)
    # the held constants' own errors show in the readings: more than the noise, less than twice as much
    assert 0.8 < found.fit.chi2_per_dof < 3.0
    assert first.file is not None and second.file is not None
    before, after = (Covariance.read(m.file.covariance or {}, "") for m in (first, second) if m.file)
    assert set(before.names) == set(after.names)
    at = "q2.theta"
    rows = [known.factor[known.names.index(at)] for known in (before, after)]
    assert np.linalg.norm(rows[0]) == pytest.approx(np.linalg.norm(rows[1]), rel=1e-9)
    assert second.file.nominal == pytest.approx(first.file.nominal)


def test_the_command_says_what_it_held_and_refuses_what_there_is_not(tmp_path: Path) -> None:
    one = campaign(tmp_path, stated=False)
    run = CliRunner()
    arm, rows = str(one.path), str(one.files[0])
    done = run.invoke(app, ["calibrate", arm, rows, "--only", "base, tool", "-o", str(tmp_path / "out")])
    assert done.exit_code == 0
    assert "held as the machine file has it: all but base, tool" in done.output
    assert "with the machine file" in done.output
    for name, said in (("bse", "did you mean 'base'"), ("q1.r", "exactly known")):
        refused = run.invoke(app, ["calibrate", arm, rows, "--only", name, "-o", str(tmp_path / "no")])
        assert refused.exit_code == 2
        assert said in refused.output


def test_effects_are_held_with_their_values(tmp_path: Path) -> None:
    """An effect of the file is neither refitted nor dropped, and a zero that moved stays where it was last."""
    one = campaign(tmp_path, stated=False)
    stated = (
        "effects:\n"
        "  - {effect: actuator-scale, place: [q2], parameters: {s: 1e-3}}\n"
        "  - {effect: zero-shift, place: [q3], session: 1, parameters: {zero: {value: 2e-3, unit: rad}}}\n"
        "  - {effect: zero-shift, place: [q3], session: 2, parameters: {zero: {value: 1e-3, unit: rad}}}\n"
        "  - {effect: frame-shift, place: [base], session: 1, parameters: "
        "{x: {value: 1, unit: mm}}}\n"
    )
    one.path.write_text(one.path.read_text(encoding="utf-8") + stated, encoding="utf-8")
    found = calibrate(one.machine, one.rows(0), only=("base", "tool"))
    told = {effect.label: dict(effect.values) for effect in found.fit.fitted_effects()}
    assert told == {
        "actuator-scale@q2": {"s": 1e-3},
        "zero-shift@q3,session=0": {"zero": pytest.approx(3e-3)},
    }


def test_a_frame_that_is_exactly_known_cannot_be_found(tmp_path: Path) -> None:
    one = campaign(tmp_path, stated=False)
    text = one.path.read_text(encoding="utf-8")
    one.path.write_text(re.sub(r"base: \{tolerance.*\}\}", "base: {}", text), encoding="utf-8")
    with pytest.raises(InputError, match=r"base.*exactly known"):
        calibrate(one.machine, one.rows(0), only=("base",))


@pytest.mark.nightly
def test_a_mount_taken_off_without_a_word_is_named(tmp_path: Path) -> None:
    """20 mm and 5 deg between two files, base and tool: far beyond any small motion."""
    moves = {
        name: (0.0, value) for name, value in (("base.x", 20.0), ("base.rz", 5 * DEG), ("tool.z", -20.0))
    }
    moves["tool.ry"] = (0.0, 5 * DEG)
    path, files = write_sequence(tmp_path, 3, moves, sessions=2, every=None, n=40)
    machine = load_machine(path)
    found = diagnose(machine, load_recording(machine, files))
    assert {(f.effect, f.place) for f in found.findings} == {
        ("frame-shift", ("base",)),
        ("frame-shift", ("tool",)),
    }
    assert min(f.probability for f in found.findings) > 0.9
    turned = next(f for f in found.findings if f.place == ("tool",)).parameters["ry"]
    assert turned.value == pytest.approx(5 * DEG, abs=5 * turned.std)
    assert 0.8 < found.fits["after"].chi2_per_dof < 1.2


def test_a_zero_that_moved_is_found_beside_frames_set_up_anew(tmp_path: Path) -> None:
    slipped = {**FAR, "q3.theta": [0.0, 0.0, 1e-3]}
    path, files = write_sequence(tmp_path / "slipped", 1, slipped, sessions=3, every=None, n=30)
    path.write_text(campaign(tmp_path / "as").path.read_text(encoding="utf-8"), encoding="utf-8")
    machine = load_machine(path)
    found = drift(machine, load_recording(machine, files))
    assert [m.name for m in found.moved] == ["q3.theta"]


def test_each_session_alone_leaves_the_same_frames(tmp_path: Path) -> None:
    """Together they know the arm better; where a frame stood agrees within what each knows."""
    one = campaign(tmp_path)
    whole = calibrate(one.machine, one.rows()).fit
    first = calibrate(one.machine, one.rows(0)).fit
    base = [k for k, name in enumerate(first.prior.names) if name.startswith("base.")]
    assert np.all(np.abs(whole.p[base] - first.p[base]) < SURE * first.std[base])
    spread = [
        np.diag(fit.posterior)[[fit.prior.free.tolist().index(k) for k in base]] for fit in (whole, first)
    ]
    assert np.all(spread[0] <= spread[1] * (1 + 1e-9))  # at the noise stated: more rows never know less


def test_the_order_of_files_changes_no_residual(tmp_path: Path) -> None:
    one = campaign(tmp_path)
    a = calibrate(one.machine, one.rows(0, 1, 2)).fit
    b = calibrate(one.machine, one.rows(2, 0, 1)).fit
    # the difference between set-ups is a chain of steps of finite tolerance, which is not the same chain in another order
    assert a.chi2 == pytest.approx(b.chi2, rel=1e-4)
