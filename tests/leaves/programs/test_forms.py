"""Poses as controllers write them: numbers and poses are each other's inverse, next to the numbers that stood there."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.identification.leaves.programs.pose_forms import (
    Euler,
    Form,
    Quaternion,
    RotationVector,
    written,
)

VECTOR = RotationVector(("m",) * 3, ("rad",) * 3, (7,) * 6, "m and rad")
UNITS = RotationVector(("um", "mm", "m"), ("deg", "rad", "mrad"), (1,) * 6, "of several units")
RNG = np.random.default_rng(4)
PLACES = RNG.uniform(-900, 900, (60, 3))


def angles() -> Array:
    """Beyond a turn, and with middle angles over the top: no number of a program need be the least one."""
    out = RNG.uniform(-500.0, 500.0, (60, 3))
    return np.hstack([PLACES, out[np.abs(np.cos(np.radians(out[:, 1]))) > 1e-3]])


def quaternions() -> Array:
    out = RNG.standard_normal((60, 4))
    norm = RNG.uniform(0.996, 1.004, (60, 1))  # rounded as they are in modules
    return np.hstack([PLACES, norm * out / np.linalg.norm(out, axis=1)[:, None]])


def vectors() -> Array:
    out = RNG.standard_normal((60, 3))
    size = RNG.uniform(0.0, 4 * np.pi, (60, 1))
    return np.hstack([PLACES / 1000, size * out / np.linalg.norm(out, axis=1)[:, None]])


FORMS: list[tuple[Form, Array]] = [
    (Euler(), angles()),
    (Quaternion(), quaternions()),
    (VECTOR, vectors()),
    (UNITS, vectors() * [1e6, 1e3, 1, 180 / np.pi, 1, 1e3]),
]


@pytest.mark.parametrize(("form", "numbers"), FORMS, ids=["Euler", "quaternion", "vector", "units"])
def test_numbers_of_a_pose_are_those_that_stood_there(form: Form, numbers: Array) -> None:
    """Of all numbers that mean a pose: also next to numbers that a correction would leave."""
    poses = form.poses(numbers)
    np.testing.assert_allclose(form.numbers(poses, numbers), numbers, rtol=1e-9, atol=1e-8)
    if not isinstance(form, Quaternion):  # whose norm would be that of the others
        near = numbers + 1e-4 * np.sin(np.arange(numbers.size)).reshape(numbers.shape)
        np.testing.assert_allclose(form.numbers(poses, near), numbers, rtol=1e-9, atol=1e-8)
    again = form.poses(form.numbers(poses, np.ones_like(numbers)))
    # far from what stood there, the same pose all the same
    np.testing.assert_allclose(again, poses, atol=1e-7)
    assert len(form.decimals) == numbers.shape[1]


def test_poses_are_those_of_scipy() -> None:
    numbers = angles()
    by_axes = [
        Rotation.from_rotvec(np.radians(v) * e) for v, e in zip(numbers[0, 3:], np.eye(3)[::-1], strict=True)
    ]
    expected = (by_axes[0] * by_axes[1] * by_axes[2]).as_matrix()  # Rz(A) Ry(B) Rx(C)
    np.testing.assert_allclose(Euler().poses(numbers)[0, :3, :3], expected, atol=1e-12)
    half = np.sqrt(0.5)
    about_x = Quaternion().poses(np.array([[1.0, 2.0, 3.0, half, half, 0.0, 0.0]]))[0]
    expected = np.array([[1, 0, 0, 1], [0, 0, -1, 2], [0, 1, 0, 3], [0, 0, 0, 1.0]])
    np.testing.assert_allclose(about_x, expected, atol=1e-12)
    in_m = VECTOR.poses(np.array([[1.0, 2.0, 3.0, 0.0, 0.0, np.pi / 2]]))[0]
    expected = np.array([[0, -1, 0, 1e3], [1, 0, 0, 2e3], [0, 0, 1, 3e3], [0, 0, 0, 1]])
    np.testing.assert_allclose(in_m, expected, atol=1e-9)


@pytest.mark.parametrize("middle", [90.0, -90.0, 270.0])
def test_where_two_angles_count_together_the_first_stays(middle: float) -> None:
    """A wrist that points up or down: A and C are told as one angle, and a program's A is not for us to change."""
    near = np.array([[10.0, 20.0, 30.0, 35.0, middle, -50.0]])
    for more in (0.0, 7.0):  # the pose turned by so much about A
        pose = Euler().poses(near + np.array([0, 0, 0, more, 0, 0]))
        found = Euler().numbers(pose, near)
        sign = -1.0 if middle == 90.0 else 1.0
        np.testing.assert_allclose(found, near + np.array([0, 0, 0, 0, 0, sign * more]), atol=1e-6)


def test_a_pose_that_is_not_turned_keeps_whole_turns_of_its_vector() -> None:
    upright = np.eye(4)[None]
    whole = 2 * np.pi * np.array([0.6, 0.0, 0.8])
    for near, turn in ((whole * 0.95, whole), (whole * 0.45, 0 * whole), (-whole * 1.9, -2 * whole)):
        found = VECTOR.numbers(upright, np.hstack([np.zeros(3), near])[None])
        np.testing.assert_allclose(found[0, 3:], turn, atol=1e-12)


@pytest.mark.parametrize(
    ("value", "before", "decimals", "text"),
    [
        (1.23456789, "1.2", 4, "1.2346"),  # as many decimals as the correction needs
        (1.23456789, "1.200000", 4, "1.234568"),  # and no fewer than there were
        (1.2000004, "1.20", 4, "1.20"),  # a number that stays is not written anew
        (1.20006, "1.20", 4, "1.2001"),
        (2.5, "1.2", 4, "2.5"),  # zeros that tell nothing are left out
        (3.0, "1.20", 4, "3.00"),  # but for as many as stood there
        (3.0, "1", 4, "3.0"),
        (-30.0, "1", 4, "-30.0"),
        (20.0, "7", 0, "20"),
        (-0.00001, "0.5", 4, "0.0"),  # no minus before nothing
        (-0.2, "0.5", 4, "-0.2"),
        (2.5, "+1.5", 4, "+2.5"),
        (-2.5, "+1.5", 4, "-2.5"),
        (0.00251, "1.5e-3", 2, "0.0025"),  # a power of ten moves the point
        (0.00251, "1.5E-4", 2, "0.00251"),
        (201.23456, "2E2", 4, "201.2346"),
        (201.23456, "2.00000E2", 2, "201.235"),
    ],
)  # fmt: skip
def test_a_number_is_written_in_the_style_of_the_one_before(
    value: float, before: str, decimals: int, text: str
) -> None:
    assert written(value, before, decimals) == text


@pytest.mark.parametrize("form", [Euler(), Quaternion()], ids=["Euler", "quaternion"])
def test_what_is_rounded_is_less_than_a_tenth_of_a_micrometre_a_metre_away(form: Form) -> None:
    """And with one decimal fewer it would be more: controllers show no endless numbers."""
    # mm, of a turn by one in the last numbers
    size = 1000.0 * (np.pi / 180 if len(form.decimals) == 6 else 2.0)
    for k, decimals in enumerate(form.decimals):
        step = 10.0**-decimals * (1.0 if k < 3 else size)
        assert step <= 1.0001e-4 < 10 * step
