"""One machine of a fleet, and a fleet worked with in this process: what is kept, what is tried again, how files are told."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from support.tiny_fleets import rows, write_machine
from truepose.errors import InputError
from truepose.identification.leaves.check.run import check_files
from truepose.identification.leaves.fleet.folder import Member, members
from truepose.identification.leaves.fleet.pooled import rows_of
from truepose.identification.leaves.fleet.record import Record, write_records
from truepose.identification.leaves.fleet.run import DEAD, run_fleet, settings_of
from truepose.identification.leaves.fleet.work import RECORD, RESULTS, Options, Task, work_on
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

DIAGNOSE = "truepose.identification.diagnosis.diagnose.diagnose"


class DeadError(Exception):
    """What a pool raises for a task whose process died."""


class Here(Executor):
    """Tasks one after the other in this process; those of machines named ``dead`` kill theirs."""

    at_once, dead = 1, DeadError

    @contextmanager
    def executor(self) -> Iterator[Executor]:
        yield self

    def submit(self, work: Callable[..., Any], /, *arguments: Any, **_: Any) -> Future[Any]:
        (task,), future = arguments, Future[Any]()
        if task.member.name == "dead":
            future.set_exception(DeadError())
        else:
            future.set_result(work(task))
        return future


def asked(folder: Path, recording: pd.DataFrame | None = None, **options: Any) -> Task:
    """Of a machine in a fleet's folder, with ``line & sons`` for its name."""
    line = folder / "line & sons"
    write_machine(line / "arm", rows(1) if recording is None else recording)
    (member,) = members(line, folder / "results")
    return Task(member, line, folder / "results" / "arm", "key", Options(brief=True, **options))


def test_a_machine_that_failed_leaves_its_record_alone(tmp_path: Path) -> None:
    one = asked(tmp_path, rows(1).drop(columns="q2"))
    one.output.mkdir(parents=True)
    for name in RESULTS:
        (one.output / name).write_text("of other files", encoding="utf-8")
    found = work_on(one)
    assert found.status == "failed" and found.why.startswith("arm/recording.csv: missing column 'q2'")
    assert [path.name for path in one.output.iterdir()] == [RECORD]
    assert one.kept() == found
    unread = replace(one, member=Member("arm", why="two \n machine files"), key="other")
    assert work_on(unread) == Record(name="arm", key="other", status="failed", why="two machine files")
    assert one.kept() is None


@pytest.mark.parametrize(
    ("key", "status", "is_kept"),
    [("key", "done", True), ("key", "refused", True), ("key", "broken", False), ("other", "done", False)],
)
def test_what_the_same_files_would_give_again_is_kept(
    tmp_path: Path, key: str, status: Any, is_kept: bool
) -> None:
    one, before = asked(tmp_path), Record(name="arm", key=key, status=status, why="as it was")
    one.output.mkdir(parents=True)
    write_records(one.output / RECORD, [before])
    assert one.kept() == (before if is_kept else None)
    (one.output / "improved.yaml").write_text("another run's", encoding="utf-8")
    (one.output / "diagnosis.json").write_text('{"files_sha256": {"improved.yaml": "0"}}', encoding="utf-8")
    assert one.kept() is None


