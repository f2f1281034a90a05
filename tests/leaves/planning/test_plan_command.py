"""The command that plans measurement poses: what it writes, what it says, what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from support import MACHINES
from support.command import refused, run
from support.graph_machines import machine_of
from support.plans import written
from truepose.identification.leaves.planning.plan import plan
from truepose.identification.recording.load import load_recording


def test_the_command_writes_poses_and_says_what_they_are_worth(tmp_path: Path) -> None:
    output = tmp_path / "poses.csv"
    result = run("plan", MACHINES / "distance.yaml", "-n", 7, "-o", output, "--seed", 2)
    head, comment, *_ = output.read_text().splitlines()
    assert head == "# poses of stage for calibration: 7, continuous, seed 2"
    assert "log det(J'J + prior) = " in comment and "random poses" in comment
    assert "random poses" in result.stdout
    machine = machine_of("distance")
    recording = load_recording(machine, [output], need_observations=False)
    assert np.array_equal(recording.q, plan(machine, 7, seed=2).q) and recording.from_row is not None
    run("simulate", MACHINES / "distance.yaml", output, "-o", tmp_path / "out.csv")


def test_the_command_s_json_is_one_object(tmp_path: Path) -> None:
    output = tmp_path / "poses.parquet"
    result = run("plan", MACHINES / "serial.yaml", "-n", 6, "-o", output, "--method", "exchange", "--json")
    document = json.loads(result.stdout)
    assert document["command"] == "plan" and document["poses"] == 6
    # joints are rounded after the exchange
    assert (
        document["value"] == pytest.approx(document["exchange"], rel=1e-6)
        and document["random"]["mean"] < document["value"]
    )
    recording = load_recording(machine_of("serial"), [output], need_observations=False)
    assert len(recording) == 6


def test_candidates_are_read_from_a_file_and_drivers_that_are_not_planned_are_named(tmp_path: Path) -> None:
    text = (MACHINES / "serial.yaml").read_text()
    text += "effects:\n  - {effect: backlash, place: [q2], parameters: {b: {value: 0.01, unit: deg}}}\n"
    machine = written(tmp_path, text)
    candidates, output = tmp_path / "candidates.csv", tmp_path / "poses.csv"
    run("plan", machine, "-n", 20, "-o", candidates, "--method", "random")
    result = run("plan", machine, "-n", 5, "-o", output, "--candidates", candidates)
    assert "'approach.q2' is not planned" in result.stderr
    rows, known = (
        {line.split(",", 1)[1] for line in file.read_text().splitlines() if line[0].isdigit()}
        for file in (output, candidates)
    )
    assert len(rows) == 5 and rows <= known


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["-n", 5, "--method", "best"], "found 'best', expected one of continuous, exchange, random"),
        (["-n", 5, "--candidates", "missing.csv"], "cannot read the file"),
        (["-n", 5, "--candidates", MACHINES / "serial.yaml"], "found"),
    ],
)
def test_bad_requests_are_one_line_and_leave_the_file_as_it_was(
    arguments: list[object], says: str, tmp_path: Path
) -> None:
    output = tmp_path / "poses.csv"
    output.write_text("old", encoding="utf-8")
    refused("plan", MACHINES / "serial.yaml", "-o", output, *arguments, said=says)
    assert output.read_text() == "old"


def test_candidates_cannot_be_moved(tmp_path: Path) -> None:
    candidates = tmp_path / "candidates.csv"
    asked = ("plan", MACHINES / "serial.yaml", "-o", tmp_path / "p.csv", "-n")
    run("plan", MACHINES / "serial.yaml", "-o", candidates, "-n", 9, "--method", "random")
    refused(*asked, 5, "--candidates", candidates, "--method", "continuous", said="candidates stay in place")
    refused(*asked, 1)
