"""ROS bags (MCAP, sqlite3, ROS 1) as tables: joints by name and poses joined by time, one row a settled stretch.

Read by rosbags (extra ``ros``). Joints come from ``JointState``; poses from ``PoseStamped``, ``TransformStamped`` or
``TFMessage``, points from ``PointStamped``: one of them, or several points, whose topics end in their names.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.bounded import check_input
from truepose.errors import InputError
from truepose.identification.leaves.readers.settled import BAND, SECONDS, Average, Stream, average, stretches
from truepose.identification.recording.text import SI, ArrowCells, TextTable
from truepose.wording import cut, joined, shortened

_AXES: Final = (("x", "m"), ("y", "m"), ("z", "m"), ("rx", "rad"), ("ry", "rad"), ("rz", "rad"))
_POINT, _FRAME = "PointStamped", "TFMessage"
_TYPES: Final = {
    "sensor_msgs/msg/JointState": "JointState",
    "geometry_msgs/msg/PoseStamped": "PoseStamped",
    "geometry_msgs/msg/TransformStamped": "TransformStamped",
    "tf2_msgs/msg/TFMessage": _FRAME,
    "geometry_msgs/msg/PointStamped": _POINT,
}
FARTHEST: Final = 1e9
"""m or rad: a joint or a place beyond is none."""
_BAG_MAGIC: Final = (b"\x89MCAP0\r\n", b"SQLite format 3\0", b"#ROSBAG V")
_GIVEN: Final = 'choose one with --topic of "truepose import"'


@dataclass
class _Samples:
    """Times (k,), s, and values (k, width), one behind the other; as plain numbers, of which a bag may hold millions."""

    width: int
    time: array[float] = field(default_factory=lambda: array("d"))
    values: array[float] = field(default_factory=lambda: array("d"))

    def add(self, time: float, values: Sequence[float]) -> None:
        """One sample. Raises ValueError for values that are none, and where there were more or fewer before."""
        if len(values) != self.width or any(abs(v) > FARTHEST for v in values):
            told = ", ".join(f"{v:g}" for v in values)
            raise ValueError(
                f"found the values {told}, expected {self.width} of at most {FARTHEST:g} m or rad"
            )
        self.time.append(time)
        self.values.extend(values)

    @property
    def stream(self) -> Stream:
        return Stream.in_order(np.array(self.time), np.array(self.values).reshape(-1, self.width))


@dataclass
class _Log:
    """What a bag holds of joints, by name, and of poses, by topic (of frames by ``parent->child``), with their kind."""

    joints: dict[str, _Samples] = field(default_factory=dict)
    poses: dict[str, _Samples] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)

    def add(self, kind: str, topic: str, message: Any, logged: float) -> None:
        """One message, by its own stamp where it has one, else by when it was logged (s)."""
        if kind == _FRAME:
            for transform in message.transforms:
                name = f"{transform.header.frame_id}->{transform.child_frame_id}"
                self._pose(kind, name, transform.header, _of_transform(transform), logged)
        elif kind == "TransformStamped":
            self._pose(kind, topic, message.header, _of_transform(message), logged)
        elif kind == _POINT:
            self._pose(kind, topic, message.header, _xyz(message.point), logged)
        elif kind == "PoseStamped":
            pose = message.pose
            self._pose(kind, topic, message.header, [*_xyz(pose.position), *_turn(pose.orientation)], logged)
        else:
            for name, position in zip(message.name, message.position, strict=False):
                own = self.joints.setdefault(str(name), _Samples(1))
                own.add(_stamp(message.header, logged), [float(position)])

    def _pose(self, kind: str, name: str, header: Any, values: list[float], logged: float) -> None:
        self.kinds[name] = kind
        self.poses.setdefault(name, _Samples(len(values))).add(_stamp(header, logged), values)


def read_bag(
    path: Path, topic: str | None = None, joints: Sequence[str] = (), readings: Sequence[str] = ()
) -> TextTable:
    """A row for each stretch in which all joints stand still for ``SECONDS`` within ``BAND`` (rad, m), with its time.

    ``topic``: the topic of poses or points, or the frame ``parent->child``, where there are several; ``joints``: those
    that matter, by default the ``readings`` of a machine if all are there, else all. Beside the pose's columns stand
    ``<column>.sigma``, the 1-sigma of the average by its scatter, and ``samples``. Raises InputError without rosbags, for what
    is no bag, for one without joints or poses, and where several could be meant.
    """
    log = _read(path)
    if not log.joints:
        raise InputError(f"{path}: found no message of type JointState, expected the joints by name")
    unknown = [name for name in joints if name not in log.joints]
    if unknown:
        raise InputError(
            f"{path}: found no joint {unknown[0]!r}, expected {joined(map(repr, log.joints), 'or')}"
        )
    wanted = joints or _of_machine(log, readings)
    streams = {name: log.joints[name].stream for name in wanted or log.joints}
    seen = {prefix: log.poses[name].stream for prefix, name in _chosen(log, topic, path).items()}
    found = stretches(streams)
    rows = [(start, end) for start, end in found if any(len(s.between(start, end)) for s in seen.values())]
    hint = "" if wanted else _restless(streams, len(found))
    if not rows:
        raise InputError(
            f"{path}: found {len(found)} stretches in which all joints stand still for {SECONDS:g} s within {BAND:g} "
            f"rad (m), none with a pose in it; expected at least one (joints: {', '.join(streams)}){hint and '; ' + hint}"
        )
    table = _table(path, rows, streams, seen, len(found) - len(rows))
    return replace(table, notes=(*table.notes, f"{path}: {hint}")) if hint else table


def _of_machine(log: _Log, readings: Sequence[str]) -> list[str]:
    """Return the joints of a log that a machine has, whatever their case; none unless it has all of them."""
    known = {name.casefold() for name in readings}
    found = [name for name in log.joints if name.casefold() in known]
    return found if {name.casefold() for name in found} == known else []


def _restless(streams: Mapping[str, Stream], count: int) -> str:
    """Return a hint at joints that hardly ever stand still, where the others do in far more than ``count`` stretches."""
    still = {name: sum(b - a for a, b in stretches({name: stream})) for name, stream in streams.items()}
    usual = [name for name in streams if still[name] >= 0.5 * float(np.median(list(still.values())))]
    more = len(stretches({name: streams[name] for name in usual})) if len(usual) < len(streams) else 0
    if more < 2 * max(count, 1):
        return ""
    restless = [name for name in streams if name not in usual]
    named = " ".join(f"--joint {name}" for name in usual)
    return f"without {joined(map(repr, restless))} {more} stretches stand still, with it {count}: import with {named}"


def _read(path: Path) -> _Log:
    """What a bag says, of messages of known types: these are read as ROS defines them, whatever the bag says they are."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InputError(f"{path}: a ROS bag needs rosbags: pip install 'truepose[ros]'") from None
    for part in path.iterdir() if path.is_dir() else [path]:
        check_input(part)
    log = _Log()
    store = get_typestore(Stores.ROS1_NOETIC if path.suffix == ".bag" else Stores.ROS2_HUMBLE)
    read = store.deserialize_ros1 if path.suffix == ".bag" else store.deserialize_cdr
    with _told(path):
        reader = AnyReader(
            [path], default_typestore=store
        )  # bags of sqlite3 hold no definitions of their messages
        reader.open()
    try:
        for connection, time, data in _messages(reader, path):
            with _told(path):
                message = read(data, connection.msgtype)
            try:
                log.add(_TYPES[connection.msgtype], connection.topic, message, time * 1e-9)
            except ValueError as exc:
                raise InputError(f"{path}: topic {cut(connection.topic)}: {exc}") from None
    finally:
        reader.close()
    return log


