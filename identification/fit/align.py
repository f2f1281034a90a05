"""Starting values of frames nobody measured: where the base stands and how the tool is turned.

A frame of infinite or wide tolerance may be anywhere, and Gauss-Newton needs to start within about a
radian of it. Points of the sensor (position channels, three a point) give the base by a rigid fit
(Kabsch), directions alone as ``truepose.identification.fit.align`` has it; rotation channels give the tool's
turn as the mean rotation left over. Further frames of the machine file follow in the same ways: one that a
sensor rides on as the base, a tip as the tool.

Where a base stands by directions alone: axes of the tool that point at stars, or bearings to the tool's origin.

Axes tell how the base is turned, by a nearest rotation. Bearings to known points of the machine tell where it stands as well,
by orthogonal iteration (Lu, Hager and Mjolsness, IEEE TPAMI 22, 2000): each point is put onto its line of sight, and the
machine is moved onto the points, in turns. From few starts it ends in a false minimum; it is begun from many.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from truepose.arrays import Array, Mask
from truepose.identification.fit.set_ups import set_up_label
from truepose.identification.prediction.predictor import Predictor
from truepose.models import lie
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES
from truepose.models.machine.sensor import TOOL_IN_WORLD, WORLD
from truepose.models.sensors.direction import ORIGIN, Direction

_FEWEST = {True: 3, False: 2}
"""Fewest directions that tell a base, by whether they are bearings."""
_SWEEPS, _LAST = 15, 300
_STEADY = 1e-12
ZEROS = 2.0 * np.pi * np.arange(1, 24) / 24
"""rad: how far an unknown zero of a joint is tried from where it is stated; a fit finds the rest."""


def sensors_of_directions(machine: Machine) -> list[Direction]:
    """Those that see the tool from the world."""
    return [s for s in machine.sensors if isinstance(s, Direction) and s.view == TOOL_IN_WORLD]


def station_of(values: Iterable[float]) -> tuple[Array, Array]:
    """Rotation (3, 3) and place (3,), mm, of an instrument with ``values`` of its own parameters; the identity without any."""
    at = np.array(list(values), dtype=float)
    return (lie.rpy_matrix(at[3:]), at[:3]) if len(at) else (np.eye(3), np.zeros(3))


def unknown_zeros(machine: Machine) -> tuple[str, ...]:
    """Parameters of joints that turn which say where their reading is 0, and of which nothing is known: any angle may be."""
    turning = [a for a in machine.mechanism.actuators if a.unit == "rad"]
    names = [a.zero for a in turning]
    known = machine.geometry
    return tuple(name for name in names if name in known and np.isinf(known[name].tolerance))


def base_of(
    sensor: Direction, tool: Array, read: Array, station: tuple[Array, Array]
) -> tuple[Array, float] | None:
    """(4, 4) base that turns the poses (n, 4, 4) of the tool in its frame to the directions (n, k) that were read, and the mean
    square of what is left, as between unit vectors.

    None where too few were read. A base that axes turn stays at the origin.
    """
    whole = np.isfinite(read).all(axis=1)
    if whole.sum() < _FEWEST[sensor.of == ORIGIN]:
        return None
    turned, place = station
    seen = sensor.vectors(read[whole]) @ turned.T
    base = np.eye(4)
    if sensor.of == ORIGIN:
        base[:3, :3], base[:3, 3] = base_by_bearings(tool[whole, :3, 3], seen, place)
        there = tool[whole, :3, 3] @ base[:3, :3].T + base[:3, 3] - place
        there /= np.linalg.norm(there, axis=1, keepdims=True)
    else:
        axes = tool[whole, :3, "xyz".index(sensor.of)]
        base[:3, :3] = lie.nearest_rotation(seen.T @ axes)
        there = axes @ base[:3, :3].T
    return base, float(np.mean(np.sum((there - seen) ** 2, axis=1)))


def base_by_bearings(points: Array, seen: Array, station: Array) -> tuple[Array, Array]:
    """Rotation and place of a base whose points (n, 3) are seen along unit vectors (n, 3) from a ``station`` (3,)."""
    across = np.eye(3) - np.einsum("ni,nj->nij", seen, seen)
    cube = np.asarray(Rotation.create_group("O").as_matrix())  # (24, 3, 3) its turns
    best = min((_iterated(points, seen, across, r, _SWEEPS) for r in cube), key=lambda found: found[2])
    rotation, shift, _ = _iterated(points, seen, across, best[0], _LAST)
    return rotation, shift + station


def _iterated(
    points: Array, seen: Array, across: Array, rotation: Array, sweeps: int
) -> tuple[Array, Array, float]:
    """Rotation, shift, and mean square of how far points are beside their line of sight; behind the station counts as far."""
    middle, left = points.mean(axis=0), float("inf")
    whole = across.sum(axis=0)
    for _ in range(sweeps):
        carried = points @ rotation.T
        shift = -np.linalg.lstsq(whole, np.einsum("nij,nj->i", across, carried), rcond=1e-12)[0]
        there = carried + shift
        along = np.maximum(np.sum(there * seen, axis=1), 0.0)
        onto = along[:, None] * seen
        fresh = float(np.mean(np.sum((there - onto) ** 2, axis=1)))
        if left - fresh < _STEADY * fresh:
            break
        left = fresh
        rotation = lie.nearest_rotation((onto - onto.mean(axis=0)).T @ (points - middle))
    return rotation, shift, fresh


WIDE_ANGLE = 0.2
WIDE_LENGTH = 50.0
NEAR = 4e-4
"""Mean square (rad^2) that directions may be off, 0.02 rad, where a joint's zero is near enough to search no farther."""


