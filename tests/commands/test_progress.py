"""What is shown of long work: a line a stage, at least one every ten seconds, and the time left once it is known."""

from __future__ import annotations

import itertools
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.searched_arm import Case
from truepose.commands import identify, progress
from truepose.commands.progress import EVERY, Course, Lines, lasting, quietly
from truepose.identification.diagnosis import search as stages
from truepose.identification.diagnosis.diagnose import diagnose

DELAY = 2.0
FITTING = (
    ("fitting", 3.0),
    ("fitting without tolerances", 4.0),
    ("looking for rows", 2.0),
    ("writing the report", 1.0),
)
DIAGNOSING = (
    ("fitting without effects", 1.0),
    ("weighing", 5.0),
    ("naming and proving", 3.0),
    ("writing the report", 1.0),
)
"""Stages of some work, and about how long each takes beside the others."""


class Clock:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture(autouse=True)
def _usual(monkeypatch: pytest.MonkeyPatch) -> None:
    """The delay that users have; the test run sets a long one."""
    monkeypatch.setattr(progress, "DELAY", DELAY)


def begun(stages: progress.Stages = DIAGNOSING) -> tuple[Clock, Lines, list[str]]:
    clock, told = Clock(), list[str]()
    return clock, Lines(Course("diagnosing", stages, clock), told.append), told


def test_a_diagnosis_tells_the_stages_that_the_command_knows(tmp_path: Path) -> None:
    """Else nobody would see how far it is."""
    case, told = Case.of(tmp_path), list[str]()
    diagnose(case.signatures.machine, case.signatures.recording, progress=told.append)
    known = [stage for stage, _ in identify.DIAGNOSING]
    assert [next((s for s in known if text.startswith(s)), text) for text in told] == known[:-1]


