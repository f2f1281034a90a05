"""The studies of real recordings, on folders of the same shape that hold a small arm of two joints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from real_data import lines
from real_recordings.campaigns import agreement
from real_recordings.prepared import prepared

import truepose
from support.tiny_fleets import MACHINE
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

GEAR = 1e-3
"""Amplitude of the wave, rad: 0.4 mm at the tool, where the tracker's sigma is 0.01 mm."""


def table(seed: int, rows: int, gear: float = 0.0) -> pd.DataFrame:
    """Readings of the arm by its kinematics written out, with a wave of three cycles in joint 1."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-2.8, 2.8, rows), rng.uniform(-1.4, 1.4, rows)
    at = a + gear * np.sin(3.0 * a)
    along = 100.0 + 400.0 * np.cos(b) - 50.0 * np.sin(b)
    up = 300.0 - 400.0 * np.sin(b) - 50.0 * np.cos(b)
    x, y = along * np.cos(at) - 30.0 * np.sin(at), along * np.sin(at) + 30.0 * np.cos(at)
    read = np.column_stack([x, y, up]) + 0.01 * rng.standard_normal((rows, 3))
    return pd.DataFrame(dict(zip(("q1", "q2", "x", "y", "z"), [*np.degrees([a, b]), *read.T], strict=True)))


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Diagnoses stay there, so that the second study takes what the first has made."""
    return tmp_path_factory.mktemp("work")


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of real recordings, by its names."""
    folder = tmp_path_factory.mktemp("data")
    tables: Mapping[str, pd.DataFrame] = {
        "ur10-laser-tracker/configurations": table(1, 60, GEAR).assign(goal=np.arange(60)),
        "ur10-laser-tracker/random": table(3, 60, GEAR).assign(goal=np.arange(60)),
        "stewart-mocap/session_60": table(2, 60),
    }
    for name, rows in tables.items():
        path = folder / f"{name}.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        rows.to_csv(path, index=False)
        text = MACHINE.format(length=0.1, angle=0.03, sigma=0.01)
        text = text.replace("frames: {", "frames: {base: {tolerance: {xyz: .inf, rpy: .inf}}, ")
        (path.parent / "machine.yaml").write_text(text, encoding="utf-8")
    return folder


def test_held_out_rows_are_those_that_the_page_states(data: Path, tmp_path: Path) -> None:
    _, path = prepared(data, tmp_path, "configurations")
    held = pd.read_csv(path)["role"] == "validation"
    assert np.flatnonzero(held).tolist() == [k for k in range(60) if k % 10 in (3, 6, 9)]
    _, path = prepared(data, tmp_path, "session_60")
    assert np.flatnonzero(pd.read_csv(path)["role"] == "validation").tolist() == list(range(4, 60, 5))
    said = list(lines("prepare", data, tmp_path, ["session_60"]))
    assert said == [
        f"truepose diagnose {data / 'stewart-mocap/machine.yaml'} {path} -o {tmp_path / 'session_60'}"
    ]


def test_a_diagnosis_is_told_by_what_it_is_worth_on_rows_held_out(data: Path, work: Path) -> None:
    said = list(lines("unseen", data, work, ["configurations"]))
    cells = [cell.strip() for cell in said[2].strip("|").split("|")]
    before, after = (float(cell.split()[0]) for cell in cells[2:4])
    assert before > 3 * after and after == pytest.approx(0.01 * np.sqrt(3), rel=0.4)  # 18 rows of 3 readings
    score = float(cells[5].split(",")[0])
    assert 0.6 < score < 1.4  # four sigmas of the rms of 54 numbers whose sigma is 1
    assert any(line.startswith("  transmission-error q1: ") for line in said[3:])
    assert (work / "configurations" / "report.html").is_file()


def test_a_model_is_carried_to_another_campaign(data: Path, work: Path) -> None:
    said = list(lines("campaigns", data, work, ["configurations", "random"]))
    assert [line.split(":")[0] for line in said[:2]] == ["q1", "q2"]
    plain, improved, *_ = (float(line.split(": ")[1].split()[0]) for line in said[2:])
    assert said[2].startswith("configurations/plain/calibrated.yaml on random, base and tool refitted")
    assert improved < plain / 3  # the wave is the same in both


def test_two_campaigns_agree_by_what_both_saw(data: Path, tmp_path: Path) -> None:
    machine = load_machine(data / "stewart-mocap/machine.yaml")
    seen = [_recording(machine, tmp_path, seed) for seed in (5, 6)]

    def correlation(one: str, other: str) -> float:
        effects = [[truepose.parse_effect(text, machine)] for text in (one, other)]
        return agreement(effects, seen, "q1")[0]

    wave = "transmission-error@q1:orders=9,a9=1e-4[rad]"
    beside_it = f"{wave},b2=5e-4[rad]"  # low orders do not count
    assert correlation(wave, beside_it) == pytest.approx(1.0, abs=1e-6)
    assert correlation(wave, wave.replace("1e-4", "-1e-4")) == pytest.approx(-1.0, abs=1e-6)
    assert abs(correlation(wave, wave.replace("a9", "b9"))) < 0.2  # a quarter of a wave later
    assert np.isnan(correlation(wave, "transmission-error@q2:orders=9,a9=1e-4[rad]"))


def _recording(machine: Machine, folder: Path, seed: int) -> Recording:
    table(seed, 1500).to_csv(folder / f"{seed}.csv", index=False)
    return load_recording(machine, [folder / f"{seed}.csv"])
