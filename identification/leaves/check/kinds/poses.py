"""Poses given the other way round, or with angles of another convention in the columns of the rotation vector.

Measured axes with another sign or in another order, and targets that were exchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose.identification.leaves.check.pair import SELDOM, USUAL, Pair, Sheet, Slip
from truepose.identification.leaves.check.rig import Rig, Scene
from truepose.models.sensors.pose import Pose, Position
from truepose.models.sensors.targets import Targets
from truepose.models.units import convert
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
        partial(_mend_axes, points, order, signs, turns),
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


def _mend_axes(
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


_SIX = ("x", "y", "z", "rx", "ry", "rz")
_PROPER = ("xyx", "xzx", "yxy", "yzy", "zxz", "zyz")


def poses(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """The inverse pose, the inverse rotation, and all orders of Euler's angles, about moving or fixed axes."""
    if not any(isinstance(sensor, Pose) for sensor in rig.machine.sensors):
        return
    yield _slip(
        rig,
        "inverse-pose",
        "poses of the measuring frame in the tool (inverse)",
        "give the pose of the tool in the measuring frame",
        _inverse,
    )
    yield _slip(
        rig,
        "rotation-convention",
        "rx, ry, rz of the inverse rotation",
        "give the rotation of the tool, not its inverse",
        _turned_back,
    )
    for says, change in (*_quaternions(), *_angles()):
        yield _slip(rig, "rotation-convention", says, "write rotation vectors (axis times angle)", change)


def _quaternions() -> Iterator[tuple[str, Callable[[Array], Array]]]:
    """Yield orders in which a quaternion may have been read: in words, and as what puts rotation vectors right."""
    last, first = "scalar last (x, y, z, w)", "scalar first (w, x, y, z)"
    yield (
        f"the quaternion behind rx, ry, rz was {first} and read as {last}",
        partial(_requaternioned, (1, 2, 3, 0)),
    )
    yield (
        f"the quaternion behind rx, ry, rz was {last} and read as {first}",
        partial(_requaternioned, (3, 0, 1, 2)),
    )


def _requaternioned(order: tuple[int, ...], six: Array) -> Array:
    """Rotation vectors whose quaternions (x, y, z, w) have other places."""
    quaternion = Rotation.from_rotvec(six[:, 3:]).as_quat()[:, list(order)]
    return np.hstack([six[:, :3], Rotation.from_quat(quaternion).as_rotvec()])


def _angles() -> Iterator[tuple[str, Callable[[Array], Array]]]:
    """Euler's angles in all orders, in words and as what turns them into rotation vectors."""
    orders = [*("".join(order) for order in permutations("xyz")), *_PROPER]
    for fixed in (False, True):
        for order in orders:
            about = "fixed" if fixed else "moving"
            says = f"rx, ry, rz as angles about {', '.join(order)}, {about} axes"
            yield says, partial(_euler, order if fixed else order.upper(), (0, 1, 2))
    # roll, pitch and yaw stand in the columns of their axes, but are applied in another order
    for axes in permutations("xyz"):
        places = tuple("xyz".index(axis) for axis in axes)
        if places != (0, 1, 2):
            product = " ".join(f"R{axis}(r{axis})" for axis in axes)
            yield (
                f"rx, ry, rz as angles of their axes: {product}",
                partial(_euler, "".join(axes).upper(), places),
            )


def _slip(rig: Rig, kind: str, says: str, fix: str, change: Callable[[Array], Array]) -> Slip:
    where = _SIX if change is _inverse else _SIX[3:]
    return Slip(kind, where, says, fix, partial(_changed, change), partial(_mend, rig, change))


def _changed(change: Callable[[Array], Array], scene: Scene) -> Scene:
    six = np.column_stack([scene.rows.observations[n] for n in _SIX])
    return scene.with_columns(dict(zip(_SIX, _whole(change, six).T, strict=True)))


def _whole(change: Callable[[Array], Array], six: Array) -> Array:
    """Rows that were read changed; what was lost stays lost."""
    out, read = six.copy(), np.isfinite(six).all(axis=1)
    out[read] = change(six[read])
    return out


def _mend(rig: Rig, change: Callable[[Array], Array], pair: Pair) -> Pair:
    def mended(sheet: Sheet) -> Sheet:
        written, inside = rig.machine.units, dict(zip(_SIX, 3 * ("mm",) + 3 * ("rad",), strict=True))
        unit = {n: sheet.units.get(n) or written.written(inside[n]) for n in _SIX}
        six = np.column_stack([convert(sheet.numbers(n), unit[n], inside[n]) for n in _SIX])
        new = _whole(change, six)
        return sheet.with_numbers({n: convert(new[:, k], inside[n], unit[n]) for k, n in enumerate(_SIX)})

    return pair.each(mended)


def _inverse(six: Array) -> Array:
    back = Rotation.from_rotvec(six[:, 3:]).inv()
    return np.hstack([-back.apply(six[:, :3]), back.as_rotvec()])


def _turned_back(six: Array) -> Array:
    return np.hstack([six[:, :3], -six[:, 3:]])


def _euler(sequence: str, places: tuple[int, ...], six: Array) -> Array:
    """Rotation vectors of angles that stand, in the order of ``sequence``, in the columns ``places`` of rx, ry, rz."""
    angles = six[:, 3:][:, list(places)]
    return np.hstack([six[:, :3], Rotation.from_euler(sequence, angles).as_rotvec()])
