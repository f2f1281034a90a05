"""Recordings: what was commanded, read and logged, row by row, in internal units (mm, rad).

`read_recording` (``read.py``) makes a `Recording` from files; the rest of the package works on it. A recording
never changes: `subset` gives some rows that still know the whole, so that what depends on history (lags, session
ranks, the row that `from` names) means the same in any part.

Drivers that remember: what a joint's way, or a temperature's past, leaves behind at every row.

Beside them: what the order of the rows alone tells of the last motion (``from_order``).

They are computed from the whole recording in order of acquisition, so that a part of it, or its rows in another
order, means the same where time is recorded. See ``remembered`` for their names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from truepose.arrays import Array, Mask
from truepose.identification.recording.history import (
    creep_sum,
    exponential_lag,
    heat_of_motion,
    last_steps,
    line_of_full_loop,
    order_in_time,
    side_of_arrival,
    stop_operator,
)
from truepose.models.file.driver import (
    APPROACH,
    HEAT,
    MEASURED_LOADS,
    OF_THE_ORDER,
    ROW,
    STEP,
    TIME,
    TREMBLING,
    Driver,
)
from truepose.shown.result import Shown

IntArray = npt.NDArray[np.int64]
BoolArray = Mask
Rows = IntArray | BoolArray | Sequence[int] | slice
A = TypeVar("A", bound=npt.NDArray[Any])

__all__ = ["Recording", "frozen"]
_BY_ROW: Final = (
    "q", "source_file", "source_row", "session", "session_recorded", "validation", "pose", "time", "from_row",
    "reading_errors",
)  # fmt: skip
"""Arrays of a recording with an entry for each row."""


@dataclass(frozen=True, eq=False, repr=False)
class Recording(Shown):
    """One or several recordings, validated; every array is read-only, n rows long.

    Lengths mm, angles rad, readings of joints in other units (`turn`) as recorded. Optional columns are
    None, or absent from their mapping, unless every file has them. written: of columns with a unit, the internal one
    and the machine file's, which ``to_frame`` gives; columns that it lacks stay in internal units. said: the unit that a
    joint's column or a reading's is said to be in, by its header or by the machine file, where all files agree. digests, dates:
    SHA-256 of each file and the day that its comments name, empty where there is none. untried: columns of numbers that were
    left out because nobody declared them. shuffled: that rows next to each other are declared to be no visits one after the
    other, so that their order tells nothing of how a joint came. reading_errors: estimated noise of the joints' readings,
    known only where rows are compared with each other (`truepose.identification.fit.reading_errors`). uncoupling: takes
    readings to the joints' own motions where some hold the motion of others (`truepose.models.machine.mechanism`).
    ``to_frame()``: the rows with the columns of a recording file, in the machine file's units: read again they are the same
    rows. ``pose``, ``from``, ``session``, ``time`` (s) and ``role`` where recorded, joints, labels, the sensors' columns,
    then drivers. The index is ``row`` of the file, with ``file`` before it where there are several.
    """

    joints: tuple[str, ...]
    q: Array  # (n, n_joints)
    observations: Mapping[str, Array]
    labels: Mapping[str, tuple[str, ...]]
    drivers: Mapping[str, Array]
    files: tuple[str, ...]
    source_file: IntArray  # index into files
    source_row: IntArray  # 1-based row of data in its file
    session: IntArray
    session_recorded: BoolArray  # False where a file has no such column and got a number of its own
    validation: BoolArray
    pose: IntArray | None = None
    time: Array | None = None  # s
    from_row: IntArray | None = None  # index into `whole`
    notes: tuple[str, ...] = ()
    written: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    said: Mapping[str, str] = field(default_factory=dict)
    digests: tuple[str, ...] = ()
    dates: tuple[str, ...] = ()
    untried: tuple[str, ...] = ()
    shuffled: bool = False
    reading_errors: Array | None = None  # (n, n_joints)
    uncoupling: Array | None = None  # (n_joints, n_joints)
    _whole: Recording | None = None
    _rows: IntArray | None = None
    _told: dict[str, Array | None] = field(default_factory=dict, init=False)
    """What the order of the rows told so far, by driver: (n,) of a whole recording."""

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """As it was before it was pickled or copied: numpy forgets that an array is read-only."""
        for value in state.values():
            for array in value.values() if isinstance(value, Mapping) else (value,):
                if isinstance(array, np.ndarray):
                    array.setflags(write=False)
        self.__dict__.update(state)

    def __len__(self) -> int:
        return len(self.q)

    @property
    def positions(self) -> Array:
        """Joint readings without their estimated errors, shape (n, n_joints): where a model is evaluated."""
        return self.q if self.reading_errors is None else self.q - self.reading_errors

    @property
    def moved(self) -> Array:
        """Own motions of the joints in the units of their readings, shape (n, n_joints)."""
        return self.q if self.uncoupling is None else frozen(self.q @ self.uncoupling.T)

    @property
    def whole(self) -> Recording:
        """The recording as it was read; itself unless this is a subset."""
        return self if self._whole is None else self._whole

    @property
    def rows(self) -> IntArray:
        """(n,) places of these rows in `whole`."""
        return frozen(np.arange(len(self)) if self._rows is None else self._rows)

    @property
    def sessions(self) -> tuple[int, ...]:
        """Session numbers of the whole recording, in order."""
        return tuple(int(number) for number in np.unique(self.whole.session))

    @property
    def n_sessions(self) -> int:
        """How many sessions the whole recording has."""
        return len(self.sessions)

    def session_rank(self, known: Sequence[int] | None = None) -> IntArray:
        """(n,) 0-based place of each row's session among `known` numbers (default: this recording's own).

        A session not among them, or that has no recorded number, takes the rank of the latest one.
        """
        own = known is None
        numbers = np.unique(np.asarray(self.sessions if known is None else known, dtype=np.int64))
        if not numbers.size:
            return frozen(np.zeros(len(self), dtype=np.int64))
        place = np.minimum(np.searchsorted(numbers, self.session), numbers.size - 1)
        seen = (numbers[place] == self.session) & (self.session_recorded | own)
        return frozen(np.where(seen, place, numbers.size - 1).astype(np.int64))

    @property
    def logged(self) -> tuple[str, ...]:
        """Every logged driver, time included."""
        return (*self.drivers, *((TIME,) if self.time is not None else ()))

    @cached_property
    def order(self) -> IntArray:
        """(n,) indices that put these rows in order of acquisition: by time where it is recorded, by file and row."""
        return frozen(order_in_time(self.time, self.source_file, self.source_row))

    @property
    def place_in_order(self) -> Array | None:
        """(n,) place of each row in its session's order of acquisition: from minus so many as follow the first to 0 in the
        longest session.

        Each session begins anew: nobody knows how long it was after the one before. None where a clock was recorded, which
        tells more, and where rows are declared shuffled.
        """
        if self.time is not None or self.whole.shuffled:
            return None
        whole = self.whole
        session, place = whole.session[whole.order], np.empty(len(whole))
        for number in np.unique(session):
            own = whole.order[session == number]
            place[own] = np.arange(len(own))
        return frozen((place - np.max(place, initial=0.0))[self.rows])

    @property
    def ordered(self) -> bool:
        """Whether rows next to each other in ``order`` were measured one after the other, as far as anybody says."""
        return self.time is not None or not self.shuffled

    def inferred(self, name: str) -> bool:
        """Whether no column holds this driver, and the order of the rows tells it."""
        return Driver.of(name).kind in OF_THE_ORDER and name not in self.drivers and not self.whole.shuffled

    def in_time(self, rows: BoolArray) -> IntArray:
        """Indices of the ``rows`` (n,), in order of acquisition."""
        order = self.order
        return order[rows[order]]

    def columns(self, *, smooth: bool = False) -> dict[str, Array]:
        """(n,) values of all that was varied, by name: the joints' own motions, then every logged driver, time last.

        smooth: of the drivers only those that an error may be a smooth function of (`Driver.smooth`). In the units of `q`
        and of `truepose.models.file.driver`.
        """
        logged = [name for name in self.logged if not smooth or self._bends_any(Driver.of(name))]
        found = {name: self.driver(name) for name in logged}
        readings = dict(zip(self.joints, self.moved.T, strict=True))
        return readings | {name: values for name, values in found.items() if values is not None}

    def _bends_any(self, driver: Driver) -> bool:
        """Whether any part may err as a smooth function of it; what a joint's drive holds bends that joint alone."""
        return driver.smooth or (driver.kind in MEASURED_LOADS and driver.place not in self.joints)

    def driver(self, name: str, sessions: Sequence[int] | None = None) -> Array | None:
        """(n,) values that the recording has for a driver; None when it has none.

        Units are in `truepose.models.file.driver`. `temperature.air` stands in for places without a column; names with
        numbers are of drivers that remember (see `remembered`); `session.after.K` is 1
        from the K-th session change on, 0 before, sessions ranked among `sessions` (see `session_rank`); `row` is the place in
        the order of acquisition where no clock was recorded (`place_in_order`). Where no column tells the side that a joint
        arrived from, the order of the rows does, unless they are `shuffled`.
        """
        if sessions is None and name in self._told:
            return self._told[name]
        driver = Driver.of(name)
        if driver.after is not None:
            return frozen((self.session_rank(sessions) >= driver.after).astype(np.float64))
        if driver.numbers:
            return self._of_whole(driver)
        if name == ROW and ROW not in self.drivers:
            return self.place_in_order
        recorded = self.time if name == TIME else self.drivers.get(driver.served_by(self.drivers))
        if recorded is None and driver.kind in OF_THE_ORDER:
            return self._of_whole(driver)
        return recorded

    def _of_whole(self, driver: Driver) -> Array | None:
        """(n,) values that follow from the order of all rows of the whole recording; worked out once."""
        whole = self.whole
        if driver.name not in whole._told:
            values = remembered(whole, driver) if driver.numbers else from_order(whole, driver)
            whole._told[driver.name] = None if values is None else frozen(values)
        told = whole._told[driver.name]
        return told if told is None or self is whole else frozen(told[self.rows])

    def replicates(self) -> IntArray:
        """Label per row (n,): rows of one file, session and `pose` at the same readings share it."""
        if self.pose is None:
            return frozen(np.arange(len(self)))
        # 0.0 is added because -0.0 is the same reading
        numbers = np.column_stack([self.source_file, self.session, self.pose]).astype(np.float64)
        _, label = np.unique(np.column_stack([numbers, self.q]) + 0.0, axis=0, return_inverse=True)
        return frozen(np.asarray(label, dtype=np.int64).reshape(-1))

    def subset(self, rows: Rows) -> Recording:
        """Some rows, by index (repeats allowed), mask or slice; `from_row` goes on pointing into `whole`."""
        wanted = rows if isinstance(rows, slice) else np.asarray(rows)
        if not isinstance(wanted, slice) and not wanted.size:
            wanted = slice(0)  # an empty list has no integer type
        index = frozen(self._index(wanted))
        arrays: dict[str, Any] = {name: getattr(self, name) for name in _BY_ROW}
        own: dict[str, Any] = {n: None if v is None else frozen(v[index]) for n, v in arrays.items()}
        return replace(
            self,
            **own,
            observations={name: frozen(values[index]) for name, values in self.observations.items()},
            labels={name: tuple(texts[k] for k in index) for name, texts in self.labels.items()},
            drivers={name: frozen(values[index]) for name, values in self.drivers.items()},
            _whole=self.whole,
            _rows=index if self._rows is None else frozen(self._rows[index]),
        )

    def _index(self, wanted: slice | IntArray | BoolArray) -> IntArray:
        """(k,) places from 0 on; those counted from the end are."""
        if isinstance(wanted, slice):
            return np.arange(*wanted.indices(len(self)))
        places = np.flatnonzero(wanted) if wanted.dtype == np.bool_ else wanted
        if wanted.dtype == np.bool_ and len(wanted) != len(self):
            raise IndexError(f"found a mask of {len(wanted)} rows, expected {len(self)}")
        return np.where(places < 0, places + len(self), places).astype(np.int64)

    def where(self, row: int) -> str:
        """File and row of one of these rows, to name it in a message."""
        return f"{self.files[self.source_file[row]]}: row {self.source_row[row]}"


