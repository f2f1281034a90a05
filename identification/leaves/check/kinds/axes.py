"""Measured axes with another sign or in another order, and targets that were exchanged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from truepose.identification.leaves.check.pair import Pair, Sheet
from truepose.identification.leaves.check.rig import Rig, Scene
from truepose.identification.leaves.check.slip import SELDOM, USUAL, Slip
from truepose.models.sensors.pose import Pose, Position
from truepose.models.sensors.targets import Targets
from truepose.wording import joined

Array = NDArray[np.float64]
_XYZ, _TURN = ("x", "y", "z"), ("rx", "ry", "rz")
_MOST_TARGETS = 4


def mirrored(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """A measuring frame of the other hand: one axis with the other sign, or two axes exchanged.

    Where turns are read, they may have been mirrored as well or not. All frames mirrored as a whole differ by a turn of base
    and tool only: one stands for all where those are unknown, six plain ones else.
    """
    every = [m for m in _maps() if _hand(*m) < 0]
    known = np.isfinite(rig.tolerance[rig.at["base"]]).all()
    for order, signs in every[:6] if known else [m for m in every if m == ((0, 1, 2), (1, 1, -1))]:
        yield from _mapped(rig, order, signs, whole=True)
    if _turns(rig):
        for order, signs in every:
            yield from _mapped(rig, order, signs, whole=False)


def turned(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Axes in another order or with other signs, of the same hand: seen only where turns are read too, or the base is known."""
    for order, signs in _maps():
        if _hand(order, signs) > 0 and (order, signs) != ((0, 1, 2), (1, 1, 1)):
            yield from _mapped(rig, order, signs, whole=False)


def _turns(rig: Rig) -> bool:
    return any(isinstance(sensor, Pose) for sensor in rig.machine.sensors)


def _maps() -> Iterator[tuple[tuple[int, ...], tuple[int, ...]]]:
    """The signed permutations, plain ones first."""
    every = [(o, s) for o in permutations(range(3)) for s in product((1, -1), repeat=3)]
    return iter(
        sorted(every, key=lambda m: sum(k != a for k, a in enumerate(m[0])) + sum(s < 0 for s in m[1]))
    )


def _hand(order: Sequence[int], signs: Sequence[int]) -> float:
    matrix = np.zeros((3, 3))
    matrix[range(3), order] = signs
    return float(np.linalg.det(matrix))


def _mapped(rig: Rig, order: tuple[int, ...], signs: tuple[int, ...], *, whole: bool) -> Iterator[Slip]:
    points = _points(rig)
    if not points:
        return
    turns = whole and _turns(rig)
    exchanged = [_XYZ[k] for k in range(3) if order[k] != k]
    flipped = [_XYZ[k] for k in range(3) if signs[k] < 0]
    parts = [_exchange(exchanged, order)] if exchanged else []
    parts += [f"{joined(flipped)} with the other sign"] if flipped else []
    told = joined(parts) + (", turns mirrored too" if turns else "")
    swap = exchanged and not flipped
    kind = "permutation" if swap else "handedness"
    yield Slip(
        kind,
        tuple(exchanged if swap else dict.fromkeys([*exchanged, *flipped])),
        f"measured {told}",
        f"{'exchange the headers of' if swap else 'change'} the sensor's columns: {told}",
        partial(_remapped, points, order, signs, turns),
        partial(_mend, points, order, signs, turns),
        USUAL if len(exchanged) + len(flipped) <= 2 else SELDOM,
    )


def _exchange(names: Sequence[str], order: Sequence[int]) -> str:
    """Two axes exchanged; of three it is said which stands where, as they may have gone round either way."""
    if len(names) == 2:
        return f"{joined(names)} exchanged"
    places = ", ".join(f"{name} in {_XYZ[there]}" for name, there in zip(_XYZ, order, strict=True))
    return f"{joined(names)} in another order ({places})"


def _points(rig: Rig) -> list[tuple[str, str, str]]:
    """Columns x, y, z of every point that is measured."""
    out = []
    for sensor in rig.machine.sensors:
        names = list(sensor.columns)
        if isinstance(sensor, (Pose, Position)):
            out.append((names[0], names[1], names[2]))
        elif isinstance(sensor, Targets):
            out += [(names[k], names[k + 1], names[k + 2]) for k in range(0, len(names), 3)]
    return out


def _remapped(
    points: Sequence[tuple[str, str, str]],
    order: Sequence[int],
    signs: Sequence[int],
    turns: bool,
    scene: Scene,
) -> Scene:
    return scene.with_columns(_columns(scene.rows.observations, points, order, signs, turns))


def _columns(
    seen: Mapping[str, Array],
    points: Sequence[tuple[str, str, str]],
    order: Sequence[int],
    signs: Sequence[int],
    turns: bool,
) -> dict[str, Array]:
    """Columns of points in the mapped axes, and of rotation vectors: S Exp(w) S' = Exp(det(S) S w)."""
    out = {triple[k]: signs[k] * seen[triple[order[k]]] for triple in points for k in range(3)}
    hand = _hand(order, signs)
    return out | {_TURN[k]: hand * signs[k] * seen[_TURN[order[k]]] for k in range(3) if turns}


def _mend(
    points: Sequence[tuple[str, str, str]],
    order: Sequence[int],
    signs: Sequence[int],
    turns: bool,
    pair: Pair,
) -> Pair:
    names = [n for triple in (*points, *((_TURN,) if turns else ())) for n in triple]

    def change(sheet: Sheet) -> Sheet:
        here = {n: sheet.numbers(n) for n in names if n in sheet.units}
        return sheet.with_numbers(_columns(here, points, order, signs, turns)) if here else sheet

    return pair.each(change)


def targets(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Targets exchanged: every order of a few, pairs of many."""
    for sensor in rig.machine.sensors:
        if not isinstance(sensor, Targets):
            continue
        labels = list(dict.fromkeys(n.rpartition(".")[0] for n in sensor.columns))
        for order in _orders(len(labels)):
            moved = [k for k in range(len(labels)) if order[k] != k]
            called = {f"{labels[order[k]]}.{a}": f"{labels[k]}.{a}" for k in moved for a in _XYZ}
            names = tuple(labels[k] for k in moved)
            yield Slip(
                "permutation",
                names,
                f"targets {joined(names)} {'exchanged' if len(names) == 2 else 'in another order'}",
                "rename the columns: " + ", ".join(f"{labels[order[k]]} is {labels[k]}" for k in moved),
                partial(_relabelled, called),
                partial(_mend_labels, called),
                USUAL if len(names) == 2 else SELDOM,
            )


def _mend_labels(called: Mapping[str, str], pair: Pair) -> Pair:
    return pair.each(lambda sheet: sheet.renamed(called))


def _orders(n: int) -> Iterator[tuple[int, ...]]:
    still = tuple(range(n))
    if n <= _MOST_TARGETS:
        yield from sorted(
            (o for o in permutations(still) if o != still),
            key=lambda o: sum(a != b for a, b in zip(o, still, strict=True)),
        )
        return
    for i in range(n):
        for j in range(i + 1, n):
            order = list(still)
            order[i], order[j] = j, i
            yield tuple(order)


def _relabelled(called: Mapping[str, str], scene: Scene) -> Scene:
    return scene.with_columns({new: scene.rows.observations[old] for old, new in called.items()})


__all__ = ["mirrored", "targets", "turned"]
