"""What a plan is asked for and what it says: classes from a diagnosis, offers, options, the command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from support import MACHINES
from support.experiments import BENT, COMPLIANT, UNEVEN, YIELDING, arm, planned, poses
from truepose.cli import app
from truepose.errors import InputError
from truepose.identification.leaves.planning.command import findings_of
from truepose.identification.leaves.planning.discriminate.experiment import discriminate
from truepose.identification.leaves.planning.discriminate.factors import class_of, read_offer
from truepose.identification.leaves.planning.showing import experiment_json, sentences
from truepose.identification.report.notes import worded
from truepose.models.load import load_machine

NAMELESS = {"effect": "unknown", "place": ["q2"], "probability": 0.5}


def diagnosis_file(folder: Path, **finding: object) -> Path:
    content = {
        "effect": "joint-compliance",
        "place": ["q2"],
        "equivalents": [{"effect": "transmission-error", "place": ["q2"], "probability": 0.3}],
        "parameters": {"c": {"value": 1e-5, "std": 1e-6, "unit": "rad/(N*m)"}},
        "settings": [{}],
    }
    other = {
        "effect": "backlash",
        "place": ["q3"],
        "equivalents": [],
        "parameters": {"b": {"value": 1e-4, "std": 1e-6, "unit": "rad"}},
        "settings": [{}],
    }
    (folder / "diagnosis.json").write_text(json.dumps({"findings": [{**content, **finding}, other]}))
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
    with pytest.raises(InputError, match=message):
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
    with pytest.raises(InputError, match=named):
        read_offer(arm(), named=texts)


def test_payloads_and_names_are_checked() -> None:
    with pytest.raises(InputError, match="not negative"):
        read_offer(arm(), "-1,5")
    with pytest.raises(InputError, match="two or more"):
        planned("arm", YIELDING, "joint-compliance@q2")


def run(folder: Path, *options: str, machine: str = "serial") -> Result:
    rows = folder / "candidates.csv"
    loaded = load_machine(MACHINES / f"{machine}.yaml")
    degrees = np.where([a.unit == "rad" for a in loaded.mechanism.actuators], np.degrees(1.0), 1.0)
    head = ",".join(loaded.mechanism.readings)
    np.savetxt(rows, poses(loaded, 24) * degrees, delimiter=",", header=head, comments="")
    common = ["plan", str(MACHINES / f"{machine}.yaml"), "-n", "8", "-o", str(folder / "poses.csv")]
    return CliRunner().invoke(app, [*common, "--candidates", str(rows), *options])


def test_the_command_writes_rows_that_simulate_reads(tmp_path: Path) -> None:
    found = run(tmp_path, "--discriminate", YIELDING, "backlash@q2:b=5e-4", "--payload", "0,5", "--json")
    assert found.exit_code == 0, found.output
    told = json.loads(found.stdout)
    assert told["split"] is True and told["expected"] > told["random"]["mean"]
    assert {"pose", "q1", "q2", "q3", "payload", "approach.q2"} == set(told["columns"])
    after = CliRunner().invoke(
        app,
        [
            "simulate",
            str(MACHINES / "serial.yaml"),
            str(tmp_path / "poses.csv"),
            "-o",
            str(tmp_path / "out.csv"),
        ],
    )
    assert after.exit_code == 0, after.output
    first = (tmp_path / "poses.csv").read_text(encoding="utf-8").splitlines()
    assert first[0].startswith("# rows of arm to tell joint-compliance@q2 and backlash@q2 apart")


def test_the_command_says_of_twins_that_no_plan_splits_them(tmp_path: Path) -> None:
    found = run(
        tmp_path, "--discriminate", "transmission-error@q2:order=2", "encoder-eccentricity@q2:order=2"
    )
    assert found.exit_code == 0, found.output
    assert "no plan splits them" in found.stdout


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
    found = run(tmp_path, *options)
    assert found.exit_code == 2 and named in found.stderr and len(found.stderr.splitlines()) == 1


def test_json_and_words_agree() -> None:
    found = planned("telescope", COMPLIANT, BENT, payload="0,5")
    told = experiment_json(found)
    assert told["sentences"] == sentences(found)
    assert told["expected"] == min(pair["expected"] for pair in told["pairs"] if pair["separable"])
    assert told["split"] is (found.expected >= told["threshold"] and not told["inseparable"])
