"""ROS bags (MCAP, sqlite3, ROS 1) as tables: joints by name and poses joined by time, one row a settled stretch.

Read by rosbags (extra ``ros``). Joints come from ``JointState``; poses from ``PoseStamped``, ``TransformStamped`` or
``TFMessage``, points from ``PointStamped``: one of them, or several points, whose topics end in their names.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.files import check_input
from truepose.identification.leaves.readers.settled import BAND, SECONDS, Stream, average, stretches
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
class _Log:
    """Samples of joints by name, and of poses by topic (of frames by ``parent->child``), whose ``kinds`` are message types.

    Each sample is its time, s, then its values, m and rad; plain numbers, of which a bag may hold millions.
    """

    joints: dict[str, array[float]] = field(default_factory=dict)
    poses: dict[str, array[float]] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)

    def add(self, kind: str, topic: str, message: Any, logged: float) -> None:
        """Add a message, by its stamp if it has one, else by when it was logged (s). Raises ValueError for odd values."""
        if kind == "JointState":
            for name, position in zip(message.name, message.position, strict=False):
                self._append(self.joints, str(name), message.header, logged, [float(position)])
            return
        named = {topic: message}
        if kind == _FRAME:
            named = {f"{part.header.frame_id}->{part.child_frame_id}": part for part in message.transforms}
        for name, part in named.items():
            if self.kinds.setdefault(name, kind) != kind:
                raise ValueError(f"found messages of types {self.kinds[name]} and {kind}, expected one")
            self._append(self.poses, name, part.header, logged, _values(part))

    def _append(
        self, samples: dict[str, array[float]], name: str, header: Any, logged: float, values: list[float]
    ) -> None:
        if any(abs(v) > FARTHEST for v in values):
            told = ", ".join(f"{v:g}" for v in values)
            raise ValueError(f"found the values {told}, expected at most {FARTHEST:g} m or rad")
        stamp = float(header.stamp.sec) + 1e-9 * float(header.stamp.nanosec)
        samples.setdefault(name, array("d")).extend([stamp or logged, *values])


def _values(part: Any) -> list[float]:
    """Return the position of a message, m, and its rotation vector, rad, unless it is a point."""
    if hasattr(part, "point"):
        return [float(part.point.x), float(part.point.y), float(part.point.z)]
    pose = getattr(part, "transform", None) or part.pose
    at = pose.translation if hasattr(pose, "translation") else pose.position
    turn = pose.rotation if hasattr(pose, "rotation") else pose.orientation
    q = [float(turn.x), float(turn.y), float(turn.z), float(turn.w)]
    if not np.isfinite(q).all() or not any(q):
        raise ValueError(f"found the quaternion {q}, expected a rotation")
    return [float(at.x), float(at.y), float(at.z), *(float(v) for v in Rotation.from_quat(q).as_rotvec())]


def _stream(samples: array[float], width: int) -> Stream:
    table = np.array(samples).reshape(-1, 1 + width)
    return Stream.in_order(table[:, 0], table[:, 1:])


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
    streams = {name: _stream(log.joints[name], 1) for name in wanted or log.joints}
    seen = {
        prefix: _stream(log.poses[name], 3 if log.kinds[name] == _POINT else 6)
        for prefix, name in _chosen(log, topic, path).items()
    }
    found = stretches(streams)
    rows = [(start, end) for start, end in found if any(len(s.between(start, end)) for s in seen.values())]
    if not rows:
        raise InputError(
            f"{path}: found {len(found)} stretches in which all joints stand still for {SECONDS:g} s within {BAND:g} "
            f"rad (m), none with a pose in it; expected at least one (joints: {', '.join(streams)}; --joint of "
            '"truepose import" names those that matter)'
        )
    return _table(path, rows, streams, seen, len(found) - len(rows))


def _of_machine(log: _Log, readings: Sequence[str]) -> list[str]:
    """Return the joints of a log that a machine has, whatever their case; none unless it has all of them."""
    known = {name.casefold() for name in readings}
    found = [name for name in log.joints if name.casefold() in known]
    return found if {name.casefold() for name in found} == known else []


def _read(path: Path) -> _Log:
    """Return what a bag says, of messages of known types, which are read as ROS defines them, not as the bag does."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InputError(f"{path}: a ROS bag needs rosbags: pip install 'truepose[ros]'") from None
    for part in path.iterdir() if path.is_dir() else [path]:
        check_input(part)
    older = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if older else Stores.ROS2_HUMBLE)
    read, log = store.deserialize_ros1 if older else store.deserialize_cdr, _Log()
    try:
        with AnyReader([path], default_typestore=store) as reader:  # sqlite3 holds no definitions of messages
            known = [
                c for c in reader.connections if c.msgtype in _TYPES and not c.topic.endswith("tf_static")
            ]
            for connection, time, data in reader.messages(connections=known) if known else ():
                message = read(data, connection.msgtype)
                try:
                    log.add(_TYPES[connection.msgtype], connection.topic, message, time * 1e-9)
                except ValueError as exc:
                    raise InputError(f"{path}: topic {cut(connection.topic)}: {exc}") from None
    except InputError:
        raise
    except Exception as exc:  # a broken bag makes rosbags raise nearly anything, assertions included
        raise InputError(f"{path}: cannot read the bag: {cut(str(exc) or repr(exc))}") from None
    return log


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
        inside = [stream.between(a, b) for a, b in rows]
        mean, sigma = (np.array(values) for values in zip(*map(average, inside), strict=True))
        for k, (axis, unit) in enumerate(_AXES[: mean.shape[1]]):
            cells[f"{prefix}{axis} [{unit}]"] = mean[:, k].copy()
            cells[f"{prefix}{axis}.sigma [{unit}]"] = sigma[:, k].copy()
        cells[f"{prefix}samples"] = np.array([float(len(values)) for values in inside])
        told.append(_scatter(prefix, sigma[np.isfinite(sigma).all(axis=1)]))
    notes = [f"{path}: {len(rows)} settled stretches; an average's 1-sigma by its scatter: {'; '.join(told)}"]
    if without:
        notes.append(f"{path}: {without} settled stretches have no pose and make no row")
    return TextTable(list(cells), [ArrowCells(values) for values in cells.values()], notes=tuple(notes))


def _scatter(prefix: str, sigma: Array) -> str:
    """Return ``x 0.0021 mm, ...``: the median over rows of what the averages are worth."""
    if not len(sigma):
        return f"{prefix or 'pose'} unknown, one sample a row"
    middle = np.median(sigma, axis=0)
    words = f"{prefix}xyz {1e3 * np.sqrt(np.mean(middle[:3] ** 2)):.2g} mm"
    if len(middle) == len(_AXES):
        words += f", rot {np.degrees(np.sqrt(np.mean(middle[3:] ** 2))):.2g} deg"
    return words


def is_bag(path: Path) -> bool:
    """Whether a path is a ROS bag: its folder, or a file of one."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    with path.open("rb") as stream:
        return stream.read(16).startswith(_BAG_MAGIC)
