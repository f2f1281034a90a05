"""How large compressed data is, cells that hold nothing, columns that mean nothing: told from the first piece to the last."""

from __future__ import annotations

import bz2
import io

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pytest

from truepose.identification.leaves.bags.inflated import inflated_size
from truepose.identification.recording.arrow_columns import ArrowCells
from truepose.identification.recording.history import creep_sum, exponential_lag, line_of_full_loop
from truepose.identification.recording.ignored import ignored_columns, untried_columns
from truepose.identification.recording.table import table_in_memory

pytest.importorskip("lz4.frame")
MANY = 10_000_000


def size(data: bytes, most: int = MANY, compression: str = "bz2", behind: bytes = b"") -> int:
    stream = io.BytesIO(data + behind)
    return inflated_size(stream, len(data), compression, most)


@pytest.mark.parametrize(
    "plain",
    [b"", b"a", np.random.default_rng(1).bytes(140_000), bytes((1 << 20) + 1), bytes(3_000_000)],
    ids=["nothing", "a byte", "random", "a piece", "zeros"],
)
def test_it_is_as_large_as_what_was_compressed(plain: bytes) -> None:
    """Random bytes take more than a piece, zeros inflate to many; what stands behind plays no part."""
    packed, length = bz2.compress(plain), len(plain)
    assert size(packed, behind=b"more") == length
    if length:
        assert size(packed, most=length) == length
        assert size(packed, most=length - 1) > length - 1
        assert size(packed[:-5]) == -1


def test_streams_one_behind_the_other_add_up() -> None:
    one, other = bz2.compress(b"abc"), bz2.compress(b"defgh")
    assert size(one + other) == 8
    assert size(one + b"rubbish") == -1
    assert size(b"rubbish") == size(b"") == -1


def test_another_way_of_compression_is_not_judged() -> None:
    assert size(b"abc", compression="none") == 0


@pytest.mark.parametrize(
    ("cells", "empty"),
    [([], True), ([None, None], True), (["", "  "], True), ([None, "a"], False), (["", "a"], False), (["a"], False),
     ([None, 1.0], False), ([0.0], False), ([False], False)],
)  # fmt: skip
def test_cells_are_empty_where_none_holds_anything(cells: list[object], empty: bool) -> None:
    assert bool(ArrowCells(pa.array(cells)).empty) is empty
    if cells and isinstance(cells[-1], str):
        assert bool(ArrowCells(pa.array(cells, pa.large_string())).empty) is empty


@pytest.mark.parametrize("count", [1, 40, 41])
def test_a_note_names_forty_columns(count: int) -> None:
    table = table_in_memory({"q1": [1.0, 2.0], **{f"w{k:02d}": [1.0, 2.0] for k in range(count)}}, "rows")
    (note,) = ignored_columns(table, ["q1"], [])
    names = ", ".join(f"'w{k:02d}'" for k in range(min(count, 40)))
    more = " and 1 more" if count == 41 else ""
    assert note == f"rows: ignored columns that mean nothing here: {names}{more}"


def test_what_says_of_known_columns_how_they_were_averaged_means_something() -> None:
    cells = {
        "q1": [1.0, 2.0],
        "x": [1.0, 2.0],
        "x.sigma": [0.1, 0.1],
        "samples": [3, 3],
        "P1.x": [1.0, 2.0],
        "P1.samples": [3, 4],
    }
    table = table_in_memory(cells, "rows")
    assert ignored_columns(table, ["q1", "x", "P1.x"], []) == ()
    (note,) = ignored_columns(
        table_in_memory({**cells, "paylod": [1.0, 2.0]}, "rows"), ["q1", "x", "P1.x"], ["payload"]
    )
    assert note.endswith(": 'paylod' (did you mean 'payload'?)")


def test_a_column_that_varies_might_drive_an_error() -> None:
    cells = {"q1": [1.0, 2.0], "w": [1.0, 2.0], "still": [3.0, 3.0], "text": ["a", "b"]}
    assert untried_columns(table_in_memory(cells, "rows"), ["q1"]) == ("w",)


@pytest.mark.parametrize("rows", [50, 4001])
@pytest.mark.parametrize("dwell", [0.0, 3.0])
def test_a_move_creeps_from_its_own_end(rows: int, dwell: float) -> None:
    """Of few rows and of many: two moves by the logarithm of each one's age, which begins ``dwell`` before the row."""
    time, readings = np.linspace(0.0, 2.0 * (rows - 1), rows), np.zeros(rows)
    readings[10:], readings[20:] = 4.0, 1.0
    found = creep_sum(time, readings, np.zeros(rows, dtype=np.int64), 0.5, dwell)
    wanted = np.zeros(rows)
    for k, step in ((10, 4.0), (20, -3.0)):
        wanted[k:] += step * np.log10(1.0 + (time[k:] - time[k] + dwell) / 0.5)
    np.testing.assert_allclose(found, wanted, atol=1e-7)
    apart = np.where(np.arange(rows) < 15, 0, 1).astype(np.int64)
    assert np.abs(creep_sum(time, readings, apart, 0.5, dwell)[15:20]).max() < 1e-9


def test_a_lag_starts_where_it_is_and_rows_of_one_time_are_one() -> None:
    time, values = np.array([0.0, 0.0, 10.0, 10.0, 1e9]), np.array([5.0, 5.0, 15.0, 20.0, 20.0])
    lagged = exponential_lag(time, values, 30.0)
    assert lagged[0] == lagged[1] == 5.0 and lagged[2] == lagged[3] and lagged[4] == pytest.approx(20.0)
    assert exponential_lag(time, values, -1.0).tolist() == values.tolist()


def test_a_play_as_wide_as_the_range_takes_all_of_it_off() -> None:
    readings = np.array([10.0, 12.0, 20.0])
    for wide in (5.0, 50.0):
        np.testing.assert_allclose(line_of_full_loop(readings, wide, 10.0, 20.0), readings - 15.0)
    np.testing.assert_allclose(line_of_full_loop(readings, 2.5, 10.0, 20.0), 0.5 * (readings - 15.0))
