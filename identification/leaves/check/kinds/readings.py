"""Readings of joints that are not the joints' own angles: one counted from another joint, and encoders' counts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from truepose.identification.leaves.check.kinds.joints import narrowed
from truepose.identification.leaves.check.pair import RARE, SELDOM, USUAL, Field, Pair, Scene, Slip
from truepose.identification.leaves.check.rig import Rig
from truepose.models.machine.mechanism import Actuator
from truepose.models.units import convert
from truepose.wording import joined

Array = NDArray[np.float64]
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
    actuators = rig.machine.mechanism.actuators
    for k, j in permutations(range(len(actuators)), 2):
        unit = actuators[k].reading_unit
        if unit == actuators[j].reading_unit and unit in _SPANS:
            yield from (_coupled(rig, k, j, ratio) for ratio in (1.0, -1.0))


def _coupled(rig: Rig, k: int, j: int, ratio: float) -> Slip:
    mine, other = (rig.machine.mechanism.actuators[i] for i in (k, j))
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
    actuators = rig.machine.mechanism.actuators
    units = [rig.machine.column_unit(a.reading) for a in actuators]
    read = zip(actuators, units, scene.rows.q.T, strict=True)
    wide = [k for k, (a, unit, q) in enumerate(read) if a.reading_unit in _SPANS and _counted(a, unit, q)]
    alike = len(wide) > 1 and len({actuators[k].reading_unit for k in wide}) == 1
    for places in [*([tuple(wide)] if alike else []), *((k,) for k in wide)]:
        yield from _as_counts(rig, scene, places)


def _counted(a: Actuator, unit: str, q: Array) -> bool:
    """Whether readings may be counts: whole numbers, or further apart than a joint moves."""
    written = np.asarray(convert(q, a.reading_unit, unit))
    whole = len(np.unique(written)) > 3 and np.allclose(written, np.round(written), atol=1e-6)
    far = a.reading_unit == "rad" and np.ptp(q) > _TURNS
    return bool(far or whole)


def _as_counts(rig: Rig, scene: Scene, places: Sequence[int]) -> Iterator[Slip]:
    actuators = rig.machine.mechanism.actuators
    unit = actuators[places[0]].reading_unit
    written = rig.machine.column_unit(actuators[places[0]].reading)
    span = max(float(np.ptp(scene.rows.q[:, k])) for k in places)
    low, high = np.minimum(_SPANS[unit] / span, 1.0 / _COARSEST)
    if unit == "rad":
        grid = np.linspace(low, high, int((high - low) * span / _STEP) + 2)
    else:
        grid = np.geomspace(low, high, _LENGTHS)
    columns = tuple(actuators[k].reading for k in places)

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
    names = {a.reading: {a.reading, a.drives} for a in rig.machine.mechanism.actuators}[reading]
    for group in ("joints", "legs", "first", "second"):
        rows = pair.get(("mechanism", group))
        for k, row in enumerate(rows if isinstance(rows, list) else ()):
            if isinstance(row, Mapping) and {row.get("name"), row.get("joint")} & names:
                return ("mechanism", group, k, key)
    return ("mechanism", "encoders", reading, key)
