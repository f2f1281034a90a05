"""A ROS 2 bag of a simulated arm: it stands for a while at every pose, and joints and a tracker are logged all along."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import truepose
from truepose.arrays import Array
from truepose.cli import app

POSES, SAMPLES, RATE, START = 40, 20, 20.0, 1_700_000_000.0
"""How many poses, messages at each, messages a second, and the time of the first one (s)."""
SCATTER = 2e-5
"""1-sigma of one reading of the tracker, m."""


def write_bag(folder: Path, poses: int = POSES, samples: int = SAMPLES, storage: str = "MCAP") -> Path:
    """``session.mcap`` (or ``.db3`` of the storage ``SQLITE3``): joints and the tool's pose of a bundled arm that stands
    0.5 mm beside its drawing."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(folder / "session", version=9, storage_plugin=StoragePlugin[storage]) as writer:
        topics = {}
        for topic, t, message in _messages(*_seen(folder, poses), samples, store.types):
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, message.__msgtype__, typestore=store)
            writer.write(topics[topic], int(1e9 * t), store.serialize_cdr(message, message.__msgtype__))
    (path,) = (one for one in (folder / "session").iterdir() if one.suffix in (".mcap", ".db3"))
    return path.rename(folder / f"session{path.suffix}")


def _seen(folder: Path, count: int) -> tuple[Array, Array]:
    """(n, 6) joints in rad, and (n, 6) position (m) and rotation vector (rad) of the tool."""
    made = folder / "as_built.yaml"
    result = CliRunner().invoke(app, ["init", "--arm", "ur5e", "--sensor", "pose", "-o", str(made)])
    assert result.exit_code == 0, result.output
    machine = truepose.load_machine(made)
    q = np.random.default_rng(5).uniform(-120.0, 120.0, (count, 6))
    poses = {f"q{k + 1}": q[:, k] for k in range(6)}
    built = [truepose.parse_effect("wrong-constant@q3.d:value=0.5[mm]", machine)]
    seen = truepose.simulate(machine, poses, built, seed=None)
    xyz, turn = seen[["x", "y", "z"]].to_numpy(), seen[["rx", "ry", "rz"]].to_numpy()
    return np.radians(q), np.hstack([xyz / 1e3, np.radians(turn)])


def _messages(q: Array, poses: Array, samples: int, types: Any) -> Iterator[tuple[str, float, Any]]:
    rng = np.random.default_rng(6)
    for k in range(len(q)):
        for sample in range(samples):
            t = START + (2 * samples * k + sample) / RATE  # between poses nothing is logged
            yield "/joint_states", t, _joint_state(types, t, q[k])
            yield "/tracker/pose", t, _pose(types, t, poses[k] + SCATTER * rng.standard_normal(6))


def _header(types: Any, t: float) -> Any:
    stamp = types["builtin_interfaces/msg/Time"](sec=int(t), nanosec=int(1e9 * (t % 1)))
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id="tracker")


def _joint_state(types: Any, t: float, q: Array) -> Any:
    names, empty = [f"joint_{k + 1}" for k in range(6)], np.array([])
    return types["sensor_msgs/msg/JointState"](_header(types, t), names, q, empty, empty)


def _pose(types: Any, t: float, pose: Array) -> Any:
    quaternion = Rotation.from_rotvec(pose[3:]).as_quat()
    point = types["geometry_msgs/msg/Point"](*map(float, pose[:3]))
    turn = types["geometry_msgs/msg/Quaternion"](*map(float, quaternion))
    return types["geometry_msgs/msg/PoseStamped"](
        _header(types, t), types["geometry_msgs/msg/Pose"](point, turn)
    )