def frozen(array: A) -> A:
    """The array, made read-only."""
    array.setflags(write=False)
    return array


_NUMBERS: Final = {"stop": (1, 2), "loop": (3, 4), "creep": (1, 2), HEAT: (1,)}


def remembered(whole: Recording, driver: Driver) -> Array | None:
    """(n,) values of a driver that remembers; None when the recording lacks a column for it, or its name is unknown.

    ``whole`` is a whole recording, not a subset. Numbers are in the internal unit of the reading (mm, rad, turn).
    ``stop.J~r``: how far the reading of joint J leads the play operator of half width r, -r to r;
    ``loop.J~r~low~high``: the same less the straight line of a full loop from low to high;
    ``stop.J~r~o``, ``loop.J~r~low~high~o``: the same where every approach starts o behind its goal (else far);
    ``creep.J~t0``: sum over past moves of step * log10(1 + age / t0), t0 in s (needs ``time``);
    ``creep.J~t0~d``: the same where moves end d s before the row is read (else 0);
    ``heat.J~s``: sum over past moves of |step| exp(-age / s) (needs ``time``);
    ``D~seconds``: driver D through a first-order lag (needs ``time``).
    The way of a joint begins anew in every session, and without a clock in every file; creep and heat go on from session to
    session, as long as one clock runs through them. Rows that are declared shuffled tell no way.
    """
    *before, last = driver.numbers
    if driver.kind not in _KINDS:
        return _lagged(whole, replace(driver, numbers=tuple(before)).name, last)
    if not whole.shuffled and driver.place in whole.joints and len(driver.numbers) in _NUMBERS[driver.kind]:
        return _KINDS[driver.kind](whole, driver.place, list(driver.numbers))
    return None


