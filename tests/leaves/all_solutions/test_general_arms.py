"""All solutions of six-joint arms without a closed form nearby: laws of the elimination, and of the C."""

from __future__ import annotations

import ctypes
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from support.generated_c import COMPILER, WARNINGS, needs_compiler
from support.six_joint_arms import ARMS, GENERAL, BuiltArm, built, counted, errors, folded, search
from truepose.arrays import Array
from truepose.codegen.c import generate
from truepose.codegen.leaves.all_solutions.resultant import Screws, solutions
from truepose.codegen.printer import Real

TURNS = (True,) * 6
SAME = 1e-5
"""Largest difference of readings (rad, parts of a metre) of one solution: next to a double root of the pose to 1e-9."""


def random_screws(rng: np.random.Generator, turns: tuple[bool, ...] = TURNS) -> Screws:
    axes = rng.normal(size=(6, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return Screws(axes, rng.uniform(-0.4, 0.4, (6, 3)), turns)


def motion(screws: Screws, q: Array) -> tuple[Array, Array]:
    """E1 ... E6."""
    rotation, shift = np.eye(3), np.zeros(3)
    for k in range(6):
        own, way = screws.motion(k, float(q[k]))
        rotation, shift = rotation @ own, rotation @ way + shift
    return rotation, shift


def off(screws: Screws, a: Array, b: Array) -> Array:
    """Largest difference of readings, up to full turns of those that turn."""
    return np.asarray(np.abs(np.where(screws.turns, folded(a - b), a - b)).max(axis=-1))


def exact(screws: Screws, G: tuple[Array, Array], found: Array) -> Array:
    """Those of the found that are real: they meet the displacement."""
    gaps = []
    for q in found:
        rotation, shift = motion(screws, q)
        gaps.append(np.abs(rotation - G[0]).max() + np.abs(shift - G[1]).max())
    return found[np.array(gaps) < 1e-5]


def among(made: BuiltArm, rows: Array, q: Array) -> Array:
    """Largest difference of each row from readings, up to full turns; metres of slides."""
    apart = np.where(made.arm.slide, 1e-3 * (rows - q), folded(rows - q))
    return np.asarray(np.abs(apart).max(axis=-1))


@pytest.mark.parametrize("slide", [None, 1, 3])
def test_whatever_joint_is_taken_first_the_solutions_are_the_same(slide: int | None) -> None:
    rng = np.random.default_rng(3 if slide is None else slide)
    numbers = []
    for _ in range(6):
        screws = random_screws(rng, tuple(k != slide for k in range(6)))
        q = rng.uniform(-3, 3, 6) * np.where(screws.turns, 1.0, 0.1)
        G = motion(screws, q)
        firsts = [k for k in range(6) if slide not in ((k + 2) % 6, (k + 5) % 6)]
        all_found = [exact(screws, G, solutions(screws, G, first)) for first in firsts]
        for found in all_found:
            # two of one pose nearly merge: the square root of rounding
            assert off(screws, found, q).min() < 1e-5
            for other in found:
                assert all(off(screws, others, other).min() < 1e-4 for others in all_found)
        numbers.append(len(all_found[0]))
    assert max(numbers) >= 4  # not one each


@needs_compiler
@pytest.mark.parametrize("name", GENERAL)
def test_all_are_solutions_and_the_readings_of_the_pose_are_among_them(
    root_directory: Path, name: str
) -> None:
    made = built(root_directory, name)
    low, high = made.arm.limits
    numbers, missed = [], 0
    q = made.arm.readings(100, seed=13)
    for readings, pose in zip(q, made.arm.poses(q), strict=True):
        code, rows = made.ik_all(pose)
        assert code == 0
        error = errors(made.arm.poses(rows), np.tile(pose, (len(rows), 1)))
        assert np.linalg.norm(error[:, :3], axis=1).max() < 1e-6
        assert np.linalg.norm(error[:, 3:], axis=1).max() < 1e-9
        assert (rows >= low - 1e-6).all() and (rows <= high + 1e-6).all()
        apart = among(made, rows[:, None], rows[None]) + 9.0 * np.eye(len(rows))
        assert apart.min() > 1e-7  # distinct
        missed += among(made, rows, readings).min() > SAME
        numbers.append(len(rows))
    # of the drawing itself, whose determinant is zero everywhere, an arm nearby is solved: about one in a hundred is missed
    assert missed <= (3 if name == "offset" else 0)
    assert max(numbers) > 1


@needs_compiler
@pytest.mark.parametrize("name", ["general", "offset_built"])
def test_a_search_from_many_starts_finds_no_other(root_directory: Path, name: str) -> None:
    made = built(root_directory, name)
    rng = np.random.default_rng(12)
    total = 0
    for pose in made.arm.poses(made.arm.readings(12, seed=14)):
        _, rows = made.ik_all(pose)
        for other in search(made.arm, pose, rng.uniform(-np.pi, np.pi, (150, 6))):
            assert among(made, rows, other).min() < SAME
            total += 1
    assert total > 200


@needs_compiler
def test_out_of_reach_there_is_none(root_directory: Path) -> None:
    made = built(root_directory, "general")
    pose = made.arm.poses(made.arm.readings(1, seed=15))[0].copy()
    pose[3] += 1e5
    assert made.ik_all(pose)[0] == 1


def with_list(where: Path, name: str, features: str, *flags: str, real: Real = "double") -> BuiltArm:
    """One of ARMS with some features, every file compiled with every warning an error."""
    assert COMPILER is not None
    directory = where / "-".join(["listed", name, features, real, *flags])
    generate(ARMS[name].machine(where), directory, real, features=features)
    sources = sorted(file.name for file in directory.glob(f"{name}_*.c"))
    command = [COMPILER, *WARNINGS, *(flags or ("-O0",)), "-shared", "-fPIC", *sources, "-lm", "-o", "lib.so"]
    subprocess.run(command, cwd=directory, check=True)
    return BuiltArm(ARMS[name], directory, ctypes.CDLL(str(directory / "lib.so")))


@needs_compiler
@pytest.mark.parametrize("name", ["offset", "gantry_built", "ur_built"])
def test_a_list_compiles_in_single_precision_and_for_wide_vectors(root_directory: Path, name: str) -> None:
    for features in ("warm,branches", "cold"):
        with_list(root_directory, name, features, "-O1", "-march=native", real="float")


@needs_compiler
@pytest.mark.parametrize("name", ["ur_built", "general"])
def test_vector_lanes_find_the_same(root_directory: Path, name: str) -> None:
    plain, lanes = (
        built(root_directory, name, flags) for flags in (("-DTRUEPOSE_SCALAR",), ("-march=native",))
    )
    poses = plain.arm.poses(plain.arm.readings(60, seed=16))
    pairs = [(plain.ik_all(pose)[1], lanes.ik_all(pose)[1]) for pose in poses]
    for one, other in pairs:
        assert len(one) == len(other)
        assert max(among(plain, other, q).min() for q in one) < SAME
    assert sum(len(one) for one, _ in pairs) > 200


@needs_compiler
@pytest.mark.parametrize("name", ["ur_built", "general", "gantry_built"])
def test_all_solutions_take_no_more_evaluations_than_the_header_says(root_directory: Path, name: str) -> None:
    made = counted(root_directory, name)
    header = (made.directory / f"{name}_kin.h").read_text()
    limit = int(re.findall(rf"#define {name}_MAX_ALL (\d+)", header)[0])
    count = ctypes.c_int.in_dll(made.library, "evaluations")
    poses = made.arm.poses(made.arm.readings(40, seed=17))
    poses[:, [3, 7, 11]] *= np.linspace(0.7, 2.0, 40)[:, None]
    spent = []
    for pose in poses:
        count.value = 0
        made.ik_all(pose)
        spent.append(count.value)
    assert 0 < max(spent) <= limit
