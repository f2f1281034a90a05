"""A whole fleet: what is left to do is done side by side, then the table, the page and the prior are made.

Where things are, in the folder of results:

    machines/NAME/    what calibrate and diagnose write of a machine, and record.json; published whole
    journal.jsonl     records of a run that has not ended
    records.jsonl     records of the last run that has
    fleet.csv, fleet.json, fleet.html, prior.yaml

A machine is done again when its key changes: the contents of its files, the options and the version of truepose.

At the end records are put together and added up, and table, page and prior are made of them. No machine's folder is opened;
memory holds a group of records and the rows of the table.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from truepose.errors import InputError
from truepose.faults import reason
from truepose.files import atomic_directory
from truepose.identification.learned_prior import (
    MOST,
    EffectPrior,
    LearnedPrior,
    PlacePrior,
    ToleranceNote,
    read_prior,
    write_prior,
)
from truepose.identification.leaves.fleet.files import DOCUMENT, PAGE, put_fleet
from truepose.identification.leaves.fleet.folder import Member, members
from truepose.identification.leaves.fleet.record import (
    JOURNAL,
    RECORDS,
    SCHEMA,
    Changes,
    Comparison,
    Record,
    Records,
    paired,
)
from truepose.identification.leaves.fleet.statistics import Tree, statistics, trees
from truepose.identification.leaves.fleet.summary import KEPT, Gathered, Summary
from truepose.identification.leaves.fleet.table import SHOWN, Fleet, Row, oddness, row, write_rows
from truepose.identification.leaves.fleet.work import Options, Task, done
from truepose.pool import Pool, each
from truepose.publication import held
from truepose.version import VERSION

# -- From a fleet's summary to the prior of the next machine

SMALLEST = 1e-4
"""Share of a size below which it is written as this."""


def learned(summary: Summary) -> LearnedPrior:
    """What the fleet says of machines to come; without machines the prior of ``truepose.identification.prior``.

    ``truepose.identification.learned_prior.write_prior(path, learned(summary))`` writes the file.
    """
    effects = {effect: _effect(tree) for effect, tree in sorted(trees(summary).items())}
    kinds = summary.mechanisms
    tolerances = {
        f"{one.mechanism}: {one.parts}" if len(kinds) > 1 else one.parts: ToleranceNote(
            deviations=one.deviations,
            ratio=short(one.ratio.value),
            low=short(one.ratio.low),
            high=short(one.ratio.high),
        )
        for one in statistics(summary).tolerances
    }
    return LearnedPrior(
        schema="truepose/prior/1",
        machines=summary.machines,
        mechanisms=kinds,
        effects=effects,
        tolerances=tolerances,
    )


def _effect(tree: Tree) -> EffectPrior:
    places: dict[str, dict[str, PlacePrior]] = {}
    for k, (mechanism, place) in enumerate(tree.places):
        of = tree.hierarchy.place(k)
        places.setdefault(mechanism, {})[place] = PlacePrior(
            machines=tree.machines[k],
            found=short(tree.found[k]),
            frequency=short(of.mean),
            usual=short(float(1.0 / (1.0 + np.exp(-of.usual)))),
            odds=_odds(of.log_factor),
        )
    return EffectPrior(
        machines=max(tree.machines),
        odds=_odds(tree.hierarchy.elsewhere.log_factor),
        sizes=tuple(max(short(share), SMALLEST) for share in tree.hierarchy.sizes.tolist()),
        places=places,
    )


def _odds(log_factor: float) -> float:
    return short(float(np.clip(np.exp(log_factor), 1.0 / MOST, MOST)))


def short(value: float) -> float:
    """Four digits: the file is made for reading, and what is read is what was learned."""
    return float(f"{value:.4g}")


TABLE, PRIOR = "fleet.csv", "prior.yaml"
# -- The end of a run over a fleet: records and their sums are put together, and table, page and prior are made of them

TOGETHER = 64
"""Machines that are worked out at once: more would fill the memory, fewer take longer."""
FILES = (TABLE, DOCUMENT, PAGE, PRIOR)


@dataclass(frozen=True)
class Folders:
    """Where a fleet's machines are, and where its results go (absolute paths)."""

    machines: Path
    results: Path

    @classmethod
    def of(cls, machines: Path, results: Path) -> Folders:
        """Raises InputError where both are one."""
        found = cls(machines.resolve(), results.resolve())
        if found.machines == found.results:
            raise InputError(f"{results}: expected another folder for the results than that of the machines")
        return found

    @property
    def records(self) -> Records:
        """What was kept when the last run ended."""
        return Records(self.results / RECORDS)

    @property
    def journal(self) -> Records:
        """What has been done since."""
        return Records(self.results / JOURNAL)


def ended(keys: Mapping[str, str], folders: Folders, *, brief: bool) -> Fleet:
    """What the fleet of these machines (keys by name) says now, and all files that say it, published in one step.

    ``brief``: machines have no reports that the page could lead to.
    """
    comparison, sums = Comparison(), _Sum()

    def records() -> Iterator[Record]:
        """By name; sums and differences are whole when all were taken."""
        for old, new in paired(folders.records.read(), folders.journal.read(keys)):
            now = new or (old if old is not None and old.name in keys else None)
            comparison.take(old, now)
            sums.take(now)
            if now is not None:
                yield now

    with atomic_directory(folders.results) as partial:
        after = Records(partial / RECORDS)
        after.write(records())
        summary = sums.total()
        changes = comparison.result() if folders.records.exists else None
        rows = list(_rows(after.read(), summary))
        write_rows(partial / TABLE, rows)
        write_prior(partial / PRIOR, learned(summary))
        fleet = _fleet(folders.machines.name, rows, summary, changes, brief)
        put_fleet(fleet, partial)
    return fleet


