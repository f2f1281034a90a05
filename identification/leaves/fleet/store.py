"""Where a fleet's records are kept: one Parquet file of the last run that ended, and a journal of the one that has not.

``fleet.parquet`` holds a row a machine, by name, in groups that are read one at a time; keys can be read without the records.
``sums.json`` holds the sums of all records (``Summary``), to which those of a machine are added, or from which they are taken.
The journal is a line a machine, added when the machine is done. A run that was killed left what it had done there.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO, Any, TypeVar

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]

from truepose.errors import InputError
from truepose.identification.leaves.fleet.record import Record
from truepose.identification.leaves.fleet.summary import Summary

STORE, SUMS, JOURNAL = "fleet.parquet", "sums.json", "journal.jsonl"
RECORDS = "records_sha256"
"""Field of ``sums.json``: of which records it holds the sums."""
GROUP = 1000
"""Records that are read at once: a few MB."""
Item = TypeVar("Item")
_COLUMNS = pa.schema(
    [("name", pa.string()), ("key", pa.string()), ("final", pa.bool_()), ("record", pa.string())]
)


@dataclass(frozen=True)
class Line:
    """A record as a text, which is much smaller than what it says and quicker to copy; source: the file that it is from."""

    name: str
    key: str
    final: bool
    text: str
    source: Path

    @property
    def record(self) -> Record:
        """What it says. Raises InputError where that is of another version."""
        record = Record.of_text(self.text)
        if record is None:
            raise InputError(
                f"{self.source}: found a record of another version, expected one of this; delete the folder to begin anew"
            )
        return record


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

    def lines(self) -> Iterator[Line]:
        """Every record as a text, by name."""
        if not self.exists:
            return
        for batch in self._file().iter_batches(GROUP):
            columns = (batch.column(name).to_pylist() for name in _COLUMNS.names)
            for name, key, final, text in zip(*columns, strict=True):
                yield Line(name, key, final, text, self.path)

    def records(self) -> Iterator[Record]:
        """Every record, by name. Raises InputError for one of another version."""
        return (line.record for line in self.lines())

    def summary(self) -> Summary | None:
        """Return the sums of all records; None where they are of another version, or of other records."""
        try:
            stated = json.loads((self.folder / SUMS).read_text(encoding="utf-8"))
            return Summary.from_json(stated) if stated.pop(RECORDS) == self._digest() else None
        except (OSError, ValueError, KeyError, TypeError, AttributeError, InputError):
            return None

    def _digest(self) -> str:
        with self.path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()

    def _file(self) -> Any:
        try:
            return pq.ParquetFile(self.path)
        except (OSError, pa.ArrowInvalid) as exc:
            raise InputError(
                f"{self.path}: found no table of truepose fleet ({exc}); delete it to begin anew"
            ) from None

    def write(self, lines: Iterable[Line]) -> None:
        """Records, by name; the same records, the same bytes."""
        with pq.ParquetWriter(self.path, _COLUMNS, compression="zstd", use_dictionary=False) as writer:
            for group in groups(lines, GROUP):
                columns = zip(*((one.name, one.key, one.final, one.text) for one in group), strict=True)
                writer.write_table(pa.table([list(column) for column in columns], schema=_COLUMNS))

    def write_summary(self, summary: Summary) -> None:
        """Write the sums of the records that were written before, with the digest of their file."""
        document = {**summary.to_json(), RECORDS: self._digest()}
        text = json.dumps(document, sort_keys=True, separators=(",", ":"))
        (self.folder / SUMS).write_text(text + "\n", encoding="utf-8")


def groups(items: Iterable[Item], size: int) -> Iterator[list[Item]]:
    """So many of them at a time."""
    rest = iter(items)
    while group := list(islice(rest, size)):
        yield group


@dataclass(frozen=True)
class _Noted:
    """Where a line of the journal begins, in bytes."""

    key: str
    final: bool
    at: int


@dataclass(frozen=True)
class Journal:
    """The lines of a run that has not ended; the last of a machine holds. A line that was cut off is none."""

    path: Path

    def keys(self) -> dict[str, str]:
        """The key of every machine whose files would give the same again."""
        return {name: noted.key for name, noted in self._noted().items() if noted.final}

    def lines(self, keys: Mapping[str, str]) -> Iterator[Line]:
        """Those whose key is the one given for their name, by name; only where they are is held in memory."""
        noted = self._noted()
        if not noted:
            return
        with self.path.open("rb") as stream:
            for name in sorted(noted):
                one = noted[name]
                if keys.get(name) == one.key:
                    stream.seek(one.at)
                    yield Line(name, one.key, one.final, _text(stream.readline()), self.path)

    def _noted(self) -> dict[str, _Noted]:
        if not self.path.is_file():
            return {}
        found, at = dict[str, _Noted](), 0
        with self.path.open("rb") as stream:
            for line in stream:
                record = Record.of_text(_text(line))
                if record is not None:
                    found[record.name] = _Noted(record.key, record.final, at)
                at += len(line)
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


def _text(line: bytes) -> str:
    return line.decode("utf-8", errors="replace").rstrip("\n")


__all__ = ["JOURNAL", "STORE", "SUMS", "Journal", "Line", "Store", "groups"]
