"""Sums over many rows: one chunk of them after the other, or side by side on a Dask cluster.

Chunks are the same everywhere and are added in their order, so that no digit depends on where they were worked out. A cluster
is asked where joblib's backend around the call is Dask's (``joblib.parallel_config(backend="dask")``).
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, overload

import numpy as np

from truepose.arrays import Index
from truepose.errors import InputError
from truepose.identification.prediction.predictor import BLOCK
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.linearisation import Forms
from truepose.identification.signatures.row_columns import Point, RowColumns, Sums
from truepose.models.file.driver import PAYLOAD
from truepose.models.registry import load_once, loaded_plugins
from truepose.pool import numbered, present
from truepose.threads import one_thread

CHUNK = 32 * BLOCK
"""Rows of a chunk: some megabytes to send, and seconds of work."""
KEPT = 4
"""Sets of candidates whose functions a worker keeps: those that a search asks for in turn."""


def summed(columns: RowColumns, at: Point, forms: Forms, rows: Index, order: Index | None = None) -> Sums:
    """``RowColumns.sums`` of fitted rows (k,), of any number."""
    if not columns.by_row:
        return columns.sums(at, forms, rows, order)
    parts = [rows[start : start + CHUNK] for start in range(0, max(len(rows), 1), CHUNK)]
    if len(parts) == 1 or order is not None:
        return _total(columns.sums(at, forms, part, order) for part in parts)
    cluster = present()
    if cluster is None:
        return _total(columns.sums(at, forms, part) for part in parts)
    return _total(in_turn(numbered(_worked_out, _Sealed(columns, at, forms, parts), cluster)))


def _total(parts: Iterator[Sums]) -> Sums:
    """The sum of sums, from the first on."""
    grams, counts = next(parts)
    for more, further in parts:
        for gram, other in zip(grams, more, strict=True):
            np.add(gram, other, out=gram)
        counts = [a + b for a, b in zip(counts, further, strict=True)]
    return grams, counts


def in_turn(results: Iterator[tuple[int, Sums | None]]) -> Iterator[Sums]:
    """Results that come as they are done, in the order of their numbers."""
    early, following = dict[int, Sums](), 0
    for k, result in results:
        if result is None:
            raise InputError(
                f"rows {k * CHUNK + 1} to {(k + 1) * CHUNK} of those fitted: found that the worker died twice, expected it to"
                " end: give workers more memory"
            )
        early[k] = result
        while following in early:
            yield early.pop(following)
            following += 1


@dataclass(frozen=True)
class _Task:
    """What a worker needs, as bytes: it must have loaded the plug-ins before it reads them.

    alike: what is the same for all chunks of a search, and what is built once; own: rows and where columns are drawn.
    """

    plugins: tuple[Path, ...]
    alike: bytes
    own: bytes


class _Sealed(Sequence[_Task]):
    """A task for each chunk, made when it is asked for: all of them together would hold the recording once more."""

    def __init__(self, columns: RowColumns, at: Point, forms: Forms, parts: Sequence[Index]) -> None:
        self._columns, self._at, self._forms, self._parts = columns, at, forms, parts
        drivers = (*columns.predictor(at.effects).model.drivers, *columns.shifts.drivers, PAYLOAD)
        self._drivers = tuple(dict.fromkeys(drivers))
        no_row = columns.recording.alone(parts[0][:0], self._drivers)
        alike = columns.machine, no_row, columns.candidates, columns.by_label, columns.size
        self._plugins, self._alike = loaded_plugins(), pickle.dumps(alike)

    def __len__(self) -> int:
        return len(self._parts)

    @overload
    def __getitem__(self, k: int) -> _Task: ...
    @overload
    def __getitem__(self, k: slice) -> Sequence[_Task]: ...
    def __getitem__(self, k: int | slice) -> Any:
        if isinstance(k, slice):
            return [self[i] for i in range(*k.indices(len(self)))]
        rows = self._parts[k]
        forms = replace(self._forms, modulations=self._forms.of_rows(rows))
        own = self._columns.recording.alone(rows, self._drivers), self._at.of_rows(rows), forms
        return _Task(self._plugins, self._alike, pickle.dumps(own))


def _worked_out(task: _Task) -> Sums:
    """On a worker."""
    for plugin in task.plugins:
        load_once(plugin)
    own: tuple[Recording, Point, Forms] = pickle.loads(task.own)
    recording, at, forms = own
    columns = _built(task.alike)
    columns.predictor(at.effects)  # what is built now is there for the next chunk
    with one_thread():
        return columns.over(recording).sums(at, forms, np.arange(len(recording)))


@lru_cache(maxsize=KEPT)
def _built(alike: bytes) -> RowColumns:
    return RowColumns(*pickle.loads(alike))