def aligned_start(predictor: Predictor) -> Array:
    """(np,) parameters with base (and tool rotation) and further frames where readings put them, as far as they may move.

    A base or tool that is set up anew for each session is put there session by session.
    """
    p = predictor.model.p_home.copy()
    if _wide(predictor.machine, "base"):
        _align_ends(predictor, p)
    for mount in predictor.machine.mounts:
        if _wide(predictor.machine, mount.name):
            _align_mount(predictor, p, mount.name)
    known = [k for k, parameter in enumerate(predictor.machine.parameters) if not parameter.free]
    p[known] = predictor.model.p_home[known]  # what is exactly known stays, although its frame moves
    return p


def _align_ends(predictor: Predictor, p: Array) -> None:
    """Base and tool, in place."""
    machine, recording = predictor.machine, predictor.recording
    rank, last = recording.session_rank(), recording.n_sessions - 1
    if not any(name.startswith(f"{set_up_label('base', 1)}:") for name in predictor.model.names):
        rank, last = np.zeros_like(rank), 0
    for k in range(last + 1):
        turning = _wide(machine, "tool") and (k == 0 or "tool" in machine.set_up)
        _align_session(predictor, p, k, ~recording.validation & (rank == k), turning)


def _align_session(predictor: Predictor, p: Array, session: int, wanted: Mask, turning: bool) -> None:
    """Moves base and tool of one session in ``p`` (np,) to where its rows ``wanted`` (n,) put them."""
    base, tool = (_Frame(predictor.model.names, frame, session) for frame in ("base", "tool"))
    for _ in range(3):
        x, good = predictor.assemble(p)
        names, values, poses = predictor.values(p, x)
        rows = good & wanted
        predicted, measured = seen_points(predictor, names, values, rows)
        if len(predicted) < 3:
            _align_by_directions(predictor, p, base, rows)
            return
        rotation, shift = rigid_motion(predicted, measured)
        at = base.value(p)
        base.put(
            p, np.concatenate([rotation @ at[:3] + shift, lie.rpy_of(rotation @ lie.rpy_matrix(at[3:]))])
        )
        turn = _turn(predictor, rows, rotation @ poses[rows, :3, :3]) if turning else None
        if turn is None:
            return
        at = tool.value(p)
        tool.put(p, np.concatenate([at[:3], lie.rpy_of(lie.rpy_matrix(at[3:]) @ turn)]))


def _align_by_directions(predictor: Predictor, p: Array, base: _Frame, rows: Mask) -> None:
    """The base in ``p`` (np,) where directions alone put it, with zeros of joints that nobody knows where those fit best.

    Of the place that axes do not tell, what is there stays.
    """
    seeing = sensors_of_directions(predictor.machine)
    best = _by_directions(predictor, p, base, rows, seeing[0]) if seeing else None
    if best is None:
        return
    for name in unknown_zeros(predictor.machine):
        k, left = predictor.model.names.index(name), best[1]

        def at(zero: float, k: int = k) -> tuple[Array, float]:
            other = p.copy()
            other[k] = zero
            return _by_directions(predictor, other, base, rows, seeing[0]) or (other, np.inf)

        if left >= NEAR:
            best = min(best, *(at(p[k] + away) for away in ZEROS), key=lambda found: found[1])
        here, step = best[0][k], ZEROS[0]
        fine = minimize_scalar(lambda v: at(v)[1], bounds=(here - step, here + step), method="bounded")
        best = min(best, at(float(fine.x)), key=lambda found: found[1])
        p[:] = best[0]
    p[:] = best[0]


def _by_directions(
    predictor: Predictor, p: Array, base: _Frame, rows: Mask, sensor: Direction
) -> tuple[Array, float] | None:
    """Parameters ``p`` (np,) with the base where a sensor's directions put it, and what is left of those."""
    out, at, names = p.copy(), base.value(p), predictor.model.names
    x, good = predictor.assemble(p)
    rows = rows & good
    here = np.linalg.inv(transform(at)) @ predictor.poses(p, x)[0][rows]
    read = np.column_stack([predictor.recording.observations[c][rows] for c in sensor.columns])
    station = station_of(p[names.index(parameter.name)] for parameter in sensor.parameters)
    found = base_of(sensor, here, read, station)
    if found is None:
        return None
    place = found[0][:3, 3] if sensor.of == ORIGIN else at[:3]
    base.put(out, np.concatenate([place, lie.rpy_of(found[0][:3, :3])]))
    return out, found[1]


