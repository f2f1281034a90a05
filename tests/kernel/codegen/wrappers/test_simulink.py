"""The Simulink block of the generated C, driven as Simulink drives it, says what the library says."""

from __future__ import annotations

import subprocess

import numpy as np
import pytest

from support.generated_c import COMPILER, WARNINGS, Built, cases, needs_compiler
from support.wrapped import SIMULINK, Block, rows_of, wrapped

COMPENSATE, IK, FK = 1, 2, 3

pytestmark = needs_compiler


@cases(("arm", "nano", "turns"))
def test_a_block_says_what_the_library_says(built: Built) -> None:
    q, poses = (v.astype(built.dtype).astype(float) for v in rows_of(built))
    drivers = [built.model.z_home + 1.5] if len(built.model.drivers) else []
    z = drivers[0] if drivers else None
    guess = 0.999 * q
    for function, inputs, name in (
        (COMPENSATE, [q], "compensate"),
        (IK, [poses, guess], "ik"),
        (FK, [q], "fk"),
    ):
        block = Block(built, function)
        assert block.error is None
        width = 12 if function == FK else built.n
        assert block.inputs == [v.shape[1] for v in inputs] + [len(d) for d in drivers]
        assert block.outputs == [width, 1]
        assert block.feedthrough == 1 and block.reals == width and block.integers == 1 and block.others == 0
        for k in range(4):
            code, found = block.step(*(v[k] for v in inputs), *drivers)
            expected = built.call(name, *(v[k] for v in inputs), out=np.zeros(width), z=z)
            assert code == expected[0] == 0
            np.testing.assert_array_equal(found, expected[1])
        block.close()


@cases(("arm", "nano"), ("double",))
def test_a_block_holds_the_latest_result_where_there_is_none(built: Built) -> None:
    q, poses = rows_of(built)
    drivers = [built.model.z_home] if len(built.model.drivers) else []
    far = poses[0] + 1e6 * np.eye(12)[3]
    block = Block(built, IK)
    code, found = block.step(far, q[0], *drivers)
    assert code != 0
    np.testing.assert_array_equal(found, q[0])  # nothing solved yet: the guess
    solved = block.step(poses[1], q[1], *drivers)[1]
    trial = block.step(poses[2], q[2], *drivers, major=False)[1]  # a minor step is no result to keep
    assert not np.array_equal(trial, solved)
    code, found = block.step(far, q[0], *drivers)
    assert code != 0
    np.testing.assert_array_equal(found, solved)
    block.close()
    wrong = np.full(built.n, np.nan)
    for function, expected in ((COMPENSATE, wrong), (FK, np.zeros(12))):
        block = Block(built, function)
        code, found = block.step(wrong, *drivers)
        assert code == 4
        np.testing.assert_array_equal(found, expected)
        block.close()


@cases(("arm",), ("double",))
def test_blocks_run_beside_each_other_with_their_own_calibration(built: Built) -> None:
    q, _ = rows_of(built)
    z, moved = built.model.z_home, built.model.p_home.copy()
    moved[built.define("P_q1_r")] += 25.0
    one, other = Block(built, FK), Block(built, FK, moved.tolist())
    for k in range(4):
        heights = [block.step(q[k], z)[1][11] for block in (one, other)]
        assert heights[1] - heights[0] == pytest.approx(25.0, abs=0.1)  # its axis is vertical to 0.1 deg
    one.close()
    np.testing.assert_array_equal(other.step(q[0], z)[1], built.fk(q[0], p=moved)[1])
    other.close()


@cases(("arm", "nano"))
def test_a_block_compiles_for_generated_code_too(built: Built) -> None:
    assert COMPILER is not None
    flags = [flag for flag in WARNINGS if flag != "-Wdouble-promotion"]
    where = [f"-I{SIMULINK}", "-I..", "-fsyntax-only", f"{built.machine.name}_sfun.c"]
    subprocess.run([COMPILER, *flags, *where], cwd=wrapped(built), check=True)
