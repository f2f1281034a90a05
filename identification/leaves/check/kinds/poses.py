"""Poses given the other way round, or with angles of another convention in the columns of the rotation vector."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import combinations, permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.identification.leaves.check.pair import SELDOM, USUAL, Scene, Sheet, Slip
from truepose.identification.leaves.check.rig import Rig
from truepose.models.sensors.pose import Pose, Position
from truepose.models.sensors.targets import Targets
from truepose.models.units import convert
from truepose.wording import joined

_XYZ, _TURN = ("x", "y", "z"), ("rx", "ry", "rz")
# -- Measured axes with another sign or in another order, and targets that were exchanged

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
    triples = [*points, _TURN] if whole and _turns(rig) else points
    exchanged = [_XYZ[k] for k in range(3) if order[k] != k]
    flipped = [_XYZ[k] for k in range(3) if signs[k] < 0]
    parts = [_exchange(exchanged, order)] if exchanged else []
    parts += [f"{joined(flipped)} with the other sign"] if flipped else []
    told = joined(parts) + (", turns mirrored too" if triples != points else "")
    swap = exchanged and not flipped

    def mapped(seen: Mapping[str, Array]) -> dict[str, Array]:
        """Columns in the mapped axes; of rotation vectors S Exp(w) S' = Exp(det(S) S w)."""
        hands = [_hand(order, signs) if triple is _TURN else 1.0 for triple in triples]
        pairs = [(t, hand, k) for t, hand in zip(triples, hands, strict=True) for k in range(3)]
        return {t[k]: hand * signs[k] * seen[t[order[k]]] for t, hand, k in pairs}

    def mend(sheet: Sheet) -> Sheet:
        here = {n: sheet.numbers(n) for triple in triples for n in triple if n in sheet.units}
        return sheet.with_numbers(mapped(here)) if here else sheet

    yield Slip(
        "permutation" if swap else "handedness",
        tuple(exchanged if swap else dict.fromkeys([*exchanged, *flipped])),
        f"measured {told}",
        f"{'exchange the headers of' if swap else 'change'} the sensor's columns: {told}",
        lambda scene: scene.with_columns(mapped(scene.rows.observations)),
        lambda pair: pair.each(mend),
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


def targets(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Targets exchanged: every order of a few, pairs of many."""
    for sensor in rig.machine.sensors:
        if not isinstance(sensor, Targets):
            continue
        labels = list(dict.fromkeys(n.rpartition(".")[0] for n in sensor.columns))
        yield from (_relabelled(labels, order) for order in _orders(len(labels)))


def _relabelled(labels: Sequence[str], order: Sequence[int]) -> Slip:
    moved = [k for k in range(len(labels)) if order[k] != k]
    called = {f"{labels[order[k]]}.{a}": f"{labels[k]}.{a}" for k in moved for a in _XYZ}
    names = tuple(labels[k] for k in moved)
    return Slip(
        "permutation",
        names,
        f"targets {joined(names)} {'exchanged' if len(names) == 2 else 'in another order'}",
        "rename the columns: " + ", ".join(f"{labels[order[k]]} is {labels[k]}" for k in moved),
        lambda scene: scene.with_columns({b: scene.rows.observations[a] for a, b in called.items()}),
        lambda pair: pair.renamed(called),
        USUAL if len(names) == 2 else SELDOM,
    )


def _orders(n: int) -> list[tuple[int, ...]]:
    still = tuple(range(n))
    if n > _MOST_TARGETS:
        return [tuple({i: j, j: i}.get(k, k) for k in still) for i, j in combinations(still, 2)]
    others = (order for order in permutations(still) if order != still)
    return sorted(others, key=lambda order: sum(a != b for a, b in zip(order, still, strict=True)))


# -- Poses given the other way round, or with angles of another convention in the columns of the rotation vector

_SIX = ("x", "y", "z", "rx", "ry", "rz")
_PROPER = ("xyx", "xzx", "yxy", "yzy", "zxz", "zyz")


def poses(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """The inverse pose, the inverse rotation, and all orders of Euler's angles, about moving or fixed axes."""
    if not any(isinstance(sensor, Pose) for sensor in rig.machine.sensors):
        return
    says = "poses of the measuring frame in the tool (inverse)"
    yield _slip(rig, _inverse, says, "give the pose of the tool in the measuring frame")
    says = "rx, ry, rz of the inverse rotation"
    yield _slip(rig, _turned_back, says, "give the rotation of the tool, not its inverse")
    last, first = "scalar last (x, y, z, w)", "scalar first (w, x, y, z)"
    vectors = "write rotation vectors (axis times angle)"
    for was, read, order in ((first, last, (1, 2, 3, 0)), (last, first, (3, 0, 1, 2))):
        says = f"the quaternion behind rx, ry, rz was {was} and read as {read}"
        yield _slip(rig, partial(_requaternioned, order), says, vectors)
    for says, change in _angles():
        yield _slip(rig, change, says, vectors)


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


def _slip(rig: Rig, change: Callable[[Array], Array], says: str, fix: str) -> Slip:
    whole = change is _inverse
    kind, where = ("inverse-pose", _SIX) if whole else ("rotation-convention", _SIX[3:])

    def changed(scene: Scene) -> Scene:
        six = np.column_stack([scene.rows.observations[n] for n in _SIX])
        return scene.with_columns(dict(zip(_SIX, _whole(change, six).T, strict=True)))

    return Slip(kind, where, says, fix, changed, lambda pair: pair.each(partial(_mend, rig, change)))


def _whole(change: Callable[[Array], Array], six: Array) -> Array:
    """Rows that were read changed; what was lost stays lost."""
    out, read = six.copy(), np.isfinite(six).all(axis=1)
    out[read] = change(six[read])
    return out


def _mend(rig: Rig, change: Callable[[Array], Array], sheet: Sheet) -> Sheet:
    written, inside = rig.machine.units, dict(zip(_SIX, 3 * ("mm",) + 3 * ("rad",), strict=True))
    unit = {n: sheet.units.get(n) or written.written(inside[n]) for n in _SIX}
    new = _whole(change, np.column_stack([convert(sheet.numbers(n), unit[n], inside[n]) for n in _SIX]))
    return sheet.with_numbers({n: convert(new[:, k], inside[n], unit[n]) for k, n in enumerate(_SIX)})


def _inverse(six: Array) -> Array:
    back = Rotation.from_rotvec(six[:, 3:]).inv()
    return np.hstack([-back.apply(six[:, :3]), back.as_rotvec()])


def _turned_back(six: Array) -> Array:
    return np.hstack([six[:, :3], -six[:, 3:]])


def _euler(sequence: str, places: tuple[int, ...], six: Array) -> Array:
    """Rotation vectors of angles that stand, in the order of ``sequence``, in the columns ``places`` of rx, ry, rz."""
    angles = six[:, 3:][:, list(places)]
    return np.hstack([six[:, :3], Rotation.from_euler(sequence, angles).as_rotvec()])
