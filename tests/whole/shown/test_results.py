"""Every result on one screen, as a data frame, pickled and copied."""

from __future__ import annotations

import copy
import inspect
import pickle
import re
from dataclasses import replace
from pathlib import Path

import joblib
import pandas as pd
import pytest

from support.reports import arm, own_markup, synthetic
from support.results import RESULTS, calibration, diagnosis, drifting, machine, recording, same
from truepose.errors import InputError
from truepose.identification.recording.recording import Recording
from truepose.identification.report.verdict import headline
from truepose.shown.result import Shown
from truepose.shown.text import LINES, WIDTH

HOSTILE = "<img src=x onerror=alert(1)>\x1b[31m\n&amp;"
each = pytest.mark.parametrize("name", RESULTS)


def _fits(result: Shown) -> list[str]:
    shown = repr(result).split("\n")
    assert len(shown) <= LINES and max(map(len, shown)) <= WIDTH
    assert "cannot be shown" not in shown[0]
    assert all(line.isprintable() for line in shown)
    return shown


@each
def test_a_repr_is_one_screen(name: str) -> None:
    _fits(RESULTS[name]())


@each
def test_frames_have_the_columns_that_are_documented(name: str) -> None:
    result = RESULTS[name]()
    frame = result.to_frame()
    assert isinstance(frame, pd.DataFrame)
    _, _, said = (inspect.getdoc(type(result)) or "").partition("``to_frame()``:")
    documented = set(re.findall(r"``([a-z_.]+)``", said))
    joints_and_readings = name.startswith(
        ("recording", "some", "no rows", "plan", "experiment", "compensation", "inverse")
    )
    if not joints_and_readings and "Estimate" not in said:
        assert documented >= set(frame.columns)
    elif name.startswith(("compensation", "inverse")):
        assert documented - {"<joint>.nominal"} <= set(frame.columns)


@each
def test_pickles_and_copies_hold_the_same(name: str, tmp_path: Path) -> None:
    result = RESULTS[name]()
    joblib.dump(result, tmp_path / "result.joblib")
    for again in (
        pickle.loads(pickle.dumps(result)),
        copy.deepcopy(result),
        joblib.load(tmp_path / "result.joblib"),
    ):
        assert same(again, result)
        assert repr(again) == repr(result)


def test_a_recording_stays_read_only() -> None:
    for again in (pickle.loads(pickle.dumps(recording())), copy.deepcopy(recording().subset([0, 1]))):
        arrays = [again.q, again.time, *again.observations.values(), again.whole.q]
        assert isinstance(again, Recording) and not any(array.flags.writeable for array in arrays)


def test_a_diagnosis_says_the_report_s_headline_and_what_it_is_worth() -> None:
    text = " ".join(line.strip() for line in _fits(diagnosis()))
    assert headline(diagnosis())[0] in text
    assert (
        "position error, rms: 9.08 µm with the ordinary fit, 10.6 µm held to the drawing, 8.15 µm after; on"
        in text
    )
    assert "platform that bends at platform (platform-deformation)" in text


def test_a_calibration_says_the_report_s_sentence() -> None:
    shown = _fits(calibration())
    assert shown[0].startswith("telescope was fitted, but the fit leaves more than noise")
    frame = calibration().to_frame()
    worst = frame["parameter"].iloc[int(frame["in_tolerances"].abs().argmax())]
    assert any(f"farthest parameter {worst} at " in line for line in shown)


def test_a_machine_says_its_joints_and_how_many_constants_are_free() -> None:
    shown = _fits(machine("polisher"))
    free = sum(p.free for p in machine("polisher").parameters)
    assert f"{len(machine('polisher').parameters)} constants, {free} of them free" in shown[0]
    assert any("q4" in line and "-60 .. 60" in line and "deg" in line for line in shown)


def test_hostile_names_move_no_cursor(tmp_path: Path) -> None:
    made_up = synthetic(replace(arm(tmp_path), name=HOSTILE))
    read = replace(
        made_up.recording, files=(HOSTILE,), notes=(HOSTILE,), drivers={HOSTILE: made_up.recording.q[:, 0]}
    )
    for result in (
        made_up,
        made_up.nominal,
        made_up.free,
        read,
        replace(made_up.findings[0], explanation=HOSTILE),
    ):
        _fits(result)


def test_numbers_of_a_fit_are_those_of_its_frame() -> None:
    fit, frame = calibration().fit, calibration().to_frame().set_index("parameter")
    for k, parameter in enumerate(machine().parameters):
        if parameter.free:
            row = frame.loc[parameter.name]
            assert (
                row["value"] == fit.p[k] and row["std"] == fit.std[k] and row["nominal"] == parameter.nominal
            )
        else:
            assert parameter.name not in frame.index
    effects = diagnosis().after.to_frame()
    names = [name for effect in diagnosis().after.effects for name in effect.parameter_names]
    assert effects["parameter"].tolist()[-len(names) :] == names
    assert effects["nominal"].tail(len(names)).isna().all()


def test_write_gives_the_files_of_the_commands(tmp_path: Path) -> None:
    written = {
        "calibration": {"calibrated.yaml", "fit.json", "report.html"},
        "diagnosis": {"diagnosis.json", "improved.yaml", "report.html"},
        "drift": {"drift.json", "report.html"},
    }
    for result in (calibration(), diagnosis(), drifting()):
        kind = type(result).__name__.lower()
        paths = result.write(tmp_path / kind)
        assert {path.name for path in paths} == written[kind]
        assert all(path.is_file() and path.parent == tmp_path / kind for path in paths)
        report = result.report(str(tmp_path / f"{kind}.html"))
        assert report.read_bytes() == (tmp_path / kind / "report.html").read_bytes()
        assert own_markup(report.read_text(encoding="utf-8"))


def test_a_report_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot write the file"):
        calibration().report(tmp_path / "nowhere" / "x.html")
    with pytest.raises(InputError, match="Is a directory"):
        calibration().report(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="expected a directory"):
        diagnosis().write(tmp_path / "file")


def test_workers_take_results_and_give_them_back() -> None:
    for result in (machine(), recording()):
        (back,) = joblib.Parallel(n_jobs=2)(joblib.delayed(copy.copy)(one) for one in [result])
        assert same(back, result)
