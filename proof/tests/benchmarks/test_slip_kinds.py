"""The maker of slips: right pairs are right, and every slip is what it is called."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from door import rotations
from door.kinds import KINDS
from door.kinds.units import scaled
from door.pairs import MACHINE, RECORDING, Pair, write
from door.sources.chain import Arm, Body, links, torques
from door.sources.gough import gough
from door.sources.serial import serial
from door.sources.tables import FAMILIES

from truepose.identification.fit.estimate import estimate
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

Array = np.ndarray
SEED = 5
PLAIN = (0.6, 1.5)
"""chi2 per degree of freedom of some 100 to 1000 readings: five sigmas either way of the fewest."""


def plain(name: str, seed: int = SEED) -> Pair:
    """A pair with nothing but geometry and noise."""
    rng = np.random.default_rng(seed)
    if name.startswith("6-"):
        form, sensor = name.split(" ")
        return gough(form, sensor, rng, effects=0)
    family, form, sensor = name.split(" ")
    return serial(family, form, sensor, rng, effects=0)


@pytest.mark.parametrize(
    "name",
    [
        f"{family} serial {s}"
        for family, s in zip(FAMILIES, ("pose", "position", "targets", "ballbar") * 2, strict=False)
    ]
    + ["elbow urdf pose", "seven graph pose", "6-ups pose", "6-pus targets", "6-ups ballbar"],
)
def test_a_right_pair_fits_to_its_noise(name: str, tmp_path: Path) -> None:
    pair = plain(name)
    assert pair.plain
    write(tmp_path / "pair", pair.document, pair.table, pair.files)
    machine = load_machine(tmp_path / "pair" / MACHINE)
    fit = estimate(machine, load_recording(machine, [tmp_path / "pair" / RECORDING]))
    assert PLAIN[0] < fit.chi2_per_dof < PLAIN[1]
    assert fit.worst_parameter_sigma < 5.0  # the largest of some forty


def test_physics_is_there_where_it_was_asked_for() -> None:
    still, moved = (serial("elbow", "serial", "pose", np.random.default_rng(3), effects=k) for k in (0, 3))
    assert still.plain and not moved.plain


def spoilt(kind: str, pair: Pair, variant: str = "") -> tuple[dict[str, object], pd.DataFrame]:
    """Document and table of a mistake, of a variant that begins so."""
    for seed in range(200):
        made = KINDS[kind](pair, np.random.default_rng(seed))
        if made is not None and made.variant.startswith(variant):
            return made.document, made.table
    raise AssertionError(f"{kind}: no {variant!r}")


def tool(pair: Pair, table: pd.DataFrame) -> Array:
    """(n, 4, 4) that a table of poses says."""
    return rotations.poses(table[list(pair.readings)].to_numpy())


def test_inverse_pose_is_the_inverse() -> None:
    pair = plain("elbow serial pose")
    product = tool(pair, spoilt("inverse-pose", pair)[1]) @ tool(pair, pair.table)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(4), product.shape), atol=1e-9)


def test_a_left_handed_frame_mirrors_the_whole_pose() -> None:
    pair = plain("elbow serial pose")
    _, table = spoilt("handedness", pair, "-y")
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    np.testing.assert_allclose(tool(pair, table), mirror @ tool(pair, pair.table) @ mirror, atol=1e-9)


def test_roll_pitch_yaw_turn_as_the_convention_says() -> None:
    pair = plain("elbow serial pose")
    _, table = spoilt("rotation-convention", pair, "roll")
    roll, pitch, yaw = np.radians(table[["rx", "ry", "rz"]].to_numpy().T)
    turned = rotations.turn("z", yaw) @ rotations.turn("y", pitch) @ rotations.turn("x", roll)
    np.testing.assert_allclose(turned[:, :3, :3], tool(pair, pair.table)[:, :3, :3], atol=1e-9)


def test_a_new_set_up_moves_the_second_half_rigidly() -> None:
    pair = plain("elbow serial pose")
    _, table = spoilt("sessions-mixed", pair)
    step = tool(pair, table) @ rotations.inverse(tool(pair, pair.table))
    first = np.flatnonzero(np.abs(step[:, :3, 3]).max(axis=1) > 1.0)[0]
    np.testing.assert_allclose(step[first:], np.broadcast_to(step[first], step[first:].shape), atol=1e-6)
    np.testing.assert_allclose(step[:first], np.broadcast_to(np.eye(4), step[:first].shape), atol=1e-6)


def test_shifted_rows_pair_readings_with_others_joints() -> None:
    pair = plain("elbow serial position")
    _, table = spoilt("rows-shifted", pair, "shifted")
    lost = len(pair.table) - len(table)
    assert 1 <= lost <= 3
    x, own = pair.table["x"].to_numpy(), table["x"].to_numpy()
    q, joint = pair.table[next(iter(pair.joints))].to_numpy(), table[next(iter(pair.joints))].to_numpy()
    later = np.array_equal(own, x[:-lost]) and np.array_equal(joint, q[lost:])
    earlier = np.array_equal(own, x[lost:]) and np.array_equal(joint, q[:-lost])
    assert later != earlier


def test_duplicates_are_copies_to_the_last_digit() -> None:
    pair = plain("elbow serial position")
    _, table = spoilt("duplicated-rows", pair)
    names = [*pair.joints, *pair.readings]
    assert not pair.table.duplicated(names).any()
    assert table.duplicated(names).sum() == len(table) - len(pair.table) >= 5


@pytest.mark.parametrize("name", ["gantry serial targets", "6-ups pose", "seven graph pose"])
def test_a_machine_scaled_back_is_the_machine(name: str) -> None:
    pair = plain(name)
    sliding = {joint for joint, kind in pair.joints.items() if kind == "prismatic"}
    back = scaled(scaled(pair.document, 1e-3, sliding), 1e3, sliding)
    flat, own = (pd.json_normalize(d).iloc[0].to_dict() for d in (back, pair.document))
    assert list(flat) == list(own)
    assert json.dumps(pair.document["mechanism"]["type"]) == json.dumps(back["mechanism"]["type"])


def test_standard_rows_are_another_arm_than_modified_ones(tmp_path: Path) -> None:
    """The pair's own rows are the data sheet's, one joint on; typed as they stand they are not."""
    pair = plain("elbow serial pose")
    rows = pair.document["mechanism"]["joints"]
    assert [r["alpha"] for r in rows[1:]] == [s["alpha"] for s in pair.sheet[:-1]]
    document, _ = spoilt("dh-convention", pair, "names")
    typed = document["mechanism"]["joints"]  # type: ignore[index]
    assert [r["alpha"] for r in typed] == [s["alpha"] for s in pair.sheet]


def test_torque_is_the_slope_of_the_potential_energy() -> None:
    rng = np.random.default_rng(2)
    rows = np.column_stack(
        [
            np.zeros(4),
            rng.uniform(-2, 2, 4),
            *rng.uniform(-300, 300, (1, 4)),
            rng.uniform(-2, 2, (4)),
            rng.uniform(-300, 300, 4),
        ]
    )
    body = Body(4, 3.0, np.array([10.0, -50.0, 80.0]))
    arm = Arm(rows, np.array([False, False, True, False]), np.eye(4), np.eye(4), (body,))
    q = rng.uniform(-1, 1, (1, 4))

    def energy(at: Array) -> float:
        frame = links(arm, at)[0][4][0]
        return float(body.kg * 9.80665 * (frame[:3, :3] @ body.com + frame[:3, 3])[2] * 1e-3)

    step = 1e-5
    for k in (0, 1, 3):
        unit = step * np.eye(4)[k]
        slope = (energy(q + unit) - energy(q - unit)) / (2 * step)
        assert torques(arm, q, np.zeros(1))[0, k] == pytest.approx(-slope, abs=1e-6)
