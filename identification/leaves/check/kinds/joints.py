"""Joints that turn the other way, that were exchanged, or whose zero is elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations, permutations
from typing import TypeVar

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.check.pair import RARE, SELDOM, USUAL, Field, Pair, Scene, Sheet, Slip
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.leaves.check.weighing import bound
from truepose.models.machine.mechanism import Actuator
from truepose.models.units import convert
from truepose.wording import joined

# -- The size of a slip that fits best: a grid, then halved steps

_HALVED = 8


def narrowed(misfit: Callable[[float], float], grid: Array) -> float:
    """Return where a misfit is least: the best of a grid, then halved steps around it."""
    tried = {float(size): misfit(float(size)) for size in grid}
    best = min(tried, key=lambda size: tried[size])
    order = sorted(tried)
    at = order.index(best)
    step = max(abs(order[min(at + 1, len(order) - 1)] - best), abs(best - order[max(at - 1, 0)]))
    for _ in range(_HALVED):
        step /= 2
        for size in (best - step, best + step):
            tried[size] = misfit(size)
        best = min((best - step, best, best + step), key=lambda size: tried[size])
    return best


# -- Joints that turn the other way, that were exchanged, or whose zero is elsewhere

T = TypeVar("T")
QUARTERS = (90.0, -90.0, 180.0)
"""Degrees that data sheets and controllers differ by."""
LEAST = np.radians(3.0)
"""A zero that is off by less is what a calibration is there to find."""
_GRID = 24


def signs(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Each joint with the other sign, all of one kind, and all."""
    every = range(len(rig.actuators))
    kinds = [tuple(k for k in every if rig.actuators[k].reading_unit == unit) for unit in ("rad", "mm")]
    several = dict.fromkeys(places for places in (*kinds, tuple(every)) if len(places) > 1)
    yield from (_reversed(rig, places) for places in [*((k,) for k in every), *several])


def _reversed(rig: Rig, places: Sequence[int]) -> Slip:
    """Joints with the other sign, and so the sides and speeds of their arrival."""
    names = tuple(rig.actuators[k].reading for k in places)
    one = len(names) == 1
    every = [f"{head}{name}" for name in names for head in ("", "approach.", "velocity.")]
    return Slip(
        "sign",
        names,
        f"{joined(names)} counted the other way",
        f"change the sign of column{'' if one else 's'} {joined(names)}, or turn {'its axis' if one else 'their axes'} in "
        "the machine file",
        lambda scene: scene.with_joint_columns({k: -scene.rows.q[:, k] for k in places}),
        lambda pair: pair.negated(every),
        USUAL if one else SELDOM,
    )