def from_order(whole: Recording, driver: Driver) -> Array | None:
    """(n,) what the order of acquisition tells of a joint's last motion; None where it is declared to tell nothing.

    ``approach.J``: the side that joint J came from, kept while it rests, 0 until it moves; ``step.J``: how far it went
    from the row before, in the unit of its reading. Both begin anew in every piece of its way (see ``remembered``).
    """
    if whole.shuffled or driver.place not in whole.joints:
        return None
    order, joint = whole.order, whole.joints.index(driver.place)
    pieces, readings = _pieces(whole)[order], whole.moved[order]
    bands = TREMBLING * np.ptp(readings, axis=0) if len(readings) else np.zeros(len(whole.joints))
    out = np.empty(len(whole))
    if driver.kind == STEP:
        out[order] = last_steps(readings, pieces, bands)[:, joint]
    else:
        out[order] = side_of_arrival(readings[:, joint], pieces, float(bands[joint]))
    return out


def _pieces(whole: Recording) -> IntArray:
    """Label of the uninterrupted way that each row belongs to, (n,)."""
    _, session = np.unique(whole.session, return_inverse=True)
    if whole.time is not None:
        return np.asarray(session, dtype=np.int64)
    return np.asarray(
        session * (np.max(whole.source_file, initial=0) + 1) + whole.source_file, dtype=np.int64
    )


