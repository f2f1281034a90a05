"""Where a fleet's records are kept: one Parquet file of the last run that ended, and a journal of the one that has not.

``fleet.parquet`` holds a row a machine, by name, in groups that are read one at a time; keys can be read without the records.
``sums.json`` holds the sums of all records (``Summary``), to which those of a machine are added, or from which they are taken.
The journal is a line a machine, added when the machine is done. A run that was killed left what it had done there.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]

from truepose.errors import InputError
from truepose.identification.fleet.record import Record
from truepose.identification.fleet.summary import Summary

STORE, SUMS, JOURNAL = "fleet.parquet", "sums.json", "journal.jsonl"
GROUP = 1000
"""Records that are read at once: a few MB."""
_COLUMNS = pa.schema(
    [("name", pa.string()), ("key", pa.string()), ("final", pa.bool_()), ("record", pa.string())]
)


@dataclass(frozen=True)
class Store:
    """What the last run that ended has kept in a folder, read when it is asked for; nothing where none has ended there."""

    folder: Path

    @property
    def path(self) -> Path:
        """The file of records."""
        return self.folder / STORE

    @property
    def exists(self) -> bool:
        """Whether a run has ended here."""
        return self.path.is_file()

    def keys(self) -> dict[str, str]:
        """The key of every machine whose files would give the same again."""
        if not self.exists:
            return {}
        table = self._file().read(["name", "key", "final"]).to_pydict()
        rows = zip(table["name"], table["key"], table["final"], strict=True)
        return {name: key for name, key, final in rows if final}

    def records(self) -> Iterator[Record]:
        """Every record, by name. Raises InputError for one of another version."""
        if not self.exists:
            return
        for batch in self._file().iter_batches(GROUP, columns=["record"]):
            for text in batch.column(0).to_pylist():
                yield self._read(text)

    def summary(self) -> Summary | None:
        """The sums of all records; None where they are of another version."""
        try:
            return Summary.from_json(json.loads((self.folder / SUMS).read_text(encoding="utf-8")))
        except (OSError, ValueError, InputError):
            return None

    def _file(self) -> Any:
        try:
            return pq.ParquetFile(self.path)
        except (OSError, pa.ArrowInvalid) as exc:
            raise InputError(
                f"{self.path}: found no table of truepose fleet ({exc}); delete it to begin anew"
            ) from None

    def _read(self, text: str) -> Record:
        record = Record.of_text(text)
        if record is None:
            raise InputError(
                f"{self.path}: found a record of another version, expected one of this; delete the folder to begin anew"
            )
        return record

    def write(self, records: Iterable[Record]) -> None:
        """Records, by name; the same records, the same bytes."""
        with pq.ParquetWriter(self.path, _COLUMNS, compression="zstd", use_dictionary=False) as writer:
            for group in _groups(records, GROUP):
                rows = [{"name": r.name, "key": r.key, "final": r.final, "record": r.text()} for r in group]
                writer.write_table(pa.Table.from_pylist(rows, schema=_COLUMNS))

    def write_summary(self, summary: Summary) -> None:
        """Their sums."""
        text = json.dumps(summary.to_json(), sort_keys=True, separators=(",", ":"))
        (self.folder / SUMS).write_text(text + "\n", encoding="utf-8")


def _groups(records: Iterable[Record], size: int) -> Iterator[list[Record]]:
    group: list[Record] = []
    for record in records:
        group.append(record)
        if len(group) == size:
            yield group
            group = []
    if group:
        yield group


@dataclass(frozen=True)
class _Line:
    """A record as a text, which is much smaller than what it says."""

    key: str
    final: bool
    text: str


@dataclass(frozen=True)
class Journal:
    """The lines of a run that has not ended; the last of a machine holds. A line that was cut off is none."""

    path: Path

    def keys(self) -> dict[str, str]:
        """The key of every machine whose files would give the same again."""
        return {name: line.key for name, line in self._lines().items() if line.final}

    def records(self, keys: Mapping[str, str]) -> Iterator[Record]:
        """Those whose key is the one given for their name, by name."""
        lines = self._lines()
        for name in sorted(lines):
            record = Record.of_text(lines[name].text) if keys.get(name) == lines[name].key else None
            if record is not None:
                yield record

    def _lines(self) -> dict[str, _Line]:
        if not self.path.is_file():
            return {}
        found = dict[str, _Line]()
        with self.path.open(encoding="utf-8", errors="replace") as stream:
            for text in stream:
                record = Record.of_text(text)
                if record is not None:
                    found[record.name] = _Line(record.key, record.final, text)
        return found

    def open(self) -> IO[str]:
        """For more lines."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        stream = self.path.open("a", encoding="utf-8", newline="\n")
        stream.write("\n")  # ends what was cut off
        return stream

    @staticmethod
    def note(stream: IO[str], record: Record) -> None:
        """A line, in the hands of the system before the next machine is."""
        stream.write(record.text() + "\n")
        stream.flush()


__all__ = ["JOURNAL", "STORE", "SUMS", "Journal", "Store"]
