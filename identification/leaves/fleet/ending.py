"""The end of a run over a fleet: records and their sums are put together, and table, page and prior are made of them.

No machine's folder is opened. Records are read one group after the other, so that memory holds a group of them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from truepose.errors import InputError
from truepose.files import atomic_directory
from truepose.identification.leaves.fleet.changes import Changes, Comparison, paired
from truepose.identification.leaves.fleet.columns import Gathered
from truepose.identification.leaves.fleet.files import DOCUMENT, PAGE, put_fleet
from truepose.identification.leaves.fleet.learn import learned
from truepose.identification.leaves.fleet.odd import oddness
from truepose.identification.leaves.fleet.prior_file import write_prior
from truepose.identification.leaves.fleet.record import Record
from truepose.identification.leaves.fleet.result import SHOWN, Fleet
from truepose.identification.leaves.fleet.statistics import statistics
from truepose.identification.leaves.fleet.store import JOURNAL, Journal, Line, Store, groups
from truepose.identification.leaves.fleet.summary import Summary
from truepose.identification.leaves.fleet.table import Row, row, write_rows

TABLE, PRIOR = "fleet.csv", "prior.yaml"
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
    def store(self) -> Store:
        """What was kept when the last run ended."""
        return Store(self.results)

    @property
    def journal(self) -> Journal:
        """What has been done since."""
        return Journal(self.results / JOURNAL)


def ended(keys: Mapping[str, str], folders: Folders, *, brief: bool) -> Fleet:
    """What the fleet of these machines (keys by name) says now, and all files that say it.

    ``brief``: machines have no reports that the page could lead to.
    """
    now, shown = _Now(keys, folders.store, folders.journal), _Shown()
    with atomic_directory(folders.results) as partial:
        after = Store(partial)
        after.write(now.lines())
        after.write_summary(now.summary)
        changes = now.comparison.result() if folders.store.exists else None
        write_rows(partial / TABLE, map(shown.take, _rows(after.lines(), now.summary)))
        write_prior(partial / PRIOR, learned(now.summary))
        fleet = shown.fleet(folders.machines.name, now.summary, changes, brief)
        put_fleet(fleet, partial)
    return fleet


class _Now:
    """The records of a fleet as it is now, how they differ from those of the last run, and their sums."""

    def __init__(self, keys: Mapping[str, str], before: Store, journal: Journal) -> None:
        self._keys, self._before, self._journal = keys, before, journal
        self.comparison = Comparison()
        self.summary = Summary.empty()

    def lines(self) -> Iterator[Line]:
        """By name; sums and differences are whole when all were taken. What is as it was is passed on unread.

        The sums of the last run are brought up to date; where there are none, its records are added up.
        """
        sums = self._before.summary() or _summed(self._before.records())
        added, taken, count = _Sum(), _Sum(), 0
        for old, new in paired(self._before.lines(), self._journal.lines(self._keys)):
            now = new or (old if old is not None and old.name in self._keys else None)
            if now is not old:
                before = None if old is None else old.record
                after = None if now is None else now.record
                self.comparison.take(before, after)
                taken.take(before)
                added.take(after)
            if now is not None:
                count += 1
                yield now
        if count != len(self._keys):
            raise InputError(
                f"{self._before.folder}: found records of {count} machines, expected {len(self._keys)}: if another run of"
                " truepose fleet was at work there, start this one again"
            )
        self.summary = sums + added.total() - taken.total()


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


def _summed(records: Iterable[Record]) -> Summary:
    out = _Sum()
    for record in records:
        out.take(record)
    return out.total()


def _counts(record: Record) -> bool:
    """Whether the fleet's statistics have a machine: one that is no calibration would say of parts what is not so."""
    return record.status == "done"


def _rows(lines: Iterable[Line], summary: Summary) -> Iterator[list[Row]]:
    """Rows of the table, a group at a time. Of a machine that no statistics are made of it is not said how odd it is."""
    for group in groups(lines, TOGETHER):
        rows, counted, gathered = list[Row](), list[int](), Gathered()
        for k, record in enumerate(line.record for line in group):
            rows.append(row(record))
            if _counts(record):
                counted.append(k)
                gathered.take(record.evidence)
        for k, odd in zip(counted, oddness(gathered.columns, summary), strict=True):
            rows[k] = rows[k].with_oddness(odd)
        yield rows


class _Shown:
    """What a page shows of the rows that passed: counts, and no more than ``SHOWN`` of each kind."""

    def __init__(self) -> None:
        self._statuses, self._verdicts, self._odd = Counter[str](), Counter[str](), 0
        self._first, self._undone, self._unusual = list[Row](), list[Row](), list[Row]()

    def take(self, rows: list[Row]) -> list[Row]:
        """The same rows again."""
        odd = [r for r in rows if r.odd]
        self._odd += len(odd)
        self._statuses.update(r.status for r in rows)
        self._verdicts.update(r.verdict for r in rows if r.verdict)
        self._first += rows[: SHOWN - len(self._first)]
        self._undone += [r for r in rows if r.status not in ("done", "refused")][: SHOWN - len(self._undone)]
        unusual = sorted([*self._unusual, *odd], key=lambda r: (-(r.oddness or 0.0), r.name))
        self._unusual = unusual[:SHOWN]
        return rows

    def fleet(self, name: str, summary: Summary, changes: Changes | None, brief: bool) -> Fleet:
        """The whole outcome."""
        return Fleet(
            name,
            self._statuses.total(),
            dict(self._statuses),
            dict(self._verdicts),
            statistics(summary),
            self._odd,
            self._unusual,
            self._undone,
            self._first,
            changes,
            brief,
        )


__all__ = ["FILES", "Folders", "ended"]
