"""An angle means the same whether it is logged from 0 to 360 degrees or from -180 to 180."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.command import input_error
from support.machine_texts import machine_from
from truepose.identification.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

ARM = """
schema: truepose/machine/1
name: arm
mechanism:
  type: serial
  joints: [{name: q1, kind: revolute, d: 100, r: 50%s}, {name: q2, kind: revolute, d: 200, alpha: 90%s}]
sensor: {type: position, sigma: {xyz: 0.1}}
tolerances: {length: 0.1, angle: 0.1}
"""


WRAPPED = {
    "free": "",
    "stated": ", wrap: 360",
    "ranged": ", range: [-180, 180]",
    "wide": ", range: [-350, 350], wrap: 360",
}
"""What the file says of both joints: of their ranges, and that readings come modulo a turn."""
DRIVERS = ["approach.q1", "approach.q2", "step.q1", "step.q2", "stop.q1~0.01", "stop.q2~0.3"]


@pytest.fixture(scope="module")
def arms(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Machine]:
    """Return arms by what their files say of the joints."""
    out = {}
    for name, text in WRAPPED.items():
        out[name] = machine_from(tmp_path_factory.mktemp(name), ARM % (text, text), "arm")
    return out


def readings(machine: Machine, **columns: np.ndarray | list[float]) -> Recording:
    """Return the recording of columns of joints, in the file's units; joints without one rest."""
    count = len(next(iter(columns.values())))
    moving = {name.partition(" ")[0] for name in columns}
    rest = [name for name in machine.mechanism.readings if name not in moving]
    return load_recording(machine, {**columns, **dict.fromkeys([*rest, *"xyz"], [0.0] * count)})


def recorded(machine: Machine, q: np.ndarray) -> Recording:
    """Return the recording of columns q (n, 2), deg."""
    return readings(machine, q1=q[:, 0], q2=q[:, 1])


def logged(q: np.ndarray, lowest: float) -> np.ndarray:
    """Return angles (n, 2), deg, as a controller logs them that shows ``lowest`` to a turn more."""
    return (q - lowest) % 360.0 + lowest


def assert_same(machine: Machine, q: np.ndarray) -> None:
    """Both ways of logging are the same recording, also to all that depends on the way of its joints."""
    one, other = (recorded(machine, logged(q, lowest)) for lowest in (0.0, -180.0))
    np.testing.assert_allclose(one.q, other.q, atol=1e-9)
    np.testing.assert_allclose(np.sin(one.q), np.sin(np.radians(q)), atol=1e-9)
    for name in DRIVERS:
        came, expected = one.driver(name), other.driver(name)
        assert came is not None and expected is not None
        np.testing.assert_allclose(came, expected, atol=1e-9)


angles = st.integers(-17900, 17900).map(lambda whole: whole / 100 + 0.003)
"""Between hundredths of a degree, so that none stands where a turn is cut."""
ways = st.lists(st.tuples(angles, angles), min_size=4, max_size=14)


@given(q=ways, say=st.sampled_from(["stated", "ranged", "wide"]))
def test_what_the_file_says_makes_both_ways_of_logging_one(
    arms: dict[str, Machine], q: list[tuple[float, float]], say: str
) -> None:
    beyond = [(-90.003, -90.003)] if say == "ranged" else []  # a little beyond a range is an overshoot
    assert_same(arms[say], np.array([*beyond, *q]))


@given(q=ways, say=st.sampled_from(["free", "wide"]))
def test_arms_that_use_both_sides_of_home_are_read_the_same(
    arms: dict[str, Machine], q: list[tuple[float, float]], say: str
) -> None:
    """Without a word in the file: 0 to 360 is told from itself where an arc about home would be split."""
    about = [(-5.003, -5.003), (5.003, 5.003), (-175.003, -175.003), (175.003, 175.003)]
    assert_same(arms[say], np.array([*about, *q]))


@given(
    start=st.floats(-170.0, 170.0),
    steps=st.lists(st.floats(-30.0, 80.0), min_size=8, max_size=40),
    say=st.sampled_from(["free", "stated"]),
)
def test_a_joint_that_runs_on_is_read_as_running_on(
    arms: dict[str, Machine], start: float, steps: list[float], say: str
) -> None:
    """Steps below a quarter of a turn: the jump of nearly a turn is none, whatever turns there were, and a note says so."""
    way = start + np.cumsum([0.0, *steps])
    q = np.column_stack([way, np.zeros(len(way))])
    for lowest in (0.0, -180.0):
        rows = logged(q, lowest)
        found = recorded(arms[say], rows)
        np.testing.assert_allclose(np.diff(np.degrees(found.q[:, 0])), steps, atol=1e-6)
        moved = bool(np.any(np.abs(np.degrees(found.q) - rows) > 1.0))
        assert moved == any("unfolded: q1 (" in note for note in found.notes)
    assert_same(arms[say], q)


RAIL = """
schema: truepose/machine/1
name: gantry
mechanism:
  type: serial
  joints: [{name: rail, kind: prismatic%s}, {name: q2, kind: revolute, d: 200, alpha: 90%s}]
sensor: {type: position, sigma: {xyz: 0.1}}
"""


def gantry(folder: Path, rail: str = "", q2: str = "") -> Machine:
    """Return a rail with an arm; what their rows say beside their constants."""
    return machine_from(folder, RAIL % (rail, q2), "gantry")