@pytest.mark.parametrize("fault", [InputError, ZeroDivisionError])
@pytest.mark.parametrize("has_prior", [False, True])
def test_a_diagnosis_is_given_what_the_options_say(
    tmp_path: Path, has_prior: bool, fault: type[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = list[Any]()

    def diagnose(*given: Any, prior: Any, examine: Any) -> None:
        seen.extend([*given, prior])
        raise fault("no more than that")

    monkeypatch.setattr(DIAGNOSE, diagnose)
    monkeypatch.setattr("truepose.identification.learned_prior.read_prior", lambda file: f"of {file.name}")
    found = work_on(asked(tmp_path, prior=tmp_path / "prior.yaml" if has_prior else None))
    told = {
        InputError: ("failed", "no more than that"),
        ZeroDivisionError: ("broken", "unexpected ZeroDivisionError: no more than that"),
    }
    assert (found.status, found.why) == told[fault]
    machine, recording, prior = seen
    assert machine.file.path == Path("arm/machine.yaml") and recording.files == ("arm/recording.csv",)
    assert prior == ("of prior.yaml" if has_prior else None)


@pytest.mark.parametrize("anyway", [False, True])
@pytest.mark.parametrize("loaded", [False, True])
def test_files_that_do_not_belong_together_are_worked_with_where_it_is_asked_for(
    tmp_path: Path, anyway: bool, loaded: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As long as there is something to work with: of a machine without a sensor there are no rows."""

    def diagnose(*_: Any, **__: Any) -> None:
        raise InputError("reached")

    one = asked(tmp_path, anyway=anyway)
    assert one.member.machine is not None
    whole = load_machine(one.member.machine)
    read = load_recording(whole, one.member.recordings)
    text = one.member.machine.read_text(encoding="utf-8")
    one.member.machine.write_text(text.partition("sensor:")[0], encoding="utf-8")
    wrong, *nothing = check_files(one.member.machine, one.member.recordings)
    given = (wrong, whole, read) if loaded else (wrong, *nothing)
    monkeypatch.setattr(DIAGNOSE, diagnose)
    monkeypatch.setattr("truepose.identification.leaves.check.gate.check_files", lambda *_, **__: given)
    found = work_on(one)
    assert found.status == ("failed" if anyway and loaded else "wrong")
    assert (found.why == "reached") is (anyway and loaded)


# -- a whole run ---------------------------------------------------------------------------------------


def test_every_setting_is_one_of_what_results_depend_on(tmp_path: Path) -> None:
    plugin, other, prior = (tmp_path / name for name in ("plugin.py", "other.py", "prior.yaml"))
    for file in (plugin, other, prior):
        file.write_text(file.name, encoding="utf-8")
    options = [
        Options(), Options(anyway=True), Options(shuffled=True), Options(brief=True), Options(plugins=(plugin,)),
        Options(plugins=(other,)), Options(plugins=(plugin, other)), Options(prior=prior), Options(plugins=(prior,)),
    ]  # fmt: skip
    told = [settings_of(one) for one in options]
    assert len(set(told)) == len(told)
    plugin.write_text("changed", encoding="utf-8")
    assert [settings_of(one) == was for one, was in zip(options, told, strict=True)] == [
        "plugin.py" not in str(one.plugins) for one in options
    ]


def test_a_run_says_how_far_it_is_and_tries_again_what_died(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Machines whose files cannot be read, or whose process dies, are rows like all others; these alone are tried again."""
    line, results, key = tmp_path / "line", tmp_path / "results", Member.key
    for name in ("dead", "lost", "unread"):
        write_machine(line / name, rows(1).drop(columns="q2"))

    def lost(member: Member, folder: Path, settings: str) -> str:
        if member.name == "lost" and not member.why:
            raise OSError(2, "No such file", str(line / "lost" / "rows.csv"))
        return key(member, folder, settings)

    monkeypatch.setattr(Member, "key", lost)
    heard = list[tuple[int, int, str]]()
    fleet = run_fleet(line, results, Here(), Options(), progress=lambda *told: heard.append(told))
    names = ("dead", "lost", "unread")
    assert heard == [
        *((k, 3, f"looking for changes, {name}") for k, name in enumerate(names)),
        (0, 3, "3 of 3 to work with"), (1, 3, "lost"), (2, 3, "unread"), (3, 3, "dead"), (1, 1, "what they say together"),
    ]  # fmt: skip
    told = [(row.name, row.status, row.why.partition(":")[0]) for row in rows_of(fleet.table)]
    assert told == [
        ("dead", "broken", DEAD), ("lost", "failed", "cannot read rows.csv"), ("unread", "failed", "unread/recording.csv"),
    ]  # fmt: skip
    assert fleet.changes is None
    again = run_fleet(line, results, Here(), Options(), progress=lambda *told: heard.append(told))
    assert heard[-3:] == [(0, 1, "1 of 3 to work with"), (1, 1, "dead"), (1, 1, "what they say together")]
    assert again.table["name"].tolist() == list(names) and again.changes is not None
