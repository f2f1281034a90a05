"""The command that plans poses, also to tell classes of a diagnosis apart: what it writes, says and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from support import MACHINES
from support.command import input_error, refused, run
from support.experiments import UNEVEN, YIELDING, arm, planned, poses
from support.graph_machines import machine_of
from support.plans import written
from truepose.identification.leaves.planning.command import findings_of
from truepose.identification.leaves.planning.discriminate.experiment import discriminate
from truepose.identification.leaves.planning.discriminate.factors import class_of, read_offer
from truepose.identification.leaves.planning.plan import plan
from truepose.identification.recording.load import load_recording
from truepose.identification.report.notes import worded
from truepose.models.load import load_machine


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


NAMELESS = {"effect": "unknown", "place": ["q2"], "probability": 0.5}


DIAGNOSED = """
- effect: joint-compliance
  place: [q2]
  equivalents: [{effect: transmission-error, place: [q2], probability: 0.3}]
  parameters: {c: {value: 1.0e-5, std: 1.0e-6, unit: rad/(N*m)}}
  settings: [{}]
- {effect: backlash, place: [q3], equivalents: [], parameters: {b: {value: 1.0e-4, std: 1.0e-6, unit: rad}}, settings: [{}]}
"""


def diagnosis_file(folder: Path, **finding: object) -> Path:
    first, other = yaml.safe_load(DIAGNOSED)
    (folder / "diagnosis.json").write_text(json.dumps({"findings": [first | finding, other]}))
    return folder / "diagnosis.json"


def test_a_class_is_read_from_a_diagnosis(tmp_path: Path) -> None:
    machine = arm()
    wanted = class_of(findings_of(diagnosis_file(tmp_path)), machine)
    assert [e.name for e in wanted.explanations] == ["joint-compliance@q2", "transmission-error@q2"]
    assert wanted.explanations[0].amplitude == pytest.approx([0.1])
    assert [other.label for other in wanted.others] == ["backlash@q3"]
    assert len(wanted.explanations[1].forms) > 10  # any order, but no long series
    found = discriminate(machine, 8, wanted, offer=read_offer(machine, "0,5"), candidates=poses(machine, 30))
    assert found.splits
    named = class_of(
        findings_of(diagnosis_file(tmp_path)), machine, ["joint-compliance@q2", "axis-coupling@q2+q3"]
    )
    assert [e.slug for e in named.explanations] == ["joint-compliance", "axis-coupling"]


def test_what_has_no_name_is_told_and_not_planned_for(tmp_path: Path) -> None:
    named = {"effect": "transmission-error", "place": ["q2"], "probability": 0.3}
    wanted = class_of(findings_of(diagnosis_file(tmp_path, equivalents=[NAMELESS, named])), arm())
    assert [e.slug for e in wanted.explanations] == ["joint-compliance", "transmission-error"]
    assert any("without a name" in note for note in worded(wanted.notes))


@pytest.mark.parametrize(
    ("finding", "message"),
    [
        ({"equivalents": []}, "no finding with equivalents"),
        ({"equivalents": [NAMELESS]}, "no finding with equivalents"),
        ({"parameters": {}}, "no value of c"),
    ],
)
def test_a_diagnosis_without_a_class_is_refused(
    tmp_path: Path, finding: dict[str, object], message: str
) -> None:
    with input_error(message):
        class_of(findings_of(diagnosis_file(tmp_path, **finding)), arm())


@pytest.mark.parametrize(
    ("texts", "named"),
    [
        (("payload",), "expected DRIVER"),
        (("temperature.link2=warm",), "expected numbers"),
        (("humid=1",), "expected DRIVER"),
    ],
)
def test_offers_that_mean_nothing_are_refused(texts: tuple[str, ...], named: str) -> None:
    with input_error(named):
        read_offer(arm(), named=texts)


def test_payloads_and_names_are_checked() -> None:
    with input_error("not negative"):
        read_offer(arm(), "-1,5")
    with input_error("two or more"):
        planned("arm", YIELDING, "joint-compliance@q2")


def asked(folder: Path, *options: str) -> tuple[object, ...]:
    """The words of a plan among given poses."""
    rows, machine = folder / "candidates.csv", MACHINES / "serial.yaml"
    loaded = load_machine(machine)
    degrees = np.where([a.unit == "rad" for a in loaded.mechanism.actuators], np.degrees(1.0), 1.0)
    head = ",".join(loaded.mechanism.readings)
    np.savetxt(rows, poses(loaded, 24) * degrees, delimiter=",", header=head, comments="")
    return ("plan", machine, "-n", 8, "-o", folder / "poses.csv", "--candidates", rows, *options)


def test_the_command_writes_rows_that_simulate_reads(tmp_path: Path) -> None:
    options = ("--discriminate", YIELDING, "backlash@q2:b=5e-4", "--payload", "0,5", "--json")
    told = json.loads(run(*asked(tmp_path, *options)).stdout)
    assert told["split"] is True and told["expected"] > told["random"]["mean"]
    assert {"pose", "q1", "q2", "q3", "payload", "approach.q2"} == set(told["columns"])
    run("simulate", MACHINES / "serial.yaml", tmp_path / "poses.csv", "-o", tmp_path / "out.csv")
    first = (tmp_path / "poses.csv").read_text(encoding="utf-8").splitlines()
    assert first[0].startswith("# rows of arm to tell joint-compliance@q2 and backlash@q2 apart")


def test_the_command_says_of_twins_that_no_plan_splits_them(tmp_path: Path) -> None:
    twins = ("transmission-error@q2:order=2", "encoder-eccentricity@q2:order=2")
    assert "no plan splits them" in run(*asked(tmp_path, "--discriminate", *twins)).stdout


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("--payload", "0,5"), "without --discriminate"),
        (("--temperature", "air=15,20"), "without --discriminate"),
        (("--discriminate", YIELDING, UNEVEN, "--method", "random"), "--method"),
        (("--discriminate", YIELDING, "backlash@q9"), "--discriminate backlash@q9"),
    ],
)
def test_options_that_do_not_fit_are_refused_in_one_line(
    tmp_path: Path, options: tuple[str, ...], named: str
) -> None:
    refused(*asked(tmp_path, *options), said=named)
