"""One machine of a fleet: checked, calibrated, diagnosed, and written down with its record, or with the reason why not.

``done`` runs in whatever process the fleet has for it. Nothing that it writes depends on which one, or on where the fleet's
folder lies: files are told as seen from there.
"""

from __future__ import annotations

import contextlib
import html
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from truepose.errors import TrueposeError
from truepose.files import atomic_directory, atomic_write_text, mixed_files
from truepose.identification.leaves.fleet.folder import Member
from truepose.identification.leaves.fleet.limit import OverdueError, within
from truepose.identification.leaves.fleet.record import RECORD, Record, Status, figures_of, parameters_of
from truepose.models.load import DIAGNOSIS
from truepose.models.registry import load_plugin
from truepose.threads import one_thread

if TYPE_CHECKING:
    from truepose.identification.diagnosis.result import Diagnosis
    from truepose.identification.fit.calibrate import Calibration
    from truepose.identification.learned_prior import LearnedPrior
    from truepose.identification.load import Caution
    from truepose.identification.recording.recording import Recording
    from truepose.models.machine.machine import Machine

RESULTS = ("calibrated.yaml", "fit.json", DIAGNOSIS, "improved.yaml", "report.html")
"""What is written for a machine beside its record."""
_one_at_a_time = threading.Lock()
"""Workers of Dask may have several threads: a process takes one machine at a time all the same."""


@dataclass(frozen=True)
class Options:
    """How every machine is worked with.

    limit: minutes for each, None for as long as it takes; prior: what another fleet has taught; both paths absolute.
    """

    anyway: bool = False
    shuffled: bool = False
    brief: bool = False
    plugins: tuple[Path, ...] = ()
    limit: float | None = None
    prior: Path | None = None


@dataclass(frozen=True)
class Task:
    """A machine, the fleet's folder that it is told from, the folder of its results (absolute paths), and its key."""

    member: Member
    folder: Path
    output: Path
    key: str
    options: Options

    def record(self, status: Status, why: str = "") -> Record:
        """The record of a machine without a diagnosis."""
        return Record(self.member.name, self.key, status, self.told(" ".join(why.split())))

    def told(self, text: str) -> str:
        """A text with files as seen from the fleet's folder."""
        before = f"{self.folder}/"
        return text.replace(before, "").replace(html.escape(before), "")


@dataclass(frozen=True)
class _Result:
    caution: Caution
    calibration: Calibration
    diagnosis: Diagnosis


def done(task: Task) -> Record:
    """The record of a machine, whose results are in its folder then.

    Raises InputError where they cannot be written, and nothing else.
    """
    held = Record.read(task.output)
    if held is not None and held.key == task.key and held.final and not mixed_files(task.output / DIAGNOSIS):
        return (
            held  # of a run that was killed before it could note it, or of a worker that was lost afterwards
        )
    found = task.record("failed", task.member.why) if task.member.why else _tried(task)
    record = found if isinstance(found, Record) else _record(task, found)
    _write(task, record, None if isinstance(found, Record) else found)
    return record


def _tried(task: Task) -> _Result | Record:
    """What came out, or why nothing did."""
    try:
        with _one_at_a_time, one_thread(), within(task.options.limit):
            return _worked_out(task)
    except TrueposeError as exc:
        return task.record("failed", str(exc))
    except OverdueError:
        return task.record("broken", f"took longer than {task.options.limit:g} min")
    except Exception as exc:  # a fault of the program on one machine must not stop the others: its row tells
        return task.record("broken", f"unexpected {type(exc).__name__}: {exc}")


def _worked_out(task: Task) -> _Result | Record:
    from truepose.identification.diagnosis.diagnose import diagnose
    from truepose.identification.fit.calibrate import calibrate
    from truepose.identification.leaves.fleet.place_evidence import evidence
    from truepose.identification.load import load_checked

    for plugin in task.options.plugins:
        _load(plugin)
    member, options = task.member, task.options
    assert member.machine is not None
    caution, machine, rows = load_checked(member.machine, member.recordings, shuffled=options.shuffled)
    if machine is None or rows is None or (caution.refusal and not options.anyway):
        return task.record("wrong", caution.refusal)
    machine, rows = _seen_from(task, machine, rows)
    learned = None if options.prior is None else _prior(options.prior)
    diagnosis = diagnose(machine, rows, prior=learned, examine=evidence)
    return _Result(_told_caution(task, caution), calibrate(machine, rows), diagnosis)


@cache
def _load(plugin: Path) -> None:
    """Once in a process."""
    load_plugin(plugin)


@cache
def _prior(file: Path) -> LearnedPrior:
    """Read once in a process."""
    from truepose.identification.learned_prior import read_prior

    return read_prior(file)


def _seen_from(task: Task, machine: Machine, rows: Recording) -> tuple[Machine, Recording]:
    """Both with files as seen from the fleet's folder."""
    told = task.told
    if machine.file is not None:
        path = Path(told(str(machine.file.path)))
        machine = replace(
            machine, file=replace(machine.file, path=path), notes=tuple(map(told, machine.notes))
        )
    return machine, replace(rows, files=tuple(map(told, rows.files)), notes=tuple(map(told, rows.notes)))


def _told_caution(task: Task, caution: Caution) -> Caution:
    document = {name: _told(task, value) for name, value in caution.document.items()}
    return replace(caution, sentences=tuple(map(task.told, caution.sentences)), document=document)


def _told(task: Task, value: object) -> object:
    if isinstance(value, Mapping):
        return {name: _told(task, one) for name, one in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_told(task, one) for one in value]
    return task.told(value) if isinstance(value, str) else value


def _record(task: Task, result: _Result) -> Record:
    from truepose.identification.leaves.fleet.evidence import kept
    from truepose.identification.report.json_text import finite
    from truepose.identification.report.results import diagnosis_json, diagnosis_judgement

    document, judgement = diagnosis_json(result.diagnosis), diagnosis_judgement(result.diagnosis)
    return replace(
        task.record("done" if judgement.calibrated else "refused", "; ".join(judgement.why)),
        figures=figures_of(document, result.caution.verdict),
        parameters=parameters_of(document),
        evidence=finite(kept(result.diagnosis)),
    )


def _write(task: Task, record: Record, result: _Result | None) -> None:
    """Write results, and the record last: where it is, they are whole. Remove older ones before."""
    from truepose.identification.report.files import put_both

    for name in (RECORD, *RESULTS):
        with contextlib.suppress(OSError):
            (task.output / name).unlink()
    with atomic_directory(task.output, last=RECORD) as partial:
        if result is not None:
            put_both(result.calibration, result.diagnosis, result.caution, partial, brief=task.options.brief)
        atomic_write_text(partial / RECORD, record.text() + "\n")