def test_long_recordings_are_told_stage_by_stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the engine says of more rows begins as the command expects, and time left goes by rows."""
    case, told = Case.of(tmp_path), list[str]()
    monkeypatch.setattr(stages, "MANY", 10)
    machine, recording = case.signatures.machine, case.signatures.recording
    diagnose(machine, recording, progress=told.append)
    known = [stage for stage, _ in identify.diagnosing(stages.sizes(machine, recording))]
    assert len(known) > len(identify.DIAGNOSING)
    found = [max((s for s in known if text.startswith(s)), key=len, default=text) for text in told]
    assert found == known[:-1]


def test_quick_work_says_nothing() -> None:
    clock, lines, told = begun()
    for stage, _ in DIAGNOSING:
        clock.now += DELAY / 5
        lines.say(stage)
        lines.tick()
    assert told == []


def test_a_line_a_stage_and_one_every_ten_seconds() -> None:
    clock, lines, told = begun()
    for _ in range(3 * 2):
        clock.now += 0.5
        lines.tick()
    assert told == ["diagnosing (2 s)"]
    lines.say("weighing 758 explanations")
    assert told[1:] == ["weighing 758 explanations (stage 2 of 4, 3 s)"]
    times = [clock.now]
    for _ in range(200):
        clock.now += 0.5
        before = len(told)
        lines.tick()
        times += [clock.now] * (len(told) - before)
    assert len(times) == 11 and max(b - a for a, b in itertools.pairwise(times)) <= EVERY


UNEVEN = st.floats(1.0 / progress.TRUST**0.5, progress.TRUST**0.5)


@given(st.lists(UNEVEN, min_size=4, max_size=4), st.floats(1.0, 100.0), st.floats(0.0, 0.99))
def test_time_left_is_right_within_a_factor_of_two_where_stages_cost_about_what_they_should(
    uneven: list[float], rate: float, part: float
) -> None:
    clock = Clock()
    course = Course("diagnosing", DIAGNOSING, clock)
    spent = [rate * cost * own for (_, cost), own in zip(DIAGNOSING, uneven, strict=True)]
    for k, (stage, _) in enumerate(DIAGNOSING):
        course.say(f"{stage} of something")
        begun_at = clock.now
        for seconds in (0.0, part * spent[k]):
            clock.now = begun_at + seconds
            left = sum(spent[k:]) - seconds
            assert course.left is None or 0.5 * left <= course.left * 1.000001 <= 2.000001 * left
        assert course.left is None or k >= progress.FEWEST
        clock.now = begun_at + spent[k]


@given(st.integers(1, 40), st.integers(1, 40), st.floats(0.5, 100.0), st.data())
def test_time_left_of_counted_steps_is_right_within_a_factor_of_two(
    done: int, rest: int, rate: float, data: st.DataObject
) -> None:
    clock = Clock()
    course = Course("examining", (), clock)
    spent = [rate * data.draw(UNEVEN) for _ in range(done + rest)]
    clock.now += sum(spent[:done])
    course.count(done, done + rest)
    waited = data.draw(st.floats(0.0, 0.99)) * spent[done]
    clock.now += waited
    left = sum(spent[done:]) - waited
    assert course.left is None or 0.5 * left <= course.left * 1.000001 <= 2.000001 * left


@given(st.lists(st.floats(0.1, 500.0), min_size=4, max_size=4))
def test_no_time_left_is_shown_after_stages_that_cost_what_nobody_expected(spent: list[float]) -> None:
    """A diagnosis that weighs for six minutes, not for some seconds, does not say that six are left."""
    clock = Clock()
    course, rates = Course("diagnosing", DIAGNOSING, clock), list[float]()
    for (stage, cost), seconds in zip(DIAGNOSING, spent, strict=True):
        course.say(stage)
        if len(rates) < progress.FEWEST or max(rates) > progress.WITHIN**2 * min(rates):
            assert course.left is None
        clock.now += seconds
        if rates and seconds > 1.0001 * progress.TRUST * cost * max(rates):
            assert course.left is None
        rates.append(seconds / cost)


def test_time_left_is_right_where_stages_cost_what_they_should() -> None:
    clock = Clock()
    course = Course("diagnosing", DIAGNOSING, clock)
    for stage, cost in DIAGNOSING[:2]:
        course.say(stage)
        clock.now += 7.0 * cost
    course.say(DIAGNOSING[2][0])
    assert course.left == pytest.approx(7.0 * (DIAGNOSING[2][1] + DIAGNOSING[3][1]))
    assert course.words.endswith("(stage 3 of 4, 42 s, about 28 s left)")


def test_the_longer_beginning_tells_the_stage() -> None:
    course = Course("calibrating", FITTING, Clock())
    for text, stage in (("fitting", 1), ("fitting without tolerances", 2), ("something else", 2)):
        course.say(text)
        assert f"stage {stage} of 4" in course.words


def test_steps_that_are_counted_tell_how_many_and_how_long() -> None:
    clock = Clock()
    course = Course("examining", (), clock)
    clock.now += 30.0
    course.count(12, 48)
    course.say("examining: case012")
    assert course.words == "examining: case012 (12 of 48, 30 s, about 90 s left)"


@pytest.mark.parametrize(
    ("seconds", "told"), [(0.4, "0 s"), (99.4, "99 s"), (180.0, "3 min"), (7200.0, "2.0 h")]
)
def test_durations_read_well(seconds: float, told: str) -> None:
    assert lasting(seconds) == told


def test_quiet_work_says_nothing_however_long(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "DELAY", 0.0)
    with quietly(True), progress.progress("diagnosing") as say:
        say("weighing")
    assert capsys.readouterr().err == ""
    assert not progress.quiet()
    with progress.progress("diagnosing") as say:
        say("weighing")
    assert capsys.readouterr().err.startswith("weighing (")


@pytest.mark.parametrize(
    ("seconds", "told"),
    [(99.6, "2 min"), (5399.0, "90 min"), (5400.0, "1.5 h")],
)
def test_a_longer_duration_has_a_larger_unit(seconds: float, told: str) -> None:
    assert lasting(seconds) == told


@pytest.mark.parametrize(("done", "total", "left"), [(0, 0, None), (1, 51, None), (1, 50, 490.0)])
def test_of_steps_time_left_is_told_from_a_fiftieth_on(done: int, total: int, left: float | None) -> None:
    """Before that it would be a guess; of no steps nothing is done."""
    clock = Clock()
    course = Course("examining", (), clock)
    assert course.share is None and course.left is None
    clock.now += 10.0
    course.count(done, total)
    assert course.share == pytest.approx(done / max(total, 1))
    assert course.left == (None if left is None else pytest.approx(left))


@pytest.mark.parametrize(("seconds", "told"), [(1.1, ", about 1 s left"), (0.9, "")])
def test_less_than_a_second_is_not_told(seconds: float, told: str) -> None:
    clock = Clock()
    course = Course("examining", (), clock)
    clock.now += seconds
    course.count(1, 2)
    assert course.left_words == told


def test_stages_do_not_go_back() -> None:
    clock = Clock()
    course = Course("diagnosing", DIAGNOSING, clock)
    assert course.words == "diagnosing (0 s)" and course.share == 0.0
    for text, share in (("naming and proving", 0.6), ("weighing", 0.6), ("writing the report", 0.9)):
        course.say(text)
        assert course.share == pytest.approx(share)


def test_more_rows_cost_in_proportion() -> None:
    """A stage of as many rows as ``MANY`` costs what a fit and its weighing say, and the end is worked out with the last's."""
    assert identify.diagnosing([]) == list(identify.DIAGNOSING)
    again = sum(cost for _, cost in identify.AGAIN)
    last = identify.AGAIN[-1][1]
    for sizes in ([50_000], [100_000], [50_000, 200_000]):
        found = identify.diagnosing(sizes)
        parts = sum(cost for _, cost in found) - sum(cost for _, cost in identify.DIAGNOSING)
        assert parts == pytest.approx((again * sum(sizes) + last * sizes[-1]) / 50_000)
        assert dict(found)[f"weighing {sizes[-1]:,} rows"] == pytest.approx(last * sizes[-1] / 50_000)
        assert [found[0], found[-1]] == [identify.DIAGNOSING[0], identify.DIAGNOSING[-1]]