def _align_mount(predictor: Predictor, p: Array, name: str) -> None:
    """A further frame, in place: where its sensor's points put it, else how its own measured poses have it turned."""
    x, good = predictor.assemble(p)
    names, values, _ = predictor.values(p, x)
    rows = good & ~predictor.recording.validation
    at = [predictor.model.names.index(f"{name}.{a}") for a in AXES]
    turned = lie.rpy_matrix(p[at[3:]])
    predicted, measured = seen_points(predictor, names, values, rows, name)
    if len(predicted) >= 3:
        rotation, shift = rigid_motion(predicted, measured)
        p[at[:3]] -= turned @ rotation.T @ shift
        p[at[3:]] = lie.rpy_of(turned @ rotation.T)
        return
    for sensor in predictor.machine.sensors:
        channels = [c.name for c in sensor.channels if c.kind == "rotation"]
        if sensor.view.tip == name and len(channels) == 3:
            drawn = lie.exp_so3(values[rows][:, [names.index(c) for c in channels]])
            turn = _left_over(predictor, channels, rows, drawn)
            p[at[3:]] = p[at[3:]] if turn is None else lie.rpy_of(turned @ turn)
            return


class _Frame:
    """One frame in one session: its six parameters, and what they have changed by since the first session."""

    def __init__(self, names: Sequence[str], frame: str, session: int) -> None:
        self._own = [names.index(f"{frame}.{axis}") for axis in AXES]
        place = {name: k for k, name in enumerate(names)}
        self._steps = [
            [place.get(f"{set_up_label(frame, k)}:{axis}") for axis in AXES] for k in range(1, session + 1)
        ]

    def value(self, p: Array) -> Array:
        """(6,) x y z (mm) and roll pitch yaw (rad) in this session."""
        added = [[0.0 if k is None else p[k] for k in step] for step in self._steps]
        return np.asarray(p[self._own] + np.sum(added, axis=0)) if added else np.asarray(p[self._own])

    def put(self, p: Array, value: Array) -> None:
        """Changes ``p`` so that the frame stands there; an axis that is exactly known stays."""
        change = value - self.value(p)
        change[3:] = (change[3:] + np.pi) % (2.0 * np.pi) - np.pi
        for k, at in enumerate(self._steps[-1] if self._steps else self._own):
            if at is not None:
                p[at] += change[k]


def _wide(machine: Machine, frame: str) -> bool:
    tolerance = [machine.geometry[f"{frame}.{a}"].tolerance for a in AXES]
    return max(tolerance[:3]) > WIDE_LENGTH or max(tolerance[3:]) > WIDE_ANGLE


def seen_points(
    predictor: Predictor, names: list[str], values: Array, rows: Mask, frame: str = WORLD
) -> tuple[Array, Array]:
    """Predicted and measured points (k, 3) of every point that has three position channels; ``values`` (n, columns).

    ``frame``: what the sensors stand on.
    """
    predicted, measured = [], []
    read = predictor.recording.observations
    standing = [sensor for sensor in predictor.machine.sensors if sensor.view.frame == frame]
    channels = [c.name for s in standing for c in s.channels if c.kind == "position" and c.name in names]
    for k in range(0, len(channels), 3):
        triple = channels[k : k + 3]
        points = np.column_stack([read[c][rows] for c in triple])
        whole = np.isfinite(points).all(axis=1)  # a lost reading loses the point
        predicted.append(values[rows][:, [names.index(c) for c in triple]][whole])
        measured.append(points[whole])
    return (np.vstack(predicted), np.vstack(measured)) if predicted else (np.zeros((0, 3)), np.zeros((0, 3)))


def transform(t: Array) -> Array:
    """(4, 4) transform of x y z and roll pitch yaw (6,)."""
    return lie.pose_of(lie.rpy_matrix(t[3:]), t[:3])


def rigid_motion(source: Array, target: Array) -> tuple[Array, Array]:
    """Rotation and shift that bring ``source`` onto ``target`` in least squares."""
    a, b = source.mean(axis=0), target.mean(axis=0)
    rotation = lie.nearest_rotation((target - b).T @ (source - a))
    return rotation, b - rotation @ a


def _turn(predictor: Predictor, rows: Mask, predicted: Array) -> Array | None:
    """(3, 3) turn of the tool that the rows' rotations show; None where nothing reads any."""
    of_tool = [sensor for sensor in predictor.machine.sensors if sensor.view == TOOL_IN_WORLD]
    channels = [c.name for sensor in of_tool for c in sensor.channels if c.kind == "rotation"]
    return _left_over(predictor, channels, rows, predicted) if len(channels) == 3 else None


def _left_over(predictor: Predictor, channels: list[str], rows: Mask, predicted: Array) -> Array | None:
    """(3, 3) mean rotation from predicted turns (n, 3, 3) to those read; None where none was."""
    turns = np.column_stack([predictor.recording.observations[c][rows] for c in channels])
    whole = np.isfinite(turns).all(axis=1)
    if not whole.any():
        return None
    mean = np.mean(np.swapaxes(predicted[whole], 1, 2) @ lie.exp_so3(turns[whole]), axis=0)
    return lie.nearest_rotation(mean)
