"""The battery: its parts, its table's arithmetic on hand-made results, and that what has a result is left alone."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from challenge import examine, solutions
from challenge.battery import sitting
from challenge.battery.__main__ import app
from challenge.battery.claims import Claim, replicated, sure
from challenge.battery.figures import figures
from challenge.battery.parts import CASES, HALVES, PARTS, REALS, Real, chosen, of_whole
from challenge.battery.recorded import compared, main, read
from challenge.battery.results import Results
from challenge.battery.table import table
from challenge.figures import Figure
from proof_support import BENCHMARKS
from proof_support.challenge_replies import PLAY, finding, key, leveled
from truepose.errors import InputError
from truepose.identification.fit.calibrate import calibrate

sys.path.insert(0, str(BENCHMARKS))  # where a process of the battery looks, too


def diagnosis(
    *findings: dict[str, Any], verdict: str = "missing-physics", apart: float = 0.0
) -> dict[str, Any]:
    return {
        "verdict": verdict, "concealed": False, "findings": list(findings), "leading": [], "inclusion": [],
        "parameters": {"a": {"value": 1.2}, "b": {"value": 9.0}}, "disagreement": apart,
    }  # fmt: skip


def play(place: str, law: float, driver: float) -> dict[str, Any]:
    return leveled(finding("backlash", place, law), "arrival", driver)


def kept(folder: Path, part: str, case: str, document: dict[str, Any] | None, **more: Any) -> None:
    """A result as a sitting leaves it; ``more``: measures. Without a document it has failed."""
    at = folder / part / "results" / case
    at.mkdir(parents=True)
    message = "" if document else "timeout"
    (at / "run.json").write_text(json.dumps({"seconds": 9.0, "cpu": 4.0, "message": message}))
    if document:
        (at / "diagnosis.json").write_text(json.dumps(document))
    if more:
        (at / "measures.json").write_text(json.dumps(more))


class TestParts:
    def test_halves_share_no_row_and_make_the_whole(self) -> None:
        real = Real("long", 1000, most=301)
        whole, rest = real.split("whole")
        assert (len(whole), len(rest)) == (301, 500) and not set(whole) & set(rest)
        for half, other in HALVES.items():
            fitted, predicted = real.split(half)
            assert set(fitted) | set(predicted) == set(whole) and not set(fitted) & set(predicted)
            assert np.all(np.diff(fitted) > 0) and set(real.split(other)[0]) == set(predicted)
        assert max(real.split("first-half")[0]) < min(real.split("second-half")[0])

    def test_a_cut_leaves_rows_to_predict(self) -> None:
        assert Real("short", 60).parts == ("whole", *HALVES)
        assert Real("longer", 120).parts[-1] == "cut-60"
        assert Real("long", 1000).parts[-2:] == (
            "cut-60",
            "cut-120",
        )  # all of it that is diagnosed is the next
        fitted, predicted = Real("longer", 120).split("cut-60")
        assert len(fitted) == len(predicted) == 60 and not set(fitted) & set(predicted)

    def test_what_is_unknown_is_refused(self) -> None:
        assert chosen("") == PARTS and chosen("recorded, outside") == ("recorded", "outside")
        with pytest.raises(InputError, match="found part 'inside', expected one of real-like"):
            chosen("inside")

    def test_a_half_is_asked_of_the_whole(self) -> None:
        assert of_whole("random.first-half") == ("random.whole", "random.second-half")
        assert of_whole("random.cut-60") == ("random.whole", None)


class TestClaims:
    def test_a_driver_is_the_same_at_a_part_of_the_place_and_a_name_at_its_place_only(self) -> None:
        driver = Claim(("q1",), "position", 0.9, law=False)
        assert driver.same(Claim(("q1", "q2"), "position-periodic", 0.1, law=False))
        assert not driver.same(Claim(("q2",), "position", 0.9, law=False))
        assert not driver.same(Claim(("q1",), "load", 0.9, law=False))
        constant = Claim(("q1.offset",), "constant", 0.9, law=False)
        assert constant.same(Claim(("q1.ry",), "constant", 0.9, law=False))
        assert not constant.same(Claim(("q2.offset",), "constant", 0.9, law=False))
        name = Claim(("q1",), "backlash", 0.9, law=True)
        assert name.same(Claim(("q1",), "backlash", 0.1, law=True))
        assert not name.same(Claim(("q1", "q2"), "backlash", 0.1, law=True)) and not name.same(driver)

    def test_rows_are_no_claims_and_what_has_no_law_is_no_name(self) -> None:
        said = diagnosis(
            leveled(finding("outliers", "7", 0.999), "sensor", 0.999),
            leveled(finding("empirical", "q2", 0.0), "load", 0.93),
            play("q1", 0.92, 0.89),
        )
        assert [(c.place, c.what) for c in sure(said, law=True)] == [(("q1",), "backlash")]
        assert [(c.place, c.what) for c in sure(said, law=False)] == [(("q2",), "load")]

    def test_a_half_is_held_against_the_whole_or_the_other_half(self) -> None:
        half, whole = (
            diagnosis(play("q1", 0.95, 0.96), play("q2", 0.95, 0.8)),
            diagnosis(play("q1", 0.3, 0.7)),
        )
        both = {"random.first-half": half, "random.whole": whole}
        assert replicated(both, law=True) == (False, False) and replicated(both, law=False) == (True,)
        whole["inclusion"] = [{"effect": "backlash", "place": ["q2"], "probability": 0.5}]
        assert replicated(both, law=True) == (False, True)  # said in no finding, but probable
        assert replicated({"random.first-half": half}, law=True) == ()
        halves = {"random.first-half": half, "random.second-half": diagnosis(play("q1", 0.6, 0.6))}
        assert replicated(halves, law=True) == (True, False) and replicated(halves, law=False) == (True,)


class TestTable:
    def test_real_recordings(self) -> None:
        found = Results(
            runs={
                "a": {"seconds": 9.0, "cpu": 2.0, "message": ""},
                "b": {"seconds": 3.0, "message": "crash"},
            },
            diagnoses={"panda_1.whole": diagnosis(play("q1", 0.95, 0.5), apart=0.2)},
            measures={
                "a": {"readings": [1.0, 0.5], "tool": [2.0, 2.2]},
                "b": {"readings": [1.0, 0.9], "tool": None},
                "c": {"readings": None, "tool": None},
            },
        )
        told = {figure.name: figure for figure in figures("recorded", found)}
        rows = "on rows that were not fitted, applied over plain"
        assert told[f"readings {rows}, median"].value == pytest.approx(0.7)
        assert told[f"readings {rows}, worst"].value == pytest.approx(0.9)
        worse = told[f"tool {rows}, cases above 1.02"]
        assert (worse.hits, worse.n) == (1, 1)
        assert told["names said with 0.9 or more"].value == 1.0
        assert told["places with their driver said with 0.9 or more"].value == 0.0
        assert (told["verdict missing-physics"].hits, told["verdict unknown"].hits) == (1, 0)
        assert told["disagreement of the chains, 0.05 or less"].hits == 0
        assert told["processor seconds of a case, worst"].n == 1  # the other's is not known
        assert (told["failures"].hits, told["failures"].n) == (1, 2)

    @pytest.mark.parametrize("part", ["real-like", "outside", "mujoco"])
    def test_the_examination_has_every_figure_that_is_asked_for(self, part: str) -> None:
        assert all(isinstance(figure, Figure) for figure in figures(part, Results()))

    def test_folders_are_compared_where_all_have_results(self, tmp_path: Path) -> None:
        right, wrong = diagnosis(play("rho1", 0.97, 0.98)), diagnosis(play("rho2", 0.97, 0.98), apart=0.2)
        for name, document in (("before", right), ("after", wrong)):
            answers = tmp_path / name / "real-like" / "answers"
            answers.mkdir(parents=True)
            for case in ("case001", "case002"):
                (answers / f"{case}.json").write_text(solutions.to_text(key(PLAY, stratum="real-like")))
            kept(tmp_path / name, "real-like", "case001", document)
        kept(tmp_path / "before", "real-like", "case002", None)
        lines = table([tmp_path / "before", tmp_path / "after"]).splitlines()
        assert lines[0] == "| figure | before | after |"
        assert lines[2] == "| **real-like**: cases that all have | 1 of 2 | 1 of 1 |"
        assert "| law, said with 0.9 or more, right | 1 of 1 | 0 of 1 |" in lines
        assert "| first name right | 1 of 1 | 0 of 1 |" in lines
        assert "| disagreement of the chains, worst | 0 | 0.2 |" in lines
        assert "| failures | 0 of 1 | 0 of 1 |" in lines
        assert not any("out of library" in line or "recorded" in line for line in lines)
        alone = table([tmp_path / "before"])
        assert "| failures | 1 of 2 |" in alone and "| law, said with 0.9 or more, right | 1 of 1 |" in alone

    def test_nothing_to_compare_is_told(self, tmp_path: Path) -> None:
        kept(tmp_path / "a", "recorded", "random.whole", None)
        kept(tmp_path / "b", "recorded", "random.cut-60", None)
        with pytest.raises(InputError, match="found no case that all have"):
            table([tmp_path / "a", tmp_path / "b"])
        with pytest.raises(InputError, match=r"c: found no results, expected a folder of 'python -m"):
            table([tmp_path / "a", tmp_path / "c"])


class TestSitting:
    def test_what_has_a_result_is_not_diagnosed_again(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        asked = list[tuple[str, ...]]()

        def diagnosed(module: tuple[str, ...], _: Path, results: Path, *__: object) -> None:
            asked.append(module)
            results.mkdir(parents=True)
            (results / "run.json").write_text("{}")

        monkeypatch.setattr(examine, "kept", diagnosed)
        said = list[str]()
        cases = ("session_60.whole", "random.cut-60")
        for wanted in (cases[:1], cases, cases):
            sitting.recorded(tmp_path, tmp_path / "out", 1, 9.0, said.append, wanted)
        assert asked == [("challenge.battery.recorded", str(tmp_path), case) for case in cases]
        assert said == [f"recorded: 1 of 1 ({case})" for case in cases]

    def test_drawn_folders_are_taken_as_they_are_and_their_keys_kept(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        drawn = tmp_path / "drawn" / "outside"
        for file in ("answers/case001.json", "cases/case001/heldout.csv"):
            (drawn / file).parent.mkdir(parents=True)
            (drawn / file).write_text("{}")
        settings = {"seed": 1, "machines": ["arm"], "strata": ["out-of-library"]}
        (drawn / "challenge.json").write_text(json.dumps(settings))
        monkeypatch.setattr(
            examine, "sit", lambda case, results, *_: kept(tmp_path / "out", "outside", case.name, None)
        )
        said = list[str]()
        for _ in range(2):  # a second sitting would find the folder of the first and fail
            sitting.sit(
                tmp_path / "drawn", tmp_path / "out", PARTS, jobs=1, data=None, timeout=9.0, say=said.append
            )
        assert said[:3] == [f"{p} skipped: not in {tmp_path / 'drawn'}" for p in ("real-like", "mujoco")] + [
            "recorded skipped: no --data"
        ]
        assert said[3] == "outside: 1 of 1 (case001)"
        assert (tmp_path / "out" / "outside" / "answers" / "case001.json").is_file()
        with pytest.raises(InputError, match="found no cases, expected some of the folders real-like"):
            sitting.sit(tmp_path, tmp_path / "out", PARTS, jobs=1, data=None, timeout=9.0, say=said.append)

    def test_without_mujoco_a_line_is_said(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "mujoco", None)
        for name in [name for name in sys.modules if name.startswith("challenge.mujoco")]:
            monkeypatch.delitem(sys.modules, name)
        said = list[str]()
        sitting.draw(tmp_path, 1, ("mujoco",), 1, said.append)
        assert len(said) == 1 and said[0].startswith(
            "mujoco skipped: challenge.mujoco: found no package 'mujoco'"
        )

    def test_the_command_says_what_is_wrong_in_a_line(self, tmp_path: Path) -> None:
        done = CliRunner().invoke(app, ["table", str(tmp_path / "nothing")])
        assert done.exit_code != 0 and "found no results" in done.output


class TestRecorded:
    @pytest.mark.parametrize("real", REALS, ids=lambda real: real.name)
    def test_files_have_as_many_rows_as_are_stated(
        self, real: Real, shared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        assert len(read(shared / "data", real.name)[1]) == real.rows

    @pytest.mark.parametrize("name", ["session_60", "panda_1_with_sensor"])
    def test_a_model_is_as_good_as_itself(
        self, name: str, shared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        machine, whole = read(shared / "data", name)
        late = np.arange(len(whole)) % 2 == 1
        fitted, rest = whole.subset(~late), whole.subset(late)
        fit = calibrate(machine, fitted).fit
        (plain, applied), tool = compared(fit, fit, fitted, rest)
        assert plain == applied > 0.0
        assert (tool is None) == name.startswith("panda")

    def test_a_crash_is_one_line(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert "session_60.whole" in CASES
        assert main(str(tmp_path), "session_60.whole") == 1
        assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_case_that_was_sat_without_its_key_is_told_in_a_line(tmp_path: Path) -> None:
    kept(tmp_path, "outside", "case001", diagnosis())
    done = CliRunner().invoke(app, ["table", str(tmp_path)])
    assert done.exit_code == 2
    assert "case001.json: found no such file, expected the key of a case that was sat" in done.stderr