@pytest.mark.parametrize("stages", [(), (("weighing", 1.0), ("proving", 1.0))])
def test_a_bar_shows_what_goes_on_now(
    stages: progress.Stages, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And is gone at the end; of work that is over before anybody waits nothing is seen."""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    with progress.progress("diagnosing", stages) as say:
        say("weighing")
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(progress, "DELAY", 0.0)
    shown = ""
    with progress.progress("diagnosing", stages) as say:
        for _ in range(200):
            say("proving what was found")
            shown += capsys.readouterr().err
            if "proving what was found" in shown:
                break
            time.sleep(0.02)
    assert "proving what was found" in shown
    assert capsys.readouterr().err.endswith("\x1b[2K")  # the line is cleared


@pytest.mark.parametrize(
    ("stages", "shares"),
    [((), []), ((("weighing", 3.0), ("proving", 1.0)), [0.0, 0.75, 0.75])],
)
def test_a_bar_is_as_long_as_what_is_done(
    stages: progress.Stages, shares: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By what stages cost; where they are not known it has no end."""
    seen: list[dict[str, Any]] = []
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr("rich.progress.Progress.update", lambda _, task, **told: seen.append(told))
    with progress.progress("diagnosing", stages) as say:
        for text in ("weighing", "proving", "something else"):
            say(text)
    assert [told["description"] for told in seen] == ["weighing", "proving", "something else"]
    assert [told["completed"] for told in seen if "completed" in told] == shares
    assert {told.get("total") for told in seen} == ({1.0} if stages else {None})


def test_a_bar_of_steps_is_as_long_as_those_that_are_done(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[dict[str, Any]] = []
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr("rich.progress.Progress.update", lambda _, task, **told: seen.append(told))
    with progress.counted("fleet") as hear:
        for done in (1, 3, 4):
            hear(done, 4, f"machine {done}")
    assert [(told["description"], told["completed"]) for told in seen] == [
        ("fleet: machine 1", 0.25),
        ("fleet: machine 3", 0.75),
        ("fleet: machine 4", 1.0),
    ]
