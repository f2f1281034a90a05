"""The end of a run over a fleet: records and their sums are put together, and table, page and prior are made of them.

No machine's folder is opened. Records are read one group after the other, so that memory holds a group and the table's rows.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from truepose.errors import InputError
from truepose.files import atomic_directory, write_table
from truepose.identification.fleet.changes import Changes, Comparison, paired
from truepose.identification.fleet.learn import learned
from truepose.identification.fleet.odd import Oddness, oddness
from truepose.identification.fleet.record import Record
from truepose.identification.fleet.result import SHOWN, Fleet
from truepose.identification.fleet.statistics import statistics
from truepose.identification.fleet.store import JOURNAL, Journal, Store
from truepose.identification.fleet.summary import Summary, total
from truepose.identification.fleet.table import Row, row, table
from truepose.identification.learned_prior import write_prior
from truepose.identification.report.fleet_files import DOCUMENT, PAGE, put_fleet

TABLE, PRIOR = "fleet.csv", "prior.yaml"
TOGETHER = 64
"""Machines whose sums are added up at once: more would fill the memory, fewer take longer."""
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
    """What the fleet of these machines (keys by name) says now, and all files that say it, published in one step.

    ``brief``: machines have no reports that the page could lead to.
    """
    now = _Now(keys, folders.store, folders.journal)
    with atomic_directory(folders.results) as partial:
        after = Store(partial)
        after.write(now.records())
        after.write_summary(now.summary)
        changes = now.comparison.result() if folders.store.exists else None
        rows = [row(record, _odd(record, now.summary)) for record in after.records()]
        write_table(partial / TABLE, table(rows))
        write_prior(partial / PRIOR, learned(now.summary))
        fleet = _fleet(folders.machines.name, rows, now.summary, changes, brief)
        put_fleet(fleet, partial)
    return fleet


class _Now:
    """The records of a fleet as it is now, how they differ from those of the last run, and their sums."""

    def __init__(self, keys: Mapping[str, str], before: Store, journal: Journal) -> None:
        self._keys, self._before, self._journal = keys, before, journal
        self.comparison = Comparison()
        self.summary = Summary.empty()

    def records(self) -> Iterator[Record]:
        """By name; sums and differences are whole when all were taken.

        The sums of the last run are brought up to date; where there are none, all records are added up.
        """
        sums = self._before.summary()
        added, taken = _Sum(), _Sum()
        for old, new in paired(self._before.records(), self._journal.records(self._keys)):
            now = new or (old if old is not None and old.name in self._keys else None)
            self.comparison.take(old, now)
            if sums is not None and now != old:
                taken.take(old)
            if sums is None or now != old:
                added.take(now)
            if now is not None:
                yield now
        self.summary = (sums or Summary.empty()) + added.total() - taken.total()


class _Sum:
    """The sums of records taken one after the other; some wait, for many are added up as quickly as two."""

    def __init__(self) -> None:
        self._waiting = [Summary.empty()]

    def take(self, record: Record | None) -> None:
        """What a machine adds."""
        if record is not None and _counts(record):
            self._waiting.append(Summary.of(record.evidence))
        if len(self._waiting) > TOGETHER:
            self._waiting = [self.total()]

    def total(self) -> Summary:
        """Of all."""
        return total(iter(self._waiting))


def _odd(record: Record, summary: Summary) -> Oddness | None:
    """How unlike the others a machine is; of one that no statistics are made of nothing is said."""
    return oddness(record.evidence, summary) if _counts(record) else None


def _counts(record: Record) -> bool:
    """Whether the fleet's statistics have a machine: one that is no calibration would say of parts what is not so."""
    return record.status == "done"


def _fleet(name: str, rows: Sequence[Row], summary: Summary, changes: Changes | None, brief: bool) -> Fleet:
    unusual = sorted((r for r in rows if r.odd), key=lambda r: (-(r.oddness or 0.0), r.name))
    undone = [r for r in rows if r.status not in ("done", "refused")]
    return Fleet(
        name,
        len(rows),
        dict(Counter(r.status for r in rows)),
        dict(Counter(r.verdict for r in rows if r.verdict)),
        statistics(summary),
        len(unusual),
        unusual[:SHOWN],
        undone[:SHOWN],
        rows[:SHOWN],
        changes,
        brief,
    )


__all__ = ["FILES", "Folders", "ended"]