class _Sum:
    """The sums of records taken one after the other; some wait, for many are added up as quickly as two."""

    def __init__(self) -> None:
        self._sum, self._waiting = Summary.empty(), Gathered()

    def take(self, record: Record | None) -> None:
        """What a machine adds."""
        if record is not None and _counts(record):
            self._waiting.take(record.evidence)
        if self._waiting.machines >= TOGETHER:
            self.total()

    def total(self) -> Summary:
        """Of all."""
        self._sum += Summary.of_columns(self._waiting.columns)
        self._waiting = Gathered()
        return self._sum


def _counts(record: Record) -> bool:
    """Whether the fleet's statistics have a machine: one that is no calibration would say of parts what is not so."""
    return record.status == "done"


def _rows(records: Iterator[Record], summary: Summary) -> Iterator[Row]:
    """Rows of the table. Of a machine that no statistics are made of it is not said how odd it is."""
    while group := list(islice(records, TOGETHER)):
        rows, counted, gathered = list[Row](), list[int](), Gathered()
        for k, record in enumerate(group):
            rows.append(row(record))
            if _counts(record):
                counted.append(k)
                gathered.take(record.evidence)
        for k, odd in zip(counted, oddness(gathered.columns, summary), strict=True):
            rows[k] = rows[k].with_oddness(odd)
        yield from rows


def _fleet(name: str, rows: Sequence[Row], summary: Summary, changes: Changes | None, brief: bool) -> Fleet:
    """The whole outcome: counts, and no more than ``SHOWN`` rows of each kind."""
    odd = sorted((r for r in rows if r.odd), key=lambda r: (-(r.oddness or 0.0), r.name))
    undone = [r for r in rows if r.status not in ("done", "refused")]
    return Fleet(
        name,
        len(rows),
        dict(Counter(r.status for r in rows)),
        dict(Counter(r.verdict for r in rows if r.verdict)),
        statistics(summary),
        len(odd),
        odd[:SHOWN],
        undone[:SHOWN],
        rows[:SHOWN],
        changes,
        brief,
    )


# -- A whole fleet: what is left to do is done side by side, then the table, the page and the prior are made

MACHINES = "machines"
DEAD = "its process died twice, the second time with no other machine beside it"
Progress = Callable[[int, int, str], None]


def run_fleet(
    folders: Folders, pool: Pool, options: Options, *, progress: Progress = lambda *_: None
) -> Fleet:
    """Do what is left to do, and write down what the fleet says.

    ``progress`` hears how many machines are done, of how many, and the latest. Raises InputError where there is no machine,
    where results cannot be written, and where another run is at work in the same folder.
    """
    found = members(folders.machines, folders.results)
    if options.prior is not None:
        read_prior(options.prior)  # what is wrong with it is no machine's fault
    try:
        with _alone(folders) as journal:
            keys = _work(found, folders, pool, options, progress)
            progress(1, 1, "what they say together")
            fleet = ended(keys, folders, brief=options.brief)
            journal.path.unlink()
    except OSError as exc:
        raise InputError(f"{folders.results}: cannot write the results: {reason(exc)}") from exc
    return fleet


@contextlib.contextmanager
def _alone(folders: Folders) -> Iterator[Records]:
    """The journal of the folder of results, in which no other run may be at work meanwhile."""
    folders.results.mkdir(parents=True, exist_ok=True)
    journal = folders.journal
    journal.open().close()
    with held(journal.path, wait=False) as free:
        if not free:
            raise InputError(
                f"{folders.results}: found another run of truepose fleet at work there, expected none"
            )
        yield journal


def settings_of(options: Options) -> str:
    """What all results depend on beside a machine's own files."""
    files = [*options.plugins, *([options.prior] if options.prior else [])]
    digests = [hashlib.sha256(path.read_bytes()).hexdigest() for path in files]
    told = [SCHEMA, KEPT, VERSION, options.anyway, options.shuffled, options.brief, options.prior is not None]
    return json.dumps([*told, digests])


def _work(
    found: Sequence[Member], folders: Folders, pool: Pool, options: Options, progress: Progress
) -> Mapping[str, str]:
    """Bring every machine up to date; their keys, by name."""
    settings, journal = settings_of(options), folders.journal
    there = folders.records.keys() | journal.keys()
    keys, todo = dict[str, str](), list[Task]()
    for count, member in enumerate(found):
        progress(count, len(found), f"looking for changes, {member.name}")
        task = _task(member, folders, settings, options)
        keys[member.name] = task.key
        if there.get(member.name) != task.key:
            todo.append(task)
    progress(0, max(len(todo), 1), f"{len(todo)} of {len(found)} to work with")
    with journal.open() as stream:
        for finished, (task, record) in enumerate(each(done, todo, pool), start=1):
            journal.note(stream, record or task.record("broken", DEAD))
            progress(finished, len(todo), task.member.name)
    return keys


def _task(member: Member, folders: Folders, settings: str, options: Options) -> Task:
    """A machine with its key; one whose files cannot be read is one that says so."""
    task = partial(
        Task, folder=folders.machines, output=folders.results / MACHINES / member.name, options=options
    )
    try:
        return task(member, key=member.key(folders.machines, settings))
    except OSError as exc:
        unread = Member(member.name, why=f"cannot read {Path(str(exc.filename)).name}: {exc.strerror}")
        return task(unread, key=unread.key(folders.machines, settings))
