"""One machine of a fleet: checked, calibrated, diagnosed, and written down with its record, or with the reason why not.

``work_on`` runs in whatever process the fleet has for it, in the fleet's folder: files are told as seen from there, so that
nothing depends on where it lies.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from truepose.errors import InputError, TrueposeError
from truepose.files import atomic_directory, mixed_files
from truepose.identification.leaves.fleet.folder import Member
from truepose.identification.leaves.fleet.record import (
    Record,
    Status,
    figures_of,
    parameters_of,
    read_records,
    write_records,
)
from truepose.models.load import DIAGNOSIS
from truepose.models.registry import load_plugin
from truepose.threads import one_thread

RECORD = "record.json"
Write = Callable[[Path], object]
"""What writes results into a folder."""
RESULTS = ("calibrated.yaml", "fit.json", DIAGNOSIS, "improved.yaml", "report.html")
"""What is written for a machine beside its record."""
_one_at_a_time = threading.Lock()
"""Workers of Dask may have several threads: a process takes one machine at a time all the same."""
_load_once = cache(load_plugin)


@dataclass(frozen=True)
class Options:
    """How every machine is worked with; paths absolute. prior: what another fleet has taught."""

    anyway: bool = False
    shuffled: bool = False
    brief: bool = False
    plugins: tuple[Path, ...] = ()
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
        """Return the record of a machine without a diagnosis."""
        return Record(name=self.member.name, key=self.key, status=status, why=" ".join(why.split()))

    def kept(self) -> Record | None:
        """Return the record of an earlier run, if the same files would give the same again and its results are whole."""
        held = read_records(self.output / RECORD).get(self.member.name)
        if held is None or held.key != self.key or held.status == "broken":
            return None
        return None if mixed_files(self.output / DIAGNOSIS) else held


def work_on(task: Task) -> Record:
    """Return the record of a machine, whose results are in its folder then: the record last, older ones removed before.

    Raises InputError where they cannot be written, and nothing else.
    """
    with atomic_directory(task.output, last=RECORD) as partial:
        with _one_at_a_time, one_thread(), contextlib.chdir(task.folder):
            record, write = _tried(task)
            write(partial)
        write_records(partial / RECORD, [record])
        for name in (RECORD, *RESULTS):
            with contextlib.suppress(OSError):
                (task.output / name).unlink()
    return record


def _tried(task: Task) -> tuple[Record, Write]:
    """Return what came out, and what writes its files; or why nothing did."""
    try:
        if task.member.why:
            raise InputError(task.member.why)
        return _worked_out(task)
    except TrueposeError as exc:
        return task.record("failed", str(exc)), _write_nothing
    except Exception as exc:  # a fault of the program on one machine must not stop the others: its row tells
        return task.record("broken", f"unexpected {type(exc).__name__}: {exc}"), _write_nothing


def _write_nothing(_: Path) -> None:
    """Leave a machine's folder with its record alone."""


def _worked_out(task: Task) -> tuple[Record, Write]:
    from truepose.identification.diagnosis.diagnose import diagnose
    from truepose.identification.fit.calibrate import calibrate
    from truepose.identification.learned_prior import read_prior
    from truepose.identification.leaves.fleet.evidence import evidence, kept
    from truepose.identification.load import load_checked
    from truepose.identification.report.files import put_both
    from truepose.identification.report.json_text import finite
    from truepose.identification.report.results import diagnosis_json, diagnosis_judgement

    options = task.options
    for plugin in options.plugins:
        _load_once(plugin)
    machine_file, *recordings = (Path(os.path.relpath(path)) for path in task.member.inputs)
    caution, machine, rows = load_checked(machine_file, recordings, shuffled=options.shuffled)
    if machine is None or rows is None or (caution.refusal and not options.anyway):
        return task.record("wrong", caution.refusal), _write_nothing
    learned = None if options.prior is None else read_prior(options.prior)
    diagnosis = diagnose(machine, rows, prior=learned, examine=evidence)
    calibration = calibrate(machine, rows)
    document, judgement = diagnosis_json(diagnosis), diagnosis_judgement(diagnosis)
    record = Record(
        name=task.member.name,
        key=task.key,
        status="done" if judgement.calibrated else "refused",
        why="; ".join(judgement.why),
        figures=figures_of(document, caution.verdict),
        parameters=parameters_of(document),
        evidence=finite(kept(diagnosis)),
    )
    return record, lambda folder: put_both(calibration, diagnosis, caution, folder, brief=options.brief)