def _messages(reader: Any, path: Path) -> Iterator[tuple[Any, int, bytes]]:
    """Connection, time (ns) and data of each message of a known type."""
    wanted = [c for c in reader.connections if c.msgtype in _TYPES and not c.topic.endswith("tf_static")]
    if not wanted:
        return
    with _told(path):
        messages = iter(reader.messages(connections=wanted))
    while True:
        with _told(path):
            found = next(messages, None)
        if found is None:
            return
        yield found


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """What rosbags raises as an InputError: a broken bag makes it raise nearly anything, assertions included."""
    try:
        yield
    except Exception as exc:
        raise InputError(f"{path}: cannot read the bag: {cut(str(exc) or repr(exc))}") from None


def _chosen(log: _Log, topic: str | None, path: Path) -> Mapping[str, str]:
    """The stream of each point or pose by what its columns begin with."""
    if topic is not None:
        if topic not in log.poses:
            raise InputError(
                f"{path}: --topic: found {topic!r}, expected {joined(map(repr, log.poses), 'or')}"
            )
        return {"": topic}
    topics = [name for name, kind in log.kinds.items() if kind != _FRAME] or list(log.kinds)
    if not topics:
        raise InputError(
            f"{path}: found no pose, expected PoseStamped, TransformStamped, TFMessage or PointStamped"
        )
    if len(topics) == 1:
        return {"": topics[0]}
    points = {f"{name.rstrip('/').rpartition('/')[2]}.": name for name in topics}
    if all(log.kinds[name] == _POINT for name in topics) and len(points) == len(topics):
        return points
    raise InputError(
        f"{path}: found poses in {shortened([repr(t) for t in topics], 8)}, expected one; {_GIVEN}"
    )


