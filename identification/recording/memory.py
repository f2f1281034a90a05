"""Drivers that remember: what a joint's way, or a temperature's past, leaves behind at every row.

Beside them: what the order of the rows alone tells of the last motion (``from_order``).

They are computed from the whole recording in order of acquisition, so that a part of it, or its rows in another
order, means the same where time is recorded. See ``remembered`` for their names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from truepose.arrays import Array
from truepose.identification.recording.history import (
    creep_sum,
    exponential_lag,
    last_steps,
    line_of_full_loop,
    side_of_arrival,
    stop_operator,
)
from truepose.models.file.driver import APPROACH, STEP, TREMBLING, Driver

IntArray = npt.NDArray[np.int64]
_NUMBERS: Final = {"stop": (1, 2), "loop": (3, 4), "creep": (1, 2)}


if TYPE_CHECKING:
    from truepose.identification.recording.recording import Recording


def remembered(whole: Recording, driver: Driver) -> Array | None:
    """(n,) values of a driver that remembers; None when the recording lacks a column for it, or its name is unknown.

    ``whole`` is a whole recording, not a subset. Numbers are in the internal unit of the reading (mm, rad, turn).
    ``stop.J~r``: how far the reading of joint J leads the play operator of half width r, -r to r;
    ``loop.J~r~low~high``: the same less the straight line of a full loop from low to high;
    ``stop.J~r~o``, ``loop.J~r~low~high~o``: the same where every approach starts o behind its goal (else far);
    ``creep.J~t0``: sum over past moves of step * log10(1 + age / t0), t0 in s (needs ``time``);
    ``creep.J~t0~d``: the same where moves end d s before the row is read (else 0);
    ``D~seconds``: driver D through a first-order lag (needs ``time``).
    The way of a joint begins anew in every session, and without a clock in every file; creep goes on from session to
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


def _creep(whole: Recording, joint: str, numbers: list[float]) -> Array | None:
    if whole.time is None:
        return None
    order = whole.order
    out = np.empty(len(whole))
    readings = whole.moved[:, whole.joints.index(joint)]
    pieces = _pieces_of_clock(whole, order)
    order = order[np.argsort(pieces[order], kind="stable")]  # one clock after another
    out[order] = creep_sum(whole.time[order], readings[order], pieces[order], *numbers)
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
    "creep": _creep,
}
