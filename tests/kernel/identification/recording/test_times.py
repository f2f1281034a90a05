"""Times of rows: however a logger writes an instant, rows are as far apart as the instants are."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truepose.errors import InputError
from truepose.identification.recording.joint_readings import JointColumn
from truepose.identification.recording.read import read_recording
from truepose.identification.recording.table import table_in_memory
from truepose.identification.recording.times import Clock, read_times
from truepose.models.units import UnitSystem

Moment = datetime.datetime
WRITTEN: dict[str, Callable[[Moment], str]] = {
    "ISO 8601": lambda m: m.isoformat(),
    "ISO 8601 with a space and a comma": lambda m: f"{m:%Y-%m-%d %H:%M:%S},{m.microsecond:06}",
    "ISO 8601 without marks": lambda m: f"{m:%Y%m%dT%H%M%S}.{m.microsecond:06}",
    "Zulu": lambda m: m.isoformat() + "Z",
    "another zone": lambda m: (m + datetime.timedelta(hours=2)).isoformat() + "+02:00",
    "year first": lambda m: f"{m:%Y/%m/%d %H:%M:%S}.{m.microsecond:06}",
    "day first": lambda m: f"{m.day}.{m.month}.{m.year} {m:%H:%M:%S},{m.microsecond:06}",
    "half days": lambda m: f"{m:%Y/%m/%d %I:%M:%S}.{m.microsecond:06} {m:%p}",
    "a month in letters": lambda m: f"{m:%d-%b-%Y %H:%M:%S}.{m.microsecond:06}",
    "an American date": lambda m: f"{m:%b} {m.day}, {m.year} {m:%H:%M:%S}.{m.microsecond:06}",
}
INSTANTS = st.datetimes(datetime.datetime(1990, 1, 1), datetime.datetime(2090, 1, 1))


def times_of(cells: list[object]) -> np.ndarray:
    return read_times(table_in_memory({"time": cells}, "rows")).seconds


@pytest.mark.parametrize("form", WRITTEN)
@given(instants=st.lists(INSTANTS, min_size=1, max_size=6))
def test_dates_are_seconds_since_1970_on_every_computer(form: str, instants: list[Moment]) -> None:
    found = times_of([WRITTEN[form](instant) for instant in instants])
    since = [(instant - datetime.datetime(1970, 1, 1)).total_seconds() for instant in instants]
    np.testing.assert_allclose(found, since, rtol=0, atol=2e-6)


@pytest.mark.parametrize("american", [False, True])
def test_an_order_of_day_and_month_is_what_all_rows_allow(american: bool) -> None:
    days = [datetime.datetime(2026, 3, day, 10) for day in (2, 17)]
    cells: list[object] = [f"{d:%m/%d/%Y %H:%M:%S}" if american else f"{d:%d/%m/%Y %H:%M:%S}" for d in days]
    assert np.ptp(times_of(cells)) == 15 * 86400
    with pytest.raises(
        InputError, match=r"row 1, column 'time': found .*unknown order, expected a date such"
    ):
        times_of(cells[:1])


@given(start=st.floats(0, 86399), steps=st.lists(st.floats(0, 40000), min_size=1, max_size=8))
def test_times_of_day_go_on_across_midnights(start: float, steps: list[float]) -> None:
    true = start + np.cumsum([0.0, *steps])
    cells: list[object] = []
    for value in true:
        minutes, seconds = divmod(value % 86400, 60)
        cells.append(f"{int(minutes) // 60:02}:{int(minutes) % 60:02}:{min(seconds, 59.999999):09.6f}")
    np.testing.assert_allclose(np.diff(times_of(cells)), steps, atol=3e-6)


def test_a_table_with_times_of_its_own_kind_is_read_too(tmp_path: Path) -> None:
    stamps = pd.to_datetime(["2026-03-01T10:00:00.5", "2026-03-01T10:00:40.0"])
    frame = pd.DataFrame({"time": stamps})
    frame.to_parquet(tmp_path / "rows.parquet")
    for source in (table_in_memory(frame, "frame"), table_in_memory({"time": list(stamps)}, "dict")):
        assert np.diff(read_times(source).seconds) == 39.5
    assert np.diff(times_of([datetime.time(10, 0, 1), datetime.time(10, 0, 3)])) == 2.0


@pytest.mark.parametrize(
    ("cells", "found"),
    [
        (
            ["2026-03-01T10:00:00", "soon"],
            "rows: row 2, column 'time': found 'soon', expected seconds, a date",
        ),
        (
            ["yesterday"],
            "rows: row 1, column 'time': found 'yesterday', expected seconds, a date such as 2026",
        ),
        (["2026-03-01T10:00:00", None], "row 2, column 'time': found an empty cell"),
        (
            ["2026-03-01T10:00:00", "2026-03-01T10:00:00Z"],
            "row 2.*expected dates without a time zone as in row 1",
        ),
        (["10:00:00", "2026-03-01T10:00:00"], "row 2.*expected times of day as in row 1"),
        (["31.02.2026 10:00:00"], "row 1.*found '31.02.2026 10:00:00', expected seconds"),
        (["13:00:00 PM"], "row 1.*found '13:00:00 PM', expected seconds"),
        ([1.0, "10:00:00"], "row 2, column 'time': found '10:00:00', expected a finite number"),
    ],
)
def test_what_is_no_time_is_refused_where_it_stands(cells: list[object], found: str) -> None:
    with pytest.raises(InputError, match=found):
        times_of(cells)


def test_files_of_one_command_share_a_clock() -> None:
    def joined(*times: list[object]) -> np.ndarray:
        tables = [table_in_memory({"q": [0.0, 1.0], "time": t}, f"file{k}") for k, t in enumerate(times, 1)]
        found = read_recording(tables, [JointColumn("q", "rad")], {}, UnitSystem()).time
        assert found is not None
        return found

    first, second = (
        ["2026-03-01T10:00:00", "2026-03-01T10:00:40"],
        ["2026-03-02 10:00:00", "2026-03-02 10:00:40"],
    )
    np.testing.assert_array_equal(np.diff(joined([*first], [*second])), [40, 86360, 40])
    with pytest.raises(
        InputError, match=r"file2: column 'time': found seconds, expected dates .* as in file1"
    ):
        joined([*first], [0.0, 40.0])


def test_the_kind_of_a_clock_is_known() -> None:
    assert read_times(table_in_memory({"time [ms]": [0.0, 40.0]}, "rows")).clock is Clock.START
    assert read_times(table_in_memory({"time [ms]": ["0", "40"]}, "rows")).seconds[1] == 0.04