def _pieces_of_clock(whole: Recording, order: IntArray) -> IntArray:
    """(n,) zeros where one clock runs through all sessions, else ``_pieces``: sessions that overlap have their own."""
    changes = int(np.count_nonzero(np.diff(whole.session[order])))
    return np.zeros_like(order) if changes < len(np.unique(whole.session)) else _pieces(whole)


def _stop(whole: Recording, joint: str, numbers: list[float]) -> Array:
    order = whole.order
    recorded = whole.drivers.get(Driver(APPROACH, joint).name)
    approach = np.zeros(len(whole)) if recorded is None else np.sign(recorded)
    readings = whole.moved[:, whole.joints.index(joint)]
    out = np.empty(len(whole))
    out[order] = stop_operator(readings[order], approach[order], _pieces(whole)[order], *numbers)
    return out


def _loop(whole: Recording, joint: str, numbers: list[float]) -> Array:
    half_width, low, high, *overshoot = numbers
    readings = whole.moved[:, whole.joints.index(joint)]
    return _stop(whole, joint, [half_width, *overshoot]) - line_of_full_loop(readings, half_width, low, high)


def _by_clock(
    of_moves: Callable[..., Array], whole: Recording, joint: str, numbers: list[float]
) -> Array | None:
    """What moves of a joint leave behind for some time, one clock after another; None without a clock."""
    if whole.time is None:
        return None
    order = whole.order
    out = np.empty(len(whole))
    readings = whole.moved[:, whole.joints.index(joint)]
    pieces = _pieces_of_clock(whole, order)
    order = order[np.argsort(pieces[order], kind="stable")]
    out[order] = of_moves(whole.time[order], readings[order], pieces[order], *numbers)
    return out


def _lagged(whole: Recording, name: str, seconds: float) -> Array | None:
    values = whole.driver(name)
    if values is None or whole.time is None:
        return None
    order = whole.order
    lagged = np.empty_like(values)
    lagged[order] = exponential_lag(whole.time[order], values[order], seconds)
    return lagged


_KINDS: Final[Mapping[str, Callable[[Recording, str, list[float]], Array | None]]] = {
    "stop": _stop,
    "loop": _loop,
    "creep": partial(_by_clock, creep_sum),
    HEAT: partial(_by_clock, heat_of_motion),
}
