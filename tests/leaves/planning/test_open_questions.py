"""The experiment that a diagnosis ends with: its command runs as printed, and its rows tell a law from an unnamed form."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support import MACHINES
from support.command import run
from support.experiments import arm
from truepose.identification.diagnosis.selection_problem import selection_problem, weighed_alone
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.tool_pose import tool_moves
from truepose.identification.leaves.planning.discriminate.experiment import discriminate
from truepose.identification.leaves.planning.discriminate.factors import Class, explanation, read_offer
from truepose.identification.leaves.planning.discriminate.rows import Rows, recording_of, signals
from truepose.identification.leaves.planning.showing import experiment_table
from truepose.identification.prediction.predict import simulate
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effect_text import effect_text, parse_effect

JOINTS, PAYLOADS = ["q1", "q2", "q3"], [0.0, 3.0]
SEEN, ALL = ([-150, -60, -60], [150, 60, 60]), ([-150, -120, -150], [150, 120, 150])
"""Joint ranges of the first recording and of the machine: mm, deg, deg."""
LAW = "joint-compliance@q2:c=1e-5"
HELD = "empirical@q2:from.load=-15.8,to.load=15.7,degree=3"
"""A form over the loads (N m) that the first recording saw."""


def rows(rng: np.random.Generator, n: int, ranges: tuple[list[int], list[int]]) -> pd.DataFrame:
    table = pd.DataFrame(rng.uniform(*ranges, (n, 3)).round(4), columns=JOINTS)
    return table.assign(payload=rng.choice(PAYLOADS, n))


def measured(folder: Path, table: pd.DataFrame, truth: str, seed: int) -> Recording:
    """Readings of a machine that has one effect, in a file ``recording.csv``."""
    file, machine = folder / "recording.csv", arm()
    table.to_csv(file, index=False)
    poses = load_recording(machine, [file], need_observations=False)
    readings = simulate(machine, poses, [parse_effect(truth, machine)], seed=seed)
    pd.concat([table.reset_index(drop=True), readings], axis=1).to_csv(file, index=False)
    return load_recording(machine, [file])


def test_the_command_that_a_diagnosis_ends_with_plans_ten_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    measured(tmp_path, rows(np.random.default_rng(2), 24, SEEN), LAW, 2)
    asked = ("diagnose", MACHINES / "serial.yaml", "recording.csv", "-o", "found")
    text = run(*asked).stdout
    (line,) = [one for one in text.splitlines() if "truepose plan" in one]
    command = line.partition("truepose ")[2]
    assert "improved.yaml -n 10" in command and "empirical@q2:" in command
    first = " ".join(text.partition("next,")[0].split())
    assert "What would tell: measure the same poses with and without a known payload (plan" in first
    saved = json.loads((tmp_path / "found" / "diagnosis.json").read_text(encoding="utf-8"))["experiments"]
    assert [one["place"] for one in saved] == [["q2"]]
    assert saved[0]["command"].replace("improved.yaml", "found/improved.yaml") == f"truepose {command}"

    answer = json.loads(run(*shlex.split(command), "--json").stdout)
    assert answer["explanations"] == ["joint-compliance@q2", "empirical@q2"]
    assert answer["expected"] > answer["random"]["mean"] + 1.0
    planned = pd.read_csv(tmp_path / "poses.csv", comment="#")
    assert len(planned) == 10 and {*planned["payload"]} <= {*PAYLOADS}
    assert np.all(planned[JOINTS] >= ALL[0]) and np.all(planned[JOINTS] <= ALL[1])
    beyond = np.any((planned[JOINTS] < SEEN[0]) | (planned[JOINTS] > SEEN[1]), axis=1)
    assert beyond.sum() >= 5  # where a law goes on and a form stays


def test_what_an_effect_is_stated_as_is_read_as_the_same() -> None:
    stated = [parse_effect(text, arm()) for text in (LAW, f"{HELD},c1=1e-4,c3=-2e-5")]
    for one in stated:
        again = parse_effect(effect_text(one), arm())
        assert (again.label, again.settings) == (one.label, one.settings)
        assert again.amplitudes == pytest.approx(one.amplitudes, rel=1e-3)


def test_the_tool_is_moved_as_far_as_readings_say(tmp_path: Path) -> None:
    """A sensor of positions reads by how much effects move the tool."""
    machine, law = arm(), parse_effect(LAW, arm())
    recording = measured(tmp_path, rows(np.random.default_rng(1), 24, SEEN), LAW, 1)
    fit = estimate(machine, recording, (law,))
    plain = simulate(machine, recording, [], seed=None).to_numpy()
    away = simulate(machine, recording, fit.fitted_effects(), seed=None).to_numpy() - plain
    rms = float(np.sqrt(np.mean(np.sum(away**2, axis=1))))
    assert tool_moves(fit, np.arange(24), [[law.label], []]) == pytest.approx([rms, 0.0], rel=1e-2)


def log_bayes_factor(recording: Recording) -> float:
    """Of the law against the form, sizes of both and geometry integrated out, as a diagnosis weighs them."""
    machine = arm()
    pair = (parse_effect(LAW.partition(":")[0], machine), parse_effect(HELD, machine))
    linear = Signatures(machine, recording, pair).linearise(estimate(machine, recording))
    law, form = weighed_alone(selection_problem(linear, Catalogue(pair, (0.0, 0.0), ()), 1.0), 2)
    return float(law - form)


@pytest.mark.parametrize(("truth", "sign"), [(LAW, 1.0), (f"{HELD},c1=1.57e-4", -1.0)])
def test_ten_planned_rows_tell_more_than_ten_random_ones(tmp_path: Path, truth: str, sign: float) -> None:
    """What is true gains on average, more than by random rows; within what was seen first, the two are the same."""
    machine, gained = arm(), []
    pair = Class((explanation(LAW, machine), explanation(HELD, machine)))
    for seed in range(5):
        rng = np.random.default_rng(seed)
        old = rows(rng, 24, SEEN)
        recorded = measured(tmp_path, old, truth, seed)
        found = discriminate(machine, 10, pair, offer=read_offer(machine, "0,3"), recorded=recorded)
        both = [experiment_table(found)[[*JOINTS, "payload"]], rows(rng, 10, ALL)]
        after = [log_bayes_factor(measured(tmp_path, pd.concat([old, one]), truth, seed)) for one in both]
        gained.append(sign * (np.array(after) - log_bayes_factor(recorded)))
    planned, random = np.mean(gained, axis=0)
    assert planned > 3.0 and planned > random + 1.0


def test_versions_of_what_is_asked_are_no_nuisance() -> None:
    """What a file holds at the place and with the driver of an explanation is left out, what else acts there stays."""
    law, form, play = (parse_effect(text, arm()) for text in (LAW, HELD, "backlash@q2"))
    machine = replace(arm(), effects=(law, play))
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3))
    some = Rows(q, {"payload": np.zeros(20), "approach.q2": np.ones(20)})
    known = signals(machine, recording_of(machine, some, q[0]), [form]).names
    assert "backlash@q2:b" in known and not [name for name in known if name.startswith("joint-compliance")]
