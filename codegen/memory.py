"""What the generated ``NAME_state`` follows: drivers that depend on what was before, as a plan for its template.

The values are those of ``truepose.identification.recording.recording`` where each update is a row: a controller sees every
motion, so that a side of arrival that a recording states, an approach from behind a goal (``stop.J~r~o``) and the time
between the end of a move and its row (``creep.J~t0~d``) are updates of their own there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

from truepose.codegen.layout import Layout, sample_ranges
from truepose.models.file.driver import APPROACH, STEP, Driver
from truepose.models.machine.kinematics import SymbolicModel, driver_default
from truepose.models.machine.mechanism import coupling_matrix

LONGEST = 1e6
"""s: creep is followed for so long after a move (twelve days), then it stands."""
SLOWEST = 1e-3 / LONGEST
"""1/s: rate of the slowest exponential of creep; what is neglected is half of its square after the longest time."""
_HIGHEST = 32.0
"""Rate of the fastest, times t0: what is neglected is exp(-32)."""
_WAY = {"stop": (1, 2), "loop": (3, 4), "creep": (1, 2)}
_KINDS = ("sensed", "arrival", "stop", "creep", "lag")
_Key = tuple[Any, ...]


@dataclass(frozen=True)
class Field:
    """An array of the struct."""

    name: str
    size: int
    meaning: str


@dataclass(frozen=True)
class Memory:
    """Drivers as values v: sensed ones, arrivals, stops, creeps, lags, one kind after the other.

    sensed            names of those that the controller gives, with units and values where it does not
    arrivals          joints
    stops             joint, half width, and slope and middle of the line that is taken off
    creeps            joint, t0 (s), and how many exponentials, each twice as fast as the one before
    lags              place in v of what is followed, and seconds
    places            in v, of every driver in the order of z; -1 where it rests
    travel            of the joints, of which TREMBLING is no motion: their ranges
    uncoupling        lines of the matrix from readings to the joints' own motions; none where they are the same
    """

    sensed: tuple[tuple[str, str, float], ...]
    arrivals: tuple[int, ...]
    stops: tuple[tuple[int, float, float, float], ...]
    creeps: tuple[tuple[int, float, int], ...]
    lags: tuple[tuple[int, float], ...]
    places: tuple[int, ...]
    travel: tuple[float, ...]
    uncoupling: tuple[float, ...] = ()

    @property
    def remembers(self) -> bool:
        """Whether any driver depends on what was before."""
        return bool(self.arrivals or self.stops or self.creeps or self.lags)

    @property
    def weights(self) -> tuple[float, ...]:
        """Of the exponentials of all creeps, one after the other; the slowest of each stands for all slower ones as well."""
        share = math.log(2.0) / math.log(10.0)
        rates = [(SLOWEST * 2.0**k * t0, 1 + (k == 0)) for _, t0, count in self.creeps for k in range(count)]
        return tuple(float(f"{share * twice * math.exp(-rate):.15g}") for rate, twice in rates)

    @property
    def fields(self) -> tuple[Field, ...]:
        """Arrays of the struct, in order; those without entries are not in it."""
        arrivals, terms, lags = len(self.arrivals), len(self.weights), len(self.lags)
        return (
            Field("side", arrivals, "that joints arrived from"),
            Field("top", arrivals, "where they were furthest"),
            Field("bottom", arrivals, "the other way"),
            Field("band", arrivals, "within which nothing moves"),
            Field("lead", len(self.stops), "of the reading before the play"),
            Field("start", len(self.creeps), "where creep counts from"),
            Field("crept", terms, "its exponentials"),
            Field("creep_lost", terms, "what rounding took from them"),
            Field("before", lags, "what bodies follow, at the latest update"),
            Field("lagged", lags, "where they are"),
            Field("lag_lost", lags, "what rounding took from that"),
        )

    @property
    def values(self) -> int:
        """Length of v."""
        parts = (self.sensed, self.arrivals, self.stops, self.creeps, self.lags)
        return sum(len(part) for part in parts)


def followed(driver: Driver, readings: Sequence[str]) -> bool:
    """Whether a driver depends on what was before, in a way that the generated code follows."""
    if driver.kind in _WAY:
        return driver.place in readings and len(driver.numbers) in _WAY[driver.kind]
    return bool(driver.numbers) or (driver.kind == APPROACH and driver.place in readings)


def memory_of(model: SymbolicModel, layout: Layout) -> Memory:
    """The plan of a model's drivers."""
    found: dict[str, list[_Key]] = {kind: [] for kind in _KINDS}
    keys = [_collected(model, Driver.of(name), found) for name in model.drivers]
    starts = {kind: sum(len(found[other]) for other in _KINDS[:k]) for k, kind in enumerate(_KINDS)}

    def place(key: _Key | None) -> int:
        return starts[key[0]] + found[key[0]].index(key) if key else -1

    low, high = sample_ranges(model.machine, layout.near, layout.reach)
    machine = model.machine
    matrix = coupling_matrix(machine.mechanism)
    return Memory(
        sensed=tuple(
            (n, machine.driver_unit(n) or "1", driver_default(machine, n)) for _, n in found["sensed"]
        ),
        arrivals=tuple(joint for _, joint in found["arrival"]),
        stops=tuple((joint, *numbers) for _, joint, *numbers in found["stop"]),
        creeps=tuple((joint, *_exponentials(t0)) for _, joint, t0 in found["creep"]),
        lags=tuple((place(key), seconds) for _, key, seconds in found["lag"]),
        places=tuple(place(key) for key in keys),
        travel=tuple(float(f"{width:.9g}") for width in high - low),
        uncoupling=() if matrix is None else tuple(matrix.ravel().tolist()),
    )


def _collected(model: SymbolicModel, driver: Driver, found: dict[str, list[_Key]]) -> _Key | None:
    """Key of a driver, noted under its kind with what it follows before it; None where it rests."""
    readings, key = model.readings, cast("_Key", ("sensed", driver.name))
    if driver.kind == STEP:
        return None
    if followed(driver, readings):
        if driver.kind == "creep":
            key = ("creep", readings.index(driver.place), driver.numbers[0])
        elif driver.kind in _WAY:
            key = ("stop", readings.index(driver.place), driver.numbers[0], *_line(driver))
        elif driver.numbers:
            *before, seconds = driver.numbers
            inner = _collected(model, replace(driver, numbers=tuple(before)), found)
            if inner is None or seconds <= 0.0:
                return inner
            key = ("lag", inner, seconds)
        else:
            key = ("arrival", readings.index(driver.place))
    if key not in found[key[0]]:
        found[key[0]].append(key)
    return key


def _line(driver: Driver) -> tuple[float, float]:
    """Slope and middle of the line of a full loop, which ``loop`` takes off."""
    if driver.kind != "loop":
        return 0.0, 0.0
    half_width, low, high = driver.numbers[:3]
    t = min(half_width / ((high - low) / 2), 1.0)
    return t**2 * (3.0 - 2.0 * t), (low + high) / 2


def _exponentials(t0: float) -> tuple[float, int]:
    """t0 and the number of the exponentials that log10(1 + age / t0) is made of.

    log(1 + x) is the integral of (1 - exp(-x s)) exp(-s) over log s; the trapezoidal rule at powers of two leaves 1e-6.
    """
    return t0, math.ceil(math.log2(_HIGHEST / (SLOWEST * t0))) + 1
