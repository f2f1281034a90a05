"""Poses given the other way round, or with angles of another convention in the columns of the rotation vector."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose.identification.leaves.check.pair import Pair, Sheet
from truepose.identification.leaves.check.rig import Rig, Scene
from truepose.identification.leaves.check.slip import Slip
from truepose.models.sensors.pose import Pose
from truepose.models.units import convert

Array = NDArray[np.float64]
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


__all__ = ["poses"]
