"""Times of rows as loggers write them: seconds, dates with a time of day (ISO 8601 and the usual others), times of day."""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import Final, TypeAlias

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.recording.table import Table
from truepose.models.machine.loads import seconds_since_1970
from truepose.models.units import convert
from truepose.wording import cut

_DAY: Final = 86400.0
_NUMBER: Final = re.compile(r"[-+]?(?:[\d.]+(?:e[-+]?\d+)?|nan|inf(?:inity)?)", re.IGNORECASE)
_ISO: Final = "a date such as 2026-05-01T10:11:12.125"
_TIME: Final = r"(?P<hour>\d+):(?P<minute>[0-5]?\d):(?P<second>[0-5]?\d(?:[.,]\d+)?)\s*(?P<half>[AP]M)?"
_TIME_OF_DAY: Final = re.compile(_TIME, re.IGNORECASE)
_DATED: Final = re.compile(rf"(?P<date>.+?)[\sT]+{_TIME}", re.IGNORECASE)
_DATES: Final = (
    "%Y/%m/%d", "%Y.%m.%d", "%d.%m.%Y", "%d-%b-%Y", "%d %b %Y", "%d-%B-%Y", "%d %B %Y", "%b %d %Y", "%B %d %Y",
)  # fmt: skip
"""Dates that are not ISO 8601: year first, day first with points, a month in letters."""
_EITHER: Final = {False: ("%d/%m/%Y", "%d-%m-%Y"), True: ("%m/%d/%Y", "%m-%d-%Y")}
"""Those of day and month in either order, by whether the month comes first."""
_Moment: TypeAlias = "datetime.datetime | float"
"""A date, or seconds since midnight."""


class Clock(Enum):
    """What the seconds of a recording count from."""

    START = "seconds"
    DATE = "dates without a time zone"
    ZONED = "dates with a time zone"
    MIDNIGHT = "times of day"


@dataclass(frozen=True)
class Times:
    """Seconds (n,) of rows and what they count from: an unknown start, 1970, or the first row's midnight."""

    seconds: Array
    clock: Clock

    def since(self, origin: float, begun: float) -> Array:
        """Return the seconds since ``origin`` of a file that was ``begun`` at a date, both s since 1970."""
        starts = {Clock.START: begun, Clock.MIDNIGHT: math.floor(begun / _DAY) * _DAY}
        return starts.get(self.clock, 0.0) - origin + self.seconds


def read_times(table: Table, name: str = "time") -> Times:
    """Return the times of a column.

    Raises InputError naming file, row and column for what is no time, or one of another kind than in row 1.
    """
    cells = table.cells[name]
    if _may_be_number(next(iter(cells))):
        seconds = convert(table.numbers(name), table.unit(name, "s", "s"), "s", table.where(name))
        return Times(seconds, Clock.START)
    moments = _moments(table, name, cells)
    clocks = [_clock_of(moment) for moment in moments]
    odd = next((row for row, clock in enumerate(clocks) if clock is not clocks[0]), None)
    if odd is not None:
        raise InputError(
            f"{table.where(name, odd)}: found {_shown(cells[odd])}, expected {clocks[0].value} as in row 1"
        )
    if clocks[0] is Clock.MIDNIGHT:
        return Times(_across_midnights(np.array(moments, dtype=float)), Clock.MIDNIGHT)
    dates = [moment for moment in moments if isinstance(moment, datetime.datetime)]
    return Times(np.array([seconds_since_1970(date) for date in dates]), clocks[0])


def _moments(table: Table, name: str, cells: Sequence[object]) -> list[_Moment]:
    """Return what the cells say, with day and month in the one order that all of them allow."""
    day_first, month_first = ([_moment(cell, month_first=order) for cell in cells] for order in (False, True))
    for row, (one, other) in enumerate(zip(day_first, month_first, strict=True)):
        if one is None and other is None:
            raise InputError(
                f"{table.where(name, row)}: found {_shown(cells[row])}, expected seconds, {_ISO}, or a time of day"
            )
    whole = [
        [m for m in moments if m is not None] for moments in (day_first, month_first) if None not in moments
    ]
    if len(whole) == 1 or (whole and whole[0] == whole[1]):
        return whole[0]
    raise InputError(
        f"{table.where(name, 0)}: found {_shown(cells[0])}, of day and month in an unknown order, expected {_ISO}"
    )


def _may_be_number(cell: object) -> bool:
    """Return True for a number, in a text or by itself, and for an empty cell."""
    if not isinstance(cell, str):
        return cell is None or isinstance(cell, (int, float))
    return not cell.strip() or _NUMBER.fullmatch(cell.strip()) is not None


def _moment(cell: object, *, month_first: bool) -> _Moment | None:
    """Return the date or the time of day of a cell; None where it holds neither."""
    if isinstance(cell, datetime.timedelta):
        return cell.total_seconds()
    if isinstance(cell, datetime.time):
        return (
            datetime.datetime.combine(datetime.datetime.min, cell) - datetime.datetime.min
        ).total_seconds()
    if isinstance(cell, datetime.datetime):
        return cell
    if isinstance(cell, datetime.date):
        return datetime.datetime(cell.year, cell.month, cell.day)
    return _of_text(cell.strip(), month_first=month_first) if isinstance(cell, str) else None


def _of_text(text: str, *, month_first: bool) -> _Moment | None:
    of_day = _TIME_OF_DAY.fullmatch(text)
    if of_day is not None:
        return _seconds_of_day(of_day)
    if re.match(r"\d{4}-\d\d-?\d\d|\d{8}T", text):
        try:
            return datetime.datetime.fromisoformat(text)
        except ValueError:
            return None
    found = _DATED.fullmatch(text)
    seconds = None if found is None else _seconds_of_day(found)
    if found is None or seconds is None or seconds >= _DAY:
        return None
    day = _day(found["date"], month_first=month_first)
    return None if day is None else day + datetime.timedelta(seconds=seconds)


@cache
def _day(text: str, *, month_first: bool) -> datetime.datetime | None:
    """Return the day of a date in one of the forms; None where it is in none of them."""
    words = " ".join(text.replace(",", " ").replace(". ", " ").split())
    for form in (*_DATES, *_EITHER[month_first]):
        with suppress(ValueError):
            return datetime.datetime.strptime(words, form)
    return None


def _seconds_of_day(found: re.Match[str]) -> float | None:
    """Return the seconds that a clock shows; None where twelve hours have none such."""
    hour, half = int(found["hour"]), found["half"]
    if half is not None:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + 12 * (half.casefold() == "pm")
    return 3600.0 * hour + 60.0 * int(found["minute"]) + float(found["second"].replace(",", "."))


def _across_midnights(seconds: Array) -> Array:
    """Return seconds (n,) since the first midnight: where a clock falls by more than half a day, the next day has begun."""
    if np.any(seconds >= _DAY):  # a duration
        return seconds
    days = np.cumsum(np.diff(seconds, prepend=seconds[0]) < -_DAY / 2)
    return np.asarray(seconds + _DAY * days)


def _clock_of(moment: _Moment) -> Clock:
    if not isinstance(moment, datetime.datetime):
        return Clock.MIDNIGHT
    return Clock.DATE if moment.tzinfo is None else Clock.ZONED


def _shown(cell: object) -> str:
    return "an empty cell" if cell is None or not str(cell).strip() else repr(cut(str(cell).strip()))
