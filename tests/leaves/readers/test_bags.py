"""ROS bags as recordings: settled stretches are rows, joints and poses joined by time, in either storage."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.command import input_error
from truepose.identification.leaves.readers.bags import BAND, SECONDS, Stream, read_bag, stretches
from truepose.identification.recording.joint_readings import JointColumn
from truepose.identification.recording.load import tables
from truepose.identification.recording.read import read_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import Table, read_table, table_of
from truepose.models.units import UnitSystem

pytest.importorskip("rosbags")
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
T = STORE.types
GOALS = [(0.1, -0.2), (0.7, 0.05), (-0.4, 0.3)]
JOINTS = [JointColumn("a", "rad"), JointColumn("b", "mm")]
POSE = {"x": "mm", "y": "mm", "z": "mm", "rx": "rad", "ry": "rad", "rz": "rad"}
START = 1_700_000_000


def _header(t: float, frame: str = "tracker") -> Any:
    stamp = T["builtin_interfaces/msg/Time"](sec=int(t), nanosec=int(1e9 * (t % 1)))
    return T["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def bag_table(path: Path, topic: str | None = None, joints: Sequence[str] = ()) -> Table:
    return table_of(str(path), read_bag(path, topic, joints))


def joint_state(t: float, names: Sequence[str], q: Sequence[float]) -> Any:
    empty = np.array([])
    return T["sensor_msgs/msg/JointState"](_header(t), list(names), np.array(q, dtype=float), empty, empty)


def pose_stamped(t: float, xyz: Any, turn: Any) -> Any:
    return T["geometry_msgs/msg/PoseStamped"](
        _header(t),
        T["geometry_msgs/msg/Pose"](
            T["geometry_msgs/msg/Point"](*map(float, xyz)),
            T["geometry_msgs/msg/Quaternion"](*map(float, Rotation.from_rotvec(turn).as_quat())),
        ),
    )


def point_stamped(t: float, xyz: Sequence[float]) -> Any:
    return T["geometry_msgs/msg/PointStamped"](_header(t), T["geometry_msgs/msg/Point"](*map(float, xyz)))


def transform(t: float, child: str, xyz: Sequence[float], turn: Sequence[float]) -> Any:
    quaternion = map(float, Rotation.from_rotvec(turn).as_quat())
    return T["geometry_msgs/msg/TransformStamped"](
        _header(t),
        child,
        T["geometry_msgs/msg/Transform"](
            T["geometry_msgs/msg/Vector3"](*map(float, xyz)), T["geometry_msgs/msg/Quaternion"](*quaternion)
        ),
    )


def tf(*transforms: Any) -> Any:
    return T["tf2_msgs/msg/TFMessage"](list(transforms))


Said = list[tuple[float, str, Any]]


def write(path: Path, said: Said, storage: StoragePlugin = StoragePlugin.MCAP) -> Path:
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connections: dict[str, Any] = {}
        for t, topic, message in sorted(said, key=lambda item: item[0]):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=STORE)
            data = STORE.serialize_cdr(message, message.__msgtype__)
            writer.write(connections[topic], int(1e9 * t), data)
    return path


def run(
    see: Callable[[float, int, np.random.Generator], list[tuple[str, Any]]],
    gripper: Callable[[float], float] = lambda t: 0.0,
) -> Said:
    """Two joints that go to every goal in a second and rest for two, logged at 50 Hz; poses at 20 Hz all along."""
    rng = np.random.default_rng(3)
    said: Said = []
    for k in range(3 * 150):
        t = START + k / 50
        goal, phase = divmod(k, 150)
        last = GOALS[goal - 1] if goal else (0.0, 0.0)
        share = min(phase / 50, 1.0)
        q = [
            a + share * (b - a) + 1e-6 * rng.standard_normal() for a, b in zip(last, GOALS[goal], strict=True)
        ]
        said.append((t, "/joint_states", joint_state(t, ["b", "a", "gripper"], [q[1], q[0], gripper(t)])))
        if k % 2 == 0:
            said += [(t + 0.004, topic, message) for topic, message in see(t + 0.004, goal, rng)]
    return said


def tracker(t: float, goal: int, rng: np.random.Generator) -> list[tuple[str, Any]]:
    turn = Rotation.from_rotvec([np.pi - 1e-4, 0.1 * goal, 0]) * Rotation.from_rotvec(
        1e-5 * rng.standard_normal(3)
    )
    xyz = np.array([1.0 + goal, 2.0, -0.5]) + 2e-5 * rng.standard_normal(3)
    return [("/tracker/pose", pose_stamped(t, xyz, turn.as_rotvec()))]


def loaded(path: Path, columns: dict[str, str] = POSE) -> Recording:
    return read_recording(tables([path]), JOINTS, columns, UnitSystem())


@pytest.mark.parametrize("storage", list(StoragePlugin))
@pytest.mark.parametrize("as_file", [False, True])
def test_a_row_a_settled_stretch(tmp_path: Path, storage: StoragePlugin, as_file: bool) -> None:
    path = write(tmp_path / "bag", run(tracker), storage)
    if as_file:
        path = next(p for p in path.iterdir() if p.suffix in (".mcap", ".db3"))
    found = loaded(path)
    assert len(found) == 3
    np.testing.assert_allclose(found.q / [1.0, 1e3], GOALS, atol=1e-5)  # mm of a prismatic joint
    # about 45 samples of 20 um: 3 um, and no row beyond five of them
    np.testing.assert_allclose(found.observations["x"], [1000.0, 2000.0, 3000.0], atol=0.015)
    turns = Rotation.from_rotvec(np.column_stack([found.observations[name] for name in ("rx", "ry", "rz")]))
    wanted = Rotation.from_rotvec([[np.pi - 1e-4, 0.1 * goal, 0] for goal in range(3)])
    assert (turns * wanted.inv()).magnitude().max() < 1e-5
    assert found.time is not None
    np.testing.assert_allclose(found.time - START, [2.0, 5.0, 8.0], atol=0.3)
    assert "3 settled stretches; an average's 1-sigma by its scatter: xyz 0.00" in found.notes[0]
    assert found.notes[1:] == (f"{path}: ignored columns that mean nothing here: 'gripper'",)


def test_a_gripper_on_the_topic_takes_no_rows_from_a_machine_without_it(tmp_path: Path) -> None:
    """It opens and closes all along; averages are as sure as their samples scatter."""
    path = write(tmp_path / "bag", run(tracker, lambda t: 0.02 * np.sin(9.0 * (t - START))))
    still = bag_table(write(tmp_path / "still", run(tracker)), joints=["b", "a"])
    found = read_table(path, ["A", "b"])
    assert found.names == still.names and found.n_rows == 3
    for name in found.names:
        np.testing.assert_array_equal(found.numbers(name), still.numbers(name))
    with input_error(r"\(joints: b, a, gripper; --joint of"):
        bag_table(path)
    samples = found.numbers("samples")
    assert samples.min() > 30 and {c.name: c.unit for c in found.columns}["x.sigma"] == "m"
    for axis in "xyz":  # 30 samples tell a sigma to 13 %
        np.testing.assert_allclose(found.numbers(f"{axis}.sigma"), 2e-5 / np.sqrt(samples), rtol=0.5)


def test_points_are_named_by_their_topics_and_may_be_lost(tmp_path: Path) -> None:
    def see(t: float, goal: int, rng: np.random.Generator) -> list[tuple[str, Any]]:
        seen = [("/leica/P1", point_stamped(t, [goal, 0, 0]))]
        return seen if goal == 1 else [*seen, ("/leica/P2", point_stamped(t, [0, goal, 1]))]

    columns = {f"P{k}.{axis}": "mm" for k in (1, 2) for axis in "xyz"}
    found = loaded(write(tmp_path / "bag", run(see)), columns)
    np.testing.assert_allclose(found.observations["P1.x"], [0, 1000, 2000], atol=1e-9)
    np.testing.assert_allclose(found.observations["P2.y"], [0, np.nan, 2000], atol=1e-9)
    assert any("3 readings are missing (row 2 P2.x, row 2 P2.y, row 2 P2.z)" in note for note in found.notes)


def test_one_frame_among_several_is_chosen(tmp_path: Path) -> None:
    def see(t: float, goal: int, rng: np.random.Generator) -> list[tuple[str, Any]]:
        both = [transform(t, name, [goal + k, 0, 0], [0, 0, 0.1]) for k, name in enumerate(("probe", "link"))]
        return [("/tf", tf(*both))]

    path = write(tmp_path / "bag", run(see))
    with input_error(r"bag: found poses in 'tracker->probe', 'tracker->link', expected one.*--topic"):
        bag_table(path)
    np.testing.assert_allclose(bag_table(path, "tracker->link").numbers("x"), [1, 2, 3], atol=1e-12)
    with input_error("--topic: found 'probe', expected 'tracker->probe' or 'tracker->link'"):
        bag_table(path, "probe")


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    said = run(tracker)
    joints = [item for item in said if item[1] == "/joint_states"]
    with input_error("found no pose"):
        bag_table(write(tmp_path / "a", joints))
    with input_error("no message of type JointState"):
        bag_table(write(tmp_path / "b", [item for item in said if item[1] != "/joint_states"]))
    brief = [item for item in said if item[1] != "/joint_states" or item[0] < said[0][0] + 0.3]
    with input_error(r"found 0 stretches in which all joints stand still for 0\.5 s"):
        bag_table(write(tmp_path / "c", brief))
    broken = shutil.copy(next((tmp_path / "c").glob("*.mcap")), tmp_path / "broken.mcap")
    Path(broken).write_bytes(Path(broken).read_bytes()[:300])
    with input_error(r"broken\.mcap: cannot read the bag"):
        bag_table(Path(broken))


def test_stretches_of_many_samples_at_once_are_those_of_their_spread() -> None:
    rng = np.random.default_rng(1)
    time, values = np.sort(rng.uniform(0.0, 30.0, 3000)), np.cumsum(rng.normal(0.0, 0.05 * BAND, 3000))
    found = stretches({"a": Stream(time, values[:, None])})
    assert found
    still = [np.ptp(values[np.abs(time - t) <= 0.5 * SECONDS]) <= BAND for t in time]
    inside = np.array([any(a <= t <= b for a, b in found) for t in time])
    assert not (inside & ~np.array(still)).any()
