"""What options say reaches the library as it was said; the library itself stops there, so that nothing is worked out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from support.told_fleet import FAILED, STATISTICS
from truepose.cli import app
from truepose.commands.judgement import refuse
from truepose.commands.progress import quietly
from truepose.errors import InputError
from truepose.identification.fit.absurd import Judgement
from truepose.identification.leaves.fleet.work import Options
from truepose.pool import Cores
from truepose.shown.document import Document
from truepose.threads import cores

ENOUGH = "enough of it"
Heard = dict[str, Any]


def run(*words: object) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


def stopping_at(patch: pytest.MonkeyPatch, place: str) -> list[Heard]:
    """Arguments that a function of the library is called with; it goes no further."""
    heard: list[Heard] = []

    def called(*arguments: Any, **options: Any) -> None:
        heard.append({"": arguments, **options})
        raise InputError(ENOUGH)

    patch.setattr(place, called)
    return heard


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


GATED = {"calibrate": "identify", "diagnose": "identify", "drift": "drift"}


@pytest.mark.parametrize("command", GATED)
@pytest.mark.parametrize(
    "given", [(), ("--shuffled",), ("--anyway",), ("--irradiance", "i", "--irradiance", "k")]
)
def test_how_rows_are_read_reaches_the_check(
    command: str, given: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    if command == "drift" and "--irradiance" in given:
        return
    heard = stopping_at(monkeypatch, f"truepose.commands.{GATED[command]}.gated")
    assert ENOUGH in run(command, "m.yaml", "a.csv", "b.csv", "-o", "out", *given).stderr
    (told,) = heard
    assert told[""] == (Path("m.yaml"), [Path("a.csv"), Path("b.csv")])
    assert told["shuffled"] is ("--shuffled" in given) and told["anyway"] is ("--anyway" in given)
    assert list(told.get("irradiance", ())) == [Path(name) for name in given[1::2]]


@pytest.mark.parametrize(
    ("words", "tried"),
    [
        ([], None),
        (["--try-columns"], []),
        (["--try-columns", "all"], []),
        (["--try-columns", "room, ,oil,"], ["room", "oil"]),
        (["--try-columns", "--shuffled"], []),
        (["--try-columns", "there.csv"], []),
        (["--try-columns", "all,room"], ["all", "room"]),
    ],
)
def test_columns_to_try_are_all_or_those_named(
    words: list[str], tried: list[str] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Alone the option means all: before another one, before a file, at the end."""
    Path("there.csv").touch()
    heard = stopping_at(monkeypatch, "truepose.commands.identify.gated")
    run("diagnose", "m.yaml", "a.csv", "-o", "out", *words)
    assert heard[0]["tried"] == tried
    assert heard[0][""][1] == [Path("a.csv"), *([Path("there.csv")] if "there.csv" in words else [])]