def exchanged(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Two joints of one kind exchanged, or all of them in the other order, or some places along."""
    n = len(rig.actuators)
    orders: list[tuple[int, ...]] = []
    for i, j in combinations(range(n), 2):
        if rig.actuators[i].reading_unit == rig.actuators[j].reading_unit:
            orders.append(tuple({i: j, j: i}.get(k, k) for k in range(n)))
    if len({a.reading_unit for a in rig.actuators}) == 1 and n > 2:
        orders += [tuple(range(n))[::-1], *((*range(by, n), *range(by)) for by in range(1, n))]
    yield from (_reordered(rig, order) for order in dict.fromkeys(orders))


def _reordered(rig: Rig, order: Sequence[int]) -> Slip:
    moved = [k for k in range(len(order)) if order[k] != k]
    names = tuple(rig.actuators[k].reading for k in moved)
    called = {rig.actuators[order[k]].reading: rig.actuators[k].reading for k in moved}
    heads = ("", "approach.", "velocity.", "temperature.")
    every = {f"{head}{a}": f"{head}{b}" for a, b in called.items() for head in heads}
    two = len(names) == 2
    return Slip(
        "permutation",
        names,
        f"{joined(names)} {'exchanged' if two else 'in another order'}",
        f"exchange the headers of columns {joined(names)}"
        if two
        else "rename the columns: " + ", ".join(f"{a} is {b}" for a, b in called.items()),
        lambda scene: scene.with_joints(scene.rows.q[:, list(order)]),
        lambda pair: pair.renamed(every),
        USUAL if two else SELDOM,
    )


def quarter_turns(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Each turning joint with its zero a quarter or half turn away."""
    for k, a in enumerate(rig.actuators):
        if a.reading_unit == "rad":
            for degrees in QUARTERS:
                yield offset(rig, k, np.radians(degrees))


def offset(rig: Rig, k: int, size: float, *, searched: bool = False) -> Slip:
    """Joint k with its zero elsewhere by ``size`` (in the unit of its reading inside)."""
    a = rig.actuators[k]
    unit = rig.machine.column_unit(a.reading)
    shown = f"{convert(size, a.reading_unit, unit):+.6g} {unit}"
    return Slip(
        "offset",
        (a.reading,),
        f"zero of {a.reading} off by {shown}",
        f"add {shown} to the zero of {a.reading} in the machine file, or to its column",
        partial(_plus, k, size),
        partial(_shifted_zero, rig, k, size),
        RARE if searched else USUAL,
    )


def _plus(k: int, size: float, scene: Scene) -> Scene:
    return scene.with_joint_columns({k: scene.rows.q[:, k] + size})


def _shifted_zero(rig: Rig, k: int, size: float, pair: Pair) -> Pair:
    """In the constant that is the joint's zero where the file has a field for it, else in the column.

    In the column, too, where readings leave the joint's range: the range counts from the right zero.
    """
    a = rig.actuators[k]
    unit = rig.machine.units.written(a.unit)
    field = None if _beyond(a, rig.recording.q[:, k]) else _zero_field(rig, a, pair)
    if field is not None:
        inside = convert(float(pair.get(field) or 0.0), unit, a.unit) + size
        return pair.with_field(field, float(f"{convert(inside, a.unit, unit):.9g}"))

    def change(sheet: Sheet) -> Sheet:
        own = sheet.units.get(a.reading) or rig.machine.column_unit(a.reading)
        read = sheet.numbers(a.reading) + convert(size, a.reading_unit, own)
        turns = convert(1.0, "rad", own) * _turns_back(a, read, own) if a.reading_unit == "rad" else 0.0
        return sheet.with_numbers({a.reading: read + turns})

    return pair.each(change)


def _turns_back(a: Actuator, read: Array, unit: str) -> Array:
    """(n,) whole turns, rad, that bring a turning joint's readings (n,) back into its range, as encoders count."""
    if a.range is None:
        return np.zeros(len(read))
    q = np.array([convert(float(v), unit, "rad") for v in read])
    out = (q < a.range[0]) | (q > a.range[1])
    return np.where(out, 2 * np.pi * np.round((sum(a.range) / 2 - q) / (2 * np.pi)), 0.0)


def _beyond(a: Actuator, q: Array) -> bool:
    return a.range is not None and bool(q.min() < a.range[0] or q.max() > a.range[1])


def _zero_field(rig: Rig, a: Actuator, pair: Pair) -> Field | None:
    """Where the document states the joint's zero; None where it has no place for it."""
    ends = ("theta", "offset") if a.unit == "rad" else ("r", "offset")
    table = pair.get(("mechanism", "convention")) not in (None, "khalil")
    for name in (*(f"{a.drives}.{end}" for end in ends), a.offset or ""):
        parameter = rig.machine.geometry.get(name)
        if parameter is None or not parameter.field or not parameter.unit == a.unit == a.reading_unit:
            continue
        if table and not name.endswith(".theta"):
            continue
        value, above = pair.get(parameter.field), pair.get(parameter.field[:-1])
        if isinstance(above, Mapping) and (value is None or isinstance(value, (int, float))):
            return parameter.field
    return None


def mirrored_zeros(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Yield each turning joint counted the other way, with its zero a quarter or half turn away."""
    for k, a in enumerate(rig.actuators):
        negative = _reversed(rig, (k,))
        for degrees in QUARTERS if a.reading_unit == "rad" else ():
            zero = offset(rig, k, np.radians(degrees))
            yield replace(
                negative,
                says=f"{negative.says}, {zero.says}",
                fix=f"{negative.fix}; then {zero.fix}",
                change=partial(_both, negative.change, zero.change),
                mend=partial(_both, negative.mend, zero.mend),
                odds=SELDOM,
            )


def _both(first: Callable[[T], T], second: Callable[[T], T], held: T) -> T:
    return second(first(held))


def zeros(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Each joint with the zero that fits best, wherever that is: one search a joint."""
    for k in range(len(rig.actuators)):
        yield from _searched(rig, scene, k, lambda moved: rig.stand(moved, quick=True).misfit)


def end_zeros(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """The zero of the first and of the last joint with which base and tool stand where the file says.

    Such a zero is a motion of the base or of the tool: readings alone do not tell it.
    """
    mechanism = rig.machine.mechanism
    if mechanism.closing or mechanism.rods:
        return

    def against(moved: Scene) -> float:
        return -bound(rig, rig.stand(moved, (), quick=True), (), 1.0)

    for k in sorted({0, len(mechanism.actuators) - 1}):
        yield from _searched(rig, scene, k, against)


def _searched(rig: Rig, scene: Scene, k: int, against: Callable[[Scene], float]) -> Iterator[Slip]:
    """Yield the zero of joint k with which least speaks against a scene: a slide's is up to four times its way off."""
    turns = rig.actuators[k].reading_unit == "rad"
    span = float(np.ptp(scene.rows.q[:, k])) or 1.0
    ways = np.concatenate([-np.geomspace(4.0, 0.05, 8), [0.0], np.geomspace(0.05, 4.0, 8)])
    grid = np.linspace(-np.pi, np.pi, _GRID, endpoint=False) if turns else span * ways
    found = narrowed(lambda size: against(_plus(k, size, scene)), grid)
    if abs(found) > (LEAST if turns else 0.02 * span):
        yield offset(rig, k, found, searched=True)


# -- Readings of joints that are not the joints' own angles: one counted from another joint, and encoders' counts

_SPANS = {"rad": np.radians([15.0, 720.0]), "mm": np.array([5.0, 5000.0])}
"""Between what a joint's motion in a recording lies."""
_TURNS = 4.2 * np.pi
"""rad; no joint of an arm turns further than this between two readings, so that more are counts, or degrees taken for turns."""
_STEP = 0.3
"""rad, of the widest motion: a fit finds its way from there."""
_LENGTHS = 48
_COARSEST = 8.0
"""Counts for what was taken for one unit, at least: a scale that is a little off is physics."""
_ROUND = 0.15
"""Share by which the count for a turn that fits best may miss a round number that was meant."""


def coupled(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Yield each joint with its reading counted from another joint's: the horizon of a parallelogram or of a teach pendant."""
    for k, j in permutations(range(len(rig.actuators)), 2):
        unit = rig.actuators[k].reading_unit
        if unit == rig.actuators[j].reading_unit and unit in _SPANS:
            yield from (_coupled(rig, k, j, ratio) for ratio in (1.0, -1.0))


def _coupled(rig: Rig, k: int, j: int, ratio: float) -> Slip:
    mine, other = (rig.actuators[i] for i in (k, j))
    return Slip(
        "coupled",
        (mine.reading, other.reading),
        f"the reading of {mine.reading} is coupled: its own {'angle' if mine.reading_unit == 'rad' else 'travel'} "
        f"{'+' if ratio > 0 else '-'} {other.reading} (counted from the horizon, or by a linkage; k = {ratio:g})",
        f"state 'coupled: {{{other.reading}: {ratio:g}}}' at {mine.reading} in the machine file",
        lambda scene: scene.with_joint_columns({k: scene.rows.q[:, k] - ratio * scene.rows.q[:, j]}),
        lambda pair: pair.with_field(
            _joint_field(rig, pair, mine.reading, "coupled"), {other.reading: ratio}
        ),
        USUAL if abs(k - j) == 1 else SELDOM,
    )


def counts(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Yield joints that read more than a joint turns, each alone and all of them, as counts of an encoder."""
    units = [rig.machine.column_unit(a.reading) for a in rig.actuators]
    read = zip(rig.actuators, units, scene.rows.q.T, strict=True)
    wide = [k for k, (a, unit, q) in enumerate(read) if a.reading_unit in _SPANS and _counted(a, unit, q)]
    alike = len(wide) > 1 and len({rig.actuators[k].reading_unit for k in wide}) == 1
    for places in [*([tuple(wide)] if alike else []), *((k,) for k in wide)]:
        yield from _as_counts(rig, scene, places)


def _counted(a: Actuator, unit: str, q: Array) -> bool:
    """Whether readings may be counts: whole numbers, or further apart than a joint moves."""
    written = np.asarray(convert(q, a.reading_unit, unit))
    whole = len(np.unique(written)) > 3 and np.allclose(written, np.round(written), atol=1e-6)
    far = a.reading_unit == "rad" and np.ptp(q) > _TURNS
    return bool(far or whole)


def _as_counts(rig: Rig, scene: Scene, places: Sequence[int]) -> Iterator[Slip]:
    unit = rig.actuators[places[0]].reading_unit
    written = rig.machine.column_unit(rig.actuators[places[0]].reading)
    span = max(float(np.ptp(scene.rows.q[:, k])) for k in places)
    low, high = np.minimum(_SPANS[unit] / span, 1.0 / _COARSEST)
    if unit == "rad":
        grid = np.linspace(low, high, int((high - low) * span / _STEP) + 2)
    else:
        grid = np.geomspace(low, high, _LENGTHS)
    columns = tuple(rig.actuators[k].reading for k in places)

    def misfit(factor: float) -> float:
        return rig.stand(_scaled(places, factor, scene), quick=True).misfit

    per, what = (2.0 * np.pi, "turn") if unit == "rad" else (1.0, "mm")
    name = joined(columns)
    for sign, way in ((1.0, ""), (-1.0, ", counted the other way")):
        found = abs(narrowed(misfit, sign * grid))
        counted = convert(per / found, unit, written)  # how many of what was written make a turn, or a mm
        for number, odds in _numbers(counted).items():
            yield Slip(
                "counts",
                columns,
                f"{name} in counts of an encoder, {number:.7g} a {what}{way}",
                f"state 'counts: {sign * number:.7g}' at {name} in the machine file",
                partial(_scaled, places, sign * (per / convert(number, written, unit))),
                partial(_mend_counts, rig, columns, sign * number),
                odds,
            )


def _scaled(places: Sequence[int], factor: float, scene: Scene) -> Scene:
    return scene.with_joint_columns({k: factor * scene.rows.q[:, k] for k in places})


def _numbers(fitted: float) -> dict[float, float]:
    """Return counts a turn that may be meant where one number fits best, each with its odds: encoders have round ones."""
    decade = 10.0 ** np.floor(np.log10(fitted))
    near = [2.0 ** np.round(np.log2(fitted)), *(decade * np.array([1, 2, 2.5, 3.6, 4, 5, 8, 10]))]
    close = {float(n): SELDOM for n in near if abs(n / fitted - 1.0) < _ROUND}
    return {float(f"{fitted:.7g}"): RARE, **close}


def _mend_counts(rig: Rig, columns: Sequence[str], number: float, pair: Pair) -> Pair:
    for name in columns:
        pair = pair.with_field(_joint_field(rig, pair, name, "counts"), number)
    return pair


def _joint_field(rig: Rig, pair: Pair, reading: str, key: str) -> Field:
    """Return where a machine file says of the joint or leg with a reading what its column holds."""
    names = {a.reading: {a.reading, a.drives} for a in rig.actuators}[reading]
    for group in ("joints", "legs", "first", "second"):
        rows = pair.get(("mechanism", group))
        for k, row in enumerate(rows if isinstance(rows, list) else ()):
            if isinstance(row, Mapping) and {row.get("name"), row.get("joint")} & names:
                return ("mechanism", group, k, key)
    return ("mechanism", "encoders", reading, key)
