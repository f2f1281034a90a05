"""The simulator of arrivals keeps the laws of its physics, and what it makes is told from the order of rows alone."""

from __future__ import annotations

from pathlib import Path

import arrival_study as study
import numpy as np
import pytest

import truepose
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.untestable import missing_inputs
from truepose.models.machine.machine import Machine


def made(tmp_path: Path, kind: str, seed: int) -> tuple[study.Arm, Machine, Path]:
    """An arm of the study, its machine file and its recording."""
    arm, n, sensor = study.drawn(kind, seed)
    (tmp_path / "arm.yaml").write_text(study.machine_file(arm, sensor))
    rows = study.recorded(arm, n, sensor, np.random.default_rng(seed))
    rows.to_csv(tmp_path / "rows.csv", index=False)
    return arm, truepose.load_machine(tmp_path / "arm.yaml"), tmp_path / "rows.csv"


def said(found: Diagnosis) -> dict[str, str]:
    return {f"{f.effect}@{'+'.join(f.place)}": f.explanation for f in found.findings}


def test_a_synchronised_motion_starts_and_ends_at_rest_and_never_turns() -> None:
    arm, _, _ = study.drawn("early", 0)
    for way in (1.0, 0.01):  # with full speed, and too short for it
        share, total = study.motion(arm, np.zeros(6), way * np.array([1.0, -0.4, 0.2, 0.0, 0.1, 0.3]))
        done = share(np.linspace(0.0, total, 1001))
        np.testing.assert_allclose(done[[0, -1]], [0.0, 1.0], atol=1e-12)
        speed = np.diff(done)
        assert np.all(speed >= -1e-12)
        assert max(speed[0], speed[-1]) < 0.01 * speed.max()


def test_a_link_in_a_clearance_is_left_half_of_it_behind() -> None:
    assert study.pushed(0.0, np.linspace(0, 1, 50), 0.2) == pytest.approx(0.9)
    assert study.pushed(0.9, np.linspace(1, 0.95, 9), 0.2) == pytest.approx(0.9)  # within the play it stays
    assert study.pushed(0.9, np.linspace(1, 0.2, 50), 0.2) == pytest.approx(0.3)


def test_play_is_named_without_its_column_and_says_where_the_side_is_from(tmp_path: Path) -> None:
    arm, machine, rows = made(tmp_path, "play", 7)
    found = truepose.diagnose(machine, rows)
    assert study.judged("play", arm, found) == {"place and driver": True, "law": True, "false": False}
    assert arm.joint is not None
    assert "from the order of the rows" in said(found)[f"backlash@q{arm.joint + 1}"]


def test_of_rows_that_are_declared_shuffled_nothing_is_asked_about_the_way(tmp_path: Path) -> None:
    _, machine, rows = made(tmp_path, "play", 7)
    shuffled = truepose.load_recording(machine, rows, shuffled=True)
    cat = catalogue(machine, shuffled)
    assert "arrival" not in {placed.kind for placed in cat.candidates}
    assert "arrival" in {
        placed.kind for placed in catalogue(machine, truepose.load_recording(machine, rows)).candidates
    }
    why = {one.effect: one.why for one in cat.untestable}
    assert "no approach.q1 column, and the rows are declared shuffled" in why["backlash"]
    for slug in ("friction-hysteresis", "early-reading"):
        assert "declared shuffled" in why[slug]
    assert "backlash" in {slug for one in missing_inputs(machine, shuffled) for slug in one.effects}


def test_an_arm_that_is_read_early_is_told_from_one_with_play(tmp_path: Path) -> None:
    arm, machine, rows = made(tmp_path, "early", 7)
    found = truepose.diagnose(machine, rows)
    assert study.judged("early", arm, found) == {"place and driver": True, "law": True, "false": False}
    (text,) = (text for name, text in said(found).items() if name.startswith("early-reading"))
    assert "wait longer" in text
    assert "order of the rows" in text


def test_with_velocities_a_delay_is_latency(tmp_path: Path) -> None:
    _, machine, rows = made(tmp_path, "neither", 3)
    table = rows.read_text().splitlines()
    moving = [f"{table[0]},velocity.q1", *(f"{line},{k % 3}" for k, line in enumerate(table[1:]))]
    rows.write_text("\n".join(moving))
    why = {
        one.effect: one.why for one in catalogue(machine, truepose.load_recording(machine, rows)).untestable
    }
    assert "latency" in why["early-reading"]