def _table(
    path: Path,
    rows: list[tuple[float, float]],
    joints: Mapping[str, Stream],
    seen: Mapping[str, Stream],
    without: int,
) -> TextTable:
    cells = {"time [s]": np.array([0.5 * (a + b) for a, b in rows])}
    cells |= {
        f"{name} [{SI}]": np.array([stream.between(a, b).mean() for a, b in rows])
        for name, stream in joints.items()
    }
    told = []
    for prefix, stream in seen.items():
        width = stream.values.shape[1]
        averages = [_average(stream.between(a, b), width) for a, b in rows]
        for k, (axis, unit) in enumerate(_AXES[:width]):
            cells[f"{prefix}{axis} [{unit}]"] = np.array([found.mean[k] for found in averages])
            cells[f"{prefix}{axis}.sigma [{unit}]"] = np.array([found.sigma[k] for found in averages])
        cells[f"{prefix}samples"] = np.array([float(found.count) for found in averages])
        told.append(_words(prefix, averages))
    notes = [f"{path}: {len(rows)} settled stretches; an average's 1-sigma by its scatter: {'; '.join(told)}"]
    if without:
        notes.append(f"{path}: {without} settled stretches have no pose and make no row")
    return TextTable(list(cells), [ArrowCells(values) for values in cells.values()], notes=tuple(notes))


def _average(values: Array, width: int) -> Average:
    nothing = np.full(width, np.nan)
    return average(values) if len(values) else Average(nothing, nothing, 0)


def _words(prefix: str, averages: list[Average]) -> str:
    """``x 0.0021 mm, ...``: the median over rows of what the averages are worth."""
    sigma = np.array([found.sigma for found in averages if found.count > 1])
    if not len(sigma):
        return f"{prefix or 'pose'} unknown, one sample a row"
    length = float(np.sqrt(np.mean(np.median(sigma[:, :3], axis=0) ** 2)))
    words = f"{prefix}xyz {1e3 * length:.2g} mm"
    if sigma.shape[1] == 6:
        turn = float(np.sqrt(np.mean(np.median(sigma[:, 3:], axis=0) ** 2)))
        words += f", rot {np.degrees(turn):.2g} deg"
    return words


def _stamp(header: Any, logged: float) -> float:
    stamp = float(header.stamp.sec) + 1e-9 * float(header.stamp.nanosec)
    return stamp or logged


def _xyz(point: Any) -> list[float]:
    return [float(point.x), float(point.y), float(point.z)]


def _turn(quaternion: Any) -> list[float]:
    """The rotation vector, rad."""
    q = [float(quaternion.x), float(quaternion.y), float(quaternion.z), float(quaternion.w)]
    if not np.isfinite(q).all() or not any(q):
        raise ValueError(f"found the quaternion {q}, expected a rotation")
    return [float(v) for v in Rotation.from_quat(q).as_rotvec()]


def _of_transform(stamped: Any) -> list[float]:
    moved = stamped.transform
    return [*_xyz(moved.translation), *_turn(moved.rotation)]


__all__ = ["read_bag"]


def is_bag(path: Path) -> bool:
    """Whether a path is a ROS bag: its folder, or a file of one."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    with path.open("rb") as stream:
        return stream.read(16).startswith(_BAG_MAGIC)
