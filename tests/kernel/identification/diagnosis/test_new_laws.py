"""Laws of loads, struts, hoses, edges and heat of motion, found in rows that their mechanics made step by step."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from support.shifting_bench import Bench, clock
from truepose.arrays import Array
from truepose.identification.diagnosis.posterior_summary import SURE
from truepose.identification.diagnosis.result import NAMED, Diagnosis
from truepose.identification.fit.write_machine import write_calibrated

G, ROWS = 9.80665, 80
LEVER, OFF_AXIS = 0.5, 0.05
"""Of the arm: m from joint 2 to what it carries, and from joint 1 to joint 2."""


def assert_law(found: Diagnosis, effect: str, place: tuple[str, ...]) -> None:
    """It is named at its place, which is sure with its driver."""
    told = {(f.effect, f.place): f for f in found.findings}
    assert (effect, place) in told, list(told)
    one = told[effect, place]
    assert one.probability > NAMED and one.levels.driver > SURE


@pytest.fixture
def arm(tmp_path: Path) -> Bench:
    return Bench(tmp_path, "arm", 5)


def test_play_whose_flank_the_load_chooses(arm: Bench) -> None:
    """Friction of 4 N m holds the joint where it came to rest, unless it carries more: then it slides to the other flank."""
    q, kg = arm.readings(ROWS), np.tile([0.5, 2.0, 6.0, 0.0], ROWS // 4)
    came = arm.rng.choice([-1.0, 1.0], ROWS)
    play, friction = 4e-4, 4.0
    stands = np.empty(ROWS)
    for k in range(ROWS):
        load = -G * kg[k] * LEVER * np.cos(q[k, 1])
        behind = -came[k] * play / 2  # pushed by its drive, against friction
        while (
            load * np.sign(-behind) > friction
            and abs(behind) <= play / 2
            and np.sign(behind) != np.sign(load)
        ):
            behind += np.sign(load) * play / 50  # it slides
        stands[k] = np.sign(behind) * play / 2
    columns: dict[str, Any] = {"payload": kg, "approach.q2": came}
    frame = arm.frame(q, q + np.outer(stands, [0, 1]), **columns)
    assert_law(arm.diagnose(frame), "backlash", ("q2",))


def test_a_gear_that_is_soft_until_its_teeth_bear(arm: Bench) -> None:
    """It is wound up in small steps of torque: ten teeth bear one after the other, between 4 and 12 N m."""
    q, kg = arm.readings(ROWS), np.tile([1.0, 3.0, 10.0, 0.0], ROWS // 4)
    soft, stiff, steps = 4e4, 3e5, 400
    bears = np.linspace(4.0, 12.0, 10)
    load = -G * kg * LEVER * np.cos(q[:, 1])
    torque = np.abs(load)[:, None] * (np.arange(steps) + 0.5) / steps
    share = np.mean(torque[:, :, None] > bears, axis=2)
    wound = load * np.mean((1.0 - share) / soft + share / stiff, axis=1)
    assert_law(
        arm.diagnose(arm.frame(q, q + np.outer(wound, [0, 1]), payload=kg)), "joint-compliance", ("q2",)
    )


def test_legs_that_give_way_to_their_flexures(tmp_path: Path) -> None:
    """Where springy rods and bent flexures are in balance, found row by row; nobody weighed anything."""
    hexapod = Bench(tmp_path, "hexapod", 3)
    q = hexapod.readings(60)
    drawn = {name: p.nominal for name, p in hexapod.machine.geometry.items()}
    a, b = (np.array([[drawn[f"leg{k}.{end}.{c}"] for c in "xyz"] for k in range(1, 7)]) for end in "ab")
    stiffness, bending, length = 1e4, 3e6, 500.0
    home = b - a + np.array([0.0, 0.0, 440.0])
    home /= np.linalg.norm(home, axis=1)[:, None]

    def strains(pose: Array, travel: Array) -> Array:
        turn = Rotation.from_rotvec(pose[3:])
        rods = turn.apply(b) + pose[:3] - a - np.outer(travel, [0.0, 0.0, 1.0])
        long = np.linalg.norm(rods, axis=1)
        along = rods / long[:, None]
        bent = np.concatenate([along - home, turn.inv().apply(along) - home])
        return np.concatenate([np.sqrt(stiffness) * (long - length), np.sqrt(bending) * bent.ravel()])

    start, scale = [0.0, 0.0, 440.0, 0.0, 0.0, 0.0], [1.0] * 3 + [1e-3] * 3
    poses = [least_squares(strains, start, args=(travel,), x_scale=scale).x for travel in q]
    grown = np.array([strains(*each)[:6] for each in zip(poses, q, strict=True)]) / np.sqrt(stiffness)
    found = hexapod.diagnose(hexapod.frame(q, shifts={f"leg{k + 1}.length": grown[:, k] for k in range(6)}))
    assert_law(found, "leg-compliance", tuple(f"leg{k}" for k in range(1, 7)))
    (law,) = (e for e in found.terms if "flexures" in e.settings_map)
    assert law.values["c"] == pytest.approx(bending / stiffness, rel=0.1)
    write_calibrated(
        tmp_path / "improved.yaml", found.after, found.recording
    )  # refuses what reads as another machine


def test_a_strut_of_constant_force_between_two_links(arm: Bench) -> None:
    """Moment by the cross product of arm and force, over the stiffness of the gear."""
    q = arm.readings(ROWS)
    low, force, stiffness = np.array([0.0, -0.5]), 4000.0, 1.5e6
    ends = 0.3 * np.column_stack([np.cos(q[:, 1]), np.sin(q[:, 1])])
    along = (low - ends) / np.linalg.norm(low - ends, axis=1)[:, None]
    moment = force * (ends[:, 0] * along[:, 1] - ends[:, 1] * along[:, 0])
    assert_law(
        arm.diagnose(arm.frame(q, q + np.outer(moment / stiffness, [0, 1]))), "counterbalance", ("q2",)
    )


def test_a_hose_between_the_base_and_the_forearm(arm: Bench) -> None:
    """Each joint gives way to the slope of the energy of a spring between a point of the base and one of the forearm."""
    q = arm.readings(ROWS)

    def energy(angles: Array) -> Array:
        reach = OFF_AXIS + 0.3 * np.cos(angles[:, 1]) - 0.08 * np.sin(angles[:, 1])
        up = 0.4 + 0.3 * np.sin(angles[:, 1]) + 0.08 * np.cos(angles[:, 1])
        end = np.column_stack([reach * np.cos(angles[:, 0]), reach * np.sin(angles[:, 0]), up])
        return np.asarray(0.5 * 300.0 * np.sum((end - [0.3, -0.2, 0.7]) ** 2, axis=1))

    h = 1e-5
    slopes = [(energy(q + h * step) - energy(q - h * step)) / (2 * h) for step in np.eye(2)]
    assert_law(arm.diagnose(arm.frame(q, q - 1e-5 * np.column_stack(slopes))), "dress-pack", ("q1", "q2"))


def test_a_base_that_lifts_from_its_feet(arm: Bench) -> None:
    """A foot lifts once the weight at full reach is more than what holds it down: 15 N m, then 2e5 N m/rad."""
    q, kg = arm.readings(ROWS), np.tile([1.0, 3.0, 6.0, 9.0], ROWS // 4)
    reach = OFF_AXIS + LEVER * np.cos(q[:, 1])
    weight = np.column_stack([np.zeros(ROWS), np.zeros(ROWS), -G * kg])
    point = np.column_stack([reach * np.cos(q[:, 0]), reach * np.sin(q[:, 0]), np.zeros(ROWS)])
    moment = np.cross(point, weight)
    tilt = np.zeros((ROWS, 3))
    for k, m in enumerate(moment):
        low, high = 0.0, 1e-3
        for _ in range(60):  # of balance: what holds it down, and the floor's spring once it has lifted
            middle = (low + high) / 2
            low, high = (middle, high) if 15.0 + 2e5 * middle < np.linalg.norm(m) else (low, middle)
        tilt[k] = low * m / max(float(np.linalg.norm(m)), 1e-12)
    shifts = {"base.rx": tilt[:, 0], "base.ry": tilt[:, 1]}
    assert_law(arm.diagnose(arm.frame(q, shifts=shifts, payload=kg)), "rocking-mount", ("base",))


def warmth(way: Array, lag: float, step: float) -> Array:
    """What moves leave behind in a body that cools, by small explicit steps between the rows."""
    warm = np.zeros(len(way))
    for k in range(1, len(way)):
        here = warm[k - 1]
        for _ in range(200):
            here -= here * (step / 200) / lag
        warm[k] = here + abs(way[k] - way[k - 1])
    return warm


def test_a_zero_that_moves_with_its_motor_s_heat(arm: Bench) -> None:
    q = arm.readings(ROWS)
    q[20:50, 1] = q[20, 1] + 0.02 * np.arange(30)  # it rests, and cools
    moved = 2e-5 * warmth(q[:, 1], 1500.0, 60.0)
    frame = arm.frame(q, q + np.outer(moved, [0, 1]), time=clock(ROWS))
    assert_law(arm.diagnose(frame), "motor-heat", ("q2",))


def test_a_screw_that_grows_as_it_travels(tmp_path: Path) -> None:
    """Each element of the screw from its fixed end on is longer by the warmth."""
    table = Bench(tmp_path, "table", 6)
    q = table.readings(ROWS)
    q[25:55, 0] = q[25, 0] + 0.5 * np.arange(30) * np.sign(-q[25, 0])
    warm = warmth(q[:, 0], 1200.0, 60.0)
    elements = np.linspace(-100.0, 100.0, 2001)
    grown = [2e-6 * w * 0.1 * np.count_nonzero(elements < s) for w, s in zip(warm, q[:, 0], strict=True)]
    frame = table.frame(q, q + np.outer(grown, [1, 0]), time=clock(ROWS))
    assert_law(table.diagnose(frame), "screw-growth", ("s",))
