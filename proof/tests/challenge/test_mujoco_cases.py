"""Cases on MuJoCo's arms: written as the examination's own are, the same for a seed, and seen for what they are."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.util import find_spec
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from support.skips import NO_MUJOCO

if find_spec("mujoco") is None or find_spec("robosuite") is None:
    pytest.skip(NO_MUJOCO, allow_module_level=True)

import typer

from challenge import solutions
from challenge.mujoco.__main__ import main
from challenge.mujoco.arms import machines
from challenge.mujoco.written import Asked, unsaid, write
from challenge.simulator.base import Imperfection, Plan
from challenge.simulator.writing import recording_text
from truepose.errors import InputError
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

FEW = Asked(Path(), 3, 5, ("mujoco-ur5e", "mujoco-panda"), ("null", "single"))


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cases")
    assert write(replace(FEW, folder=folder)) == ("case001", "case002", "case003")
    return folder


class TestWritten:
    def test_a_seed_gives_the_same_bytes(self, cases: Path, tmp_path: Path) -> None:
        """Also of a shorter examination that begins alike."""
        write(replace(FEW, folder=tmp_path, n=2))
        again = files(tmp_path)
        assert {"cases/case002/recording.csv", "answers/case002.json"} <= set(again)
        assert again == {name: text for name, text in files(cases).items() if "case003" not in name}

    def test_what_is_there_is_not_drawn_again(self, cases: Path) -> None:
        before = files(cases)
        said: list[str] = []
        write(replace(FEW, folder=cases), said.append)
        assert said == ["case001", "case002", "case003"]
        assert files(cases) == before

    def test_another_seed_wants_another_directory(self, cases: Path) -> None:
        with pytest.raises(InputError, match="give another directory"):
            write(replace(FEW, folder=cases, seed=6))

    def test_unknown_arms_and_strata_are_refused(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="found arm 'scara'"):
            write(replace(FEW, folder=tmp_path, arms=("scara",)))
        with pytest.raises(InputError, match="found stratum 'concealed', expected one of null"):
            write(replace(FEW, folder=tmp_path, strata=("concealed",)))

    def test_keys_say_what_was_put_in(self, cases: Path) -> None:
        keys = [solutions.from_file(p) for p in sorted((cases / "answers").iterdir())]
        kinds = {name: {k.name: k for k in arm().kinds()} for name, arm in machines().items()}
        assert {"null", "single"} == {key.stratum for key in keys}
        for key in keys:
            assert (key.stratum == "null") == (not key.truths)
            for truth in key.truths:
                kind = kinds[key.machine][truth.kind]
                assert truth.effect == kind.slug
                assert truth.place in kind.places
                assert truth.snr == pytest.approx(5 * truth.factor, rel=0.2)

    def test_files_hold_no_word_of_the_truth(self, cases: Path) -> None:
        for key in sorted((cases / "answers").iterdir()):
            case = cases / "cases" / key.stem
            text = "".join(p.read_text(encoding="utf-8") for p in case.iterdir())
            for truth in solutions.from_file(key).truths:
                assert truth.kind not in text
            assert {p.name for p in case.iterdir()} == {"machine.yaml", "recording.csv", "heldout.csv"}

    def test_every_third_case_leaves_the_side_to_the_order_of_rows(self, cases: Path) -> None:
        sides = []
        for case in sorted((cases / "cases").iterdir()):
            table = pd.read_csv(case / "recording.csv")
            sides.append("approach.q1" in table.columns)
        assert sides == [True, True, False]

    def test_a_command_draws_them(self, tmp_path: Path) -> None:
        app = typer.Typer()
        app.command()(main)
        asked = ["-n", "1", "--seed", "5", "--arms", "mujoco-ur5e", "--strata", "null", "-o", str(tmp_path)]
        done = CliRunner().invoke(app, asked)
        assert done.exit_code == 0
        assert "1 cases in" in done.output
        assert json.loads((tmp_path / "challenge.json").read_text())["machines"] == ["mujoco-ur5e"]
        failed = CliRunner().invoke(app, [*asked[:4], "--arms", "scara", "-o", str(tmp_path)])
        assert failed.exit_code == 1
        assert "found arm 'scara'" in failed.output


def test_only_the_sides_are_left_unsaid() -> None:
    text = "pose,q1,approach.q1,approach.q2,x\n1,0.500000000,1,-1,2.250000000\n"
    assert unsaid(text) == "pose,q1,x\n1,0.500000000,2.250000000\n"
    assert list(pd.read_csv(StringIO(unsaid(text))).columns) == ["pose", "q1", "x"]


@pytest.mark.parametrize("joint", ["", "q3"])
def test_a_spring_is_seen_as_what_it_is_and_nothing_as_nothing(joint: str, tmp_path: Path) -> None:
    """The physics' sign and size, and that the machine file is the arm: chi2 of some 200 readings is 1 to 0.1."""
    arm = machines()["mujoco-ur5e"]()
    rng = np.random.default_rng(11)
    specimen, campaign = arm.specimen(rng), arm.campaign(Plan(poses=50), rng)
    parts = (Imperfection("joint-compliance", (joint,), 1.0),) if joint else ()
    observed = arm.noisy(arm.measure(specimen, parts, campaign), campaign, rng)
    (tmp_path / "machine.yaml").write_text(arm.machine_text(), encoding="utf-8")
    (tmp_path / "recording.csv").write_text(recording_text(arm, campaign, observed), encoding="utf-8")
    machine = load_machine(tmp_path / "machine.yaml")
    found = diagnose(machine, load_recording(machine, [tmp_path / "recording.csv"]))
    if not joint:
        assert found.before.chi2_per_dof == pytest.approx(1.0, abs=0.3)
        assert found.verdict == "adequate"
        return
    assert found.before.chi2_per_dof > 2.0
    stiffness = arm.drawing.strengths()[0][2] / 3e-4
    after = found.after
    values = dict(zip(after.prior.names, after.p, strict=True))
    (name,) = [n for n in values if n.startswith("joint-compliance@q3")]
    assert [f.label for f in after.effects] == ["joint-compliance@q3"]
    # 50 poses know it to 4 %
    assert values[name] == pytest.approx(1 / stiffness, rel=0.15)