def loaded(patch: pytest.MonkeyPatch, module: str) -> None:
    """A machine and rows that pass the check, unread."""
    machine = SimpleNamespace(name="arm", residual_units={"position": "mm", "rotation": "rad", "tilt": "rad"})
    check = SimpleNamespace(found=())
    patch.setattr(f"truepose.commands.{module}.gated", lambda *_, **__: (machine, "rows", check))


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ([], {"estimator": "map", "solver": "gn", "only": []}),
        (["--estimator", "ols", "--solver", "lm"], {"estimator": "ols", "solver": "lm"}),
        (["--only", " base, ,q4.theta,"], {"only": ["base", "q4.theta"]}),
    ],
)
def test_how_to_fit_reaches_the_fit(
    options: list[str], expected: Heard, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded(monkeypatch, "identify")
    heard = stopping_at(monkeypatch, "truepose.identification.fit.calibrate.calibrate")
    assert ENOUGH in run("calibrate", "m.yaml", "a.csv", "-o", "out", *options).stderr
    assert {key: heard[0][key] for key in expected} == expected and heard[0][""][1] == "rows"


@pytest.mark.parametrize(
    ("options", "accepted"),
    [
        ([], {}),
        (["50 nm"], {"position": 50e-6}),
        (["2e-3mm"], {"position": 2e-3}),
        (["1.5E+1 um", "0.01 rad"], {"position": 0.015, "rotation": 0.01, "tilt": 0.01}),
        ([".5 mrad"], {"rotation": 5e-4, "tilt": 5e-4}),
        (["1 mm", "2 mm"], {"position": 2.0}),
    ],
)
def test_an_accuracy_that_is_enough_is_that_of_every_reading_of_its_kind(
    options: list[str], accepted: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded(monkeypatch, "drift")
    heard = stopping_at(monkeypatch, "truepose.identification.leaves.drift.analysis.drift")
    words = [word for text in options for word in ("--accuracy", text)]
    assert ENOUGH in run("drift", "m.yaml", "a.csv", *words).stderr
    assert heard[0]["accuracy"] == pytest.approx(accepted)


FLEETS: dict[str, tuple[list[str], Callable[[Path], Options]]] = {
    "nothing": ([], lambda _: Options()),
    "anyway": (["--anyway"], lambda _: Options(anyway=True)),
    "shuffled": (["--shuffled"], lambda _: Options(shuffled=True)),
    "brief": (["--brief"], lambda _: Options(brief=True)),
    "limit": (["--limit", "0.5"], lambda _: Options(limit=0.5)),
    "prior": (["--prior", "p.yaml"], lambda here: Options(prior=here / "p.yaml")),
    "plug-in": (["--plugin", "mine.py"], lambda here: Options(plugins=(here / "mine.py",))),
}


@pytest.mark.parametrize("case", FLEETS)
@pytest.mark.parametrize("workers", [0, 3])
def test_how_a_fleet_is_worked_with_reaches_its_run(
    case: str, workers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Paths are whole: other processes read them. No number of machines at once means one for each processor."""
    Path("mine.py").touch()
    words, options = FLEETS[case]
    heard = stopping_at(monkeypatch, "truepose.identification.leaves.fleet.run.run_fleet")
    done = run("fleet", "line", "-o", "out", *words, *(["-j", workers] if workers else []))
    assert ENOUGH in done.stderr
    folders, pool, told = heard[0][""]
    assert (folders.machines, folders.results) == (tmp_path / "line", tmp_path / "out")
    assert told == options(tmp_path) and pool == Cores(workers or cores())


def test_a_fleet_says_what_was_done_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """And has failed where no machine could be diagnosed."""
    found = SimpleNamespace(diagnosed=())
    monkeypatch.setattr("truepose.identification.leaves.fleet.run.run_fleet", lambda *_, **__: found)
    for place, told in (
        ("fleet_json", {"machines": 1}),
        ("headline", "None."),
    ):
        monkeypatch.setattr(f"truepose.identification.leaves.fleet.words.{place}", lambda *_, said=told: said)
    document = "truepose.identification.leaves.fleet.page.fleet_document"
    monkeypatch.setattr(document, lambda _: Document("t", "one line"))
    done = run("fleet", "line", "-o", "out")
    assert (done.exit_code, done.stdout) == (2, f"one line\nreport: {Path('out') / 'fleet.html'}\n")
    assert done.stderr == f"error: line: None. {Path('out') / 'fleet.csv'} says why\n"
    found.diagnosed = (FAILED, STATISTICS)
    assert (run("fleet", "line", "-o", "out").exit_code, run("fleet", "line", "-o", "out").stderr) == (0, "")


SHOWN = [
    *("judgement", "status", "iterations", "rows", "chi2_per_dof", "rms", "validation_rms", "rank"),
    *("rows_that_do_not_fit", "free_parameters", "worst_parameter_sigma"),
]
"""What of a fit's JSON is printed, too."""
MISFIT = Judgement((("q1.r", 900.0),))


def test_what_is_no_calibration_ends_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """With its reason where that stands nowhere else: beside JSON, and where a command is quiet."""
    refuse(Judgement(), Path("out"), as_json=False)
    assert capsys.readouterr().err == ""
    reason, end = MISFIT.refusal, "out holds it to be looked at: no command applies it without --anyway\n"
    for as_json, quiet, why in (
        (False, False, "not calibrated, for the reason above"),
        (True, False, reason),
        (False, True, reason),
    ):
        with quietly(quiet), pytest.raises(Exception, match="2") as ended:
            refuse(MISFIT, Path("out"), as_json=as_json)
        assert getattr(ended.value, "exit_code", None) == 2
        assert capsys.readouterr().err == f"error: {why}; {end}"


@pytest.mark.parametrize("judged", [Judgement(), MISFIT])
@pytest.mark.parametrize("command", ["calibrate", "diagnose"])
def test_a_result_that_is_no_calibration_is_written_and_has_failed(
    command: str, judged: Judgement, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded(monkeypatch, "identify")
    at = "truepose.identification"
    result = SimpleNamespace(judgement=judged, notes=("a note",), fit=None, recording=None, began=None)
    fit = dict.fromkeys([*SHOWN, "beside"])
    for place, value in {
        "fit.calibrate.calibrate": result,
        "diagnosis.engine.diagnose": result,
        "diagnosis.stages.sizes": (),
        "diagnosis.outliers.far_rows": (),
        "fit.tool_pose.calibrated_pose": None,
        "report.results.calibration_json": fit,
        "report.files.write_calibration": ["a.yaml", "b.html"],
        "report.files.write_diagnosis": ["a.yaml", "b.html"],
        "report.terminal.calibration_lines": ["a line"],
        "report.terminal.diagnosis_lines": ["a line"],
        "report.terminal.diagnosis_summary": {"command": "diagnose"},
        "report.notes.diagnosis_notes": ["a note"],
        "report.judgement_words.diagnosis_judgement": judged,
    }.items():
        monkeypatch.setattr(f"{at}.{place}", lambda *_, said=value, **__: said)
    done = run(command, "m.yaml", "a.csv", "-o", "out")
    assert done.stdout == "a line\n" and done.stderr.startswith("note: a note\n")
    assert done.exit_code == (0 if judged.calibrated else 2)
    assert ("not calibrated, for the reason above" in done.stderr) is not judged.calibrated
    told = run(command, "m.yaml", "a.csv", "-o", "out", "--json")
    assert f'"command": "{command}"' in told.stdout and '"a note"' in told.stdout
    if command == "calibrate":
        assert '"out/a.yaml"' in told.stdout and "beside" not in told.stdout