@pytest.fixture(scope="module")
def rail(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    """Return a rail with an arm."""
    return gantry(tmp_path_factory.mktemp("rail"))


@given(
    joint=st.sampled_from([0, 1]),
    period=st.floats(0.01, 5000.0),
    start=st.floats(-20.0, 20.0),
    steps=st.lists(st.floats(-0.24, 0.24), min_size=1, max_size=60),
    room=st.tuples(st.floats(0.01, 0.48), st.floats(0.01, 0.48)),
    lowest=st.floats(-1.0, 1.0),
)
def test_a_path_comes_back_into_the_range_that_holds_it(
    rail: Machine,
    joint: int,
    period: float,
    start: float,
    steps: list[float],
    room: tuple[float, float],
    lowest: float,
) -> None:
    """Slides and turning joints, whatever they wrap at and wherever that is cut: the range leaves one place."""
    path = period * (start + np.cumsum([0.0, *steps]))
    ends = (float(path.min() - room[0] * period), float(path.max() + room[1] * period))
    actuators = list(rail.mechanism.actuators)
    actuators[joint] = replace(actuators[joint], wrap=period, range=ends)
    machine = replace(rail, mechanism=replace(rail.mechanism, actuators=tuple(actuators)))
    column = (path - lowest * period) % period + lowest * period
    found = readings(machine, **{("rail [mm]", "q2 [rad]")[joint]: column})
    np.testing.assert_allclose(found.q[:, joint], path, atol=1e-9 * period * (1 + abs(start)), rtol=0)


def test_each_session_stands_in_the_range(tmp_path: Path) -> None:
    machine = gantry(tmp_path, ", range: [0, 2500], wrap: 1000")
    path = np.concatenate([np.linspace(100.0, 2300.0, 30), np.linspace(2400.0, 200.0, 30)])
    found = readings(machine, rail=path % 1000.0, session=[1.0] * 30 + [2.0] * 30)
    np.testing.assert_allclose(found.q[:, 0], path, atol=1e-9)


@pytest.mark.parametrize(
    ("path", "says"),
    [
        ([0.0, 400.0, 900.0], "found a step of 500 mm up to row 3"),
        (np.linspace(0.0, 4000.0, 30), "found a path that does not fit into it"),
    ],
)
def test_a_slide_whose_place_is_unknown_is_refused(tmp_path: Path, path: np.ndarray, says: str) -> None:
    machine = gantry(tmp_path, ", range: [0, 2500], wrap: 1000")
    words = (
        rf"'rail': readings modulo 1000 mm do not tell where in its range \[0, 2500\] mm the joint is: {says}"
    )
    with input_error(f"{words}, expected steps below 250 mm, or a range of at most 1000 mm"):
        readings(machine, rail=np.array(path) % 1000.0)


@pytest.mark.parametrize(
    ("wrap", "header", "scale"),
    [("360", "", 1.0), ("360", " [rad]", np.pi / 180), ("6.283185307 rad", " [rad]", np.pi / 180),
     ("1 turn", " [turn]", 1 / 360), ("90 deg", " [rad]", np.pi / 180), ("1.5707963268rad", "", 1.0)],
)  # fmt: skip
def test_what_readings_wrap_at_has_a_unit(tmp_path: Path, wrap: str, header: str, scale: float) -> None:
    machine = gantry(tmp_path, q2=f", range: [-300, 300], wrap: {wrap}")
    path = np.linspace(-280.0, 250.0, 80)
    period = 90.0 if wrap.startswith(("90", "1.5")) else 360.0
    found = readings(machine, **{f"q2{header}": path % period * scale})
    np.testing.assert_allclose(np.degrees(found.q[:, 1]), path, atol=1e-6)


def test_a_plain_wrap_is_in_no_other_unit_than_the_files(tmp_path: Path) -> None:
    machine = gantry(tmp_path, q2=", range: [-160, 190], wrap: 6.283185")
    with input_error(
        r"found a column in rad and `wrap: 6.283185` without a unit, .* such as `wrap: 6.283185 rad`"
    ):
        readings(machine, **{"q2 [rad]": [0.1, 6.0]})


def test_rows_without_an_order_jump_nowhere(arms: dict[str, Machine]) -> None:
    q = np.column_stack([np.linspace(20.0, 890.0, 40), np.zeros(40)])
    shuffled = load_recording(
        arms["stated"],
        {"q1": logged(q, -180.0)[:, 0], "q2": q[:, 1], **dict.fromkeys("xyz", [0.0] * 40)},
        shuffled=True,
    )
    np.testing.assert_allclose(np.degrees(shuffled.q[:, 0]), logged(q, -180.0)[:, 0], atol=1e-9)


def test_readings_beyond_a_range_of_a_turn_are_brought_into_it(arms: dict[str, Machine]) -> None:
    """Logged from 0 to 360 degrees they are no mistake; a reading that no whole turn explains is one."""
    q = np.array([[350.0, 10.0], [20.0, 200.0], [190.0, 300.0]])
    found = recorded(arms["ranged"], q)
    np.testing.assert_allclose(np.degrees(found.q), logged(q, -180.0), atol=1e-9)
    assert any("q1, q2: readings are brought into the joint's range by whole turns" in n for n in found.notes)
    with input_error("row 1, column 'q1': found 350 deg, expected a value in the joint's range"):
        recorded(arms["ranged"], np.array([[350.0, 10.0], [-20.0, 20.0]]))
