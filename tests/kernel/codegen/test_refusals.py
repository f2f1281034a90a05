"""What generated C refuses at run time, leaving its outputs as they were, and what the generator refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from support.generated_c import Built, build, cases, needs_compiler
from support.generated_machines import machine_of
from truepose.codegen.c import generate
from truepose.errors import InputError

# -- at run time ---------------------------------------------------------------------------------------


@needs_compiler
@cases()
def test_outputs_stay_as_they_were_on_bad_input(built: Built) -> None:
    row = built.samples()[0]
    q, pose = row[: built.n], row[built.n :]
    sentinel = np.arange(20.0)
    for place in range(built.n):
        for bad in (np.nan, np.inf):
            wrong = q.copy()
            wrong[place] = bad
            for function, inputs, size in (
                ("fk", (wrong,), 12),
                ("ik", (pose, wrong), built.n),
                ("compensate", (wrong,), built.n),
            ):
                code, out = built.call(function, *inputs, out=sentinel[:size])
                assert code == 4
                np.testing.assert_array_equal(out, sentinel[:size])
    skewed, mirrored, nan = pose.copy(), pose.copy(), pose.copy()
    skewed[0] += 1e-3
    mirrored[[0, 4, 8]] *= -1
    nan[3] = np.nan
    for wrong in (skewed, mirrored, nan):
        for function, inputs, size in (("ik", (wrong, q), built.n), ("fk_from", (q, wrong), 12)):
            code, out = built.call(function, *inputs, out=sentinel[:size])
            assert code == 4
            np.testing.assert_array_equal(out, sentinel[:size])
    p = built.model.p_home.copy()
    p[0] = np.nan
    assert built.fk(q, p=p)[0] == 4
    code, out = built.call(
        "jac", q, out=np.full(6 * built.n, -7.0), z=np.full(max(1, len(built.model.drivers)), np.nan)
    )
    assert code == 4
    assert (out == -7.0).all()


@needs_compiler
@cases(("arm", "nano", "rails", "scara", "redundant"))
def test_a_far_pose_is_refused(built: Built) -> None:
    row = built.samples()[0]
    pose = row[built.n :].copy()
    pose[[3, 7]] += 5000.0
    code, q = built.ik(pose, row[: built.n])
    # slides without end would reach it
    assert code == (3 if built.machine.name == "nano" else 1)
    assert (q == -7.0).all()


@needs_compiler
@cases(("nano", "rails", "turns"))
def test_joint_ranges_hold(built: Built) -> None:
    row = built.samples()[0]
    pose = row[built.n :].copy()
    pose[11] += 1.0 if built.machine.name == "nano" else 150.0
    code, q = built.ik(pose, row[: built.n])
    assert code == 3
    assert (q == -7.0).all()


@needs_compiler
def test_loops_that_cannot_close_are_reported(root_directory: Path) -> None:
    built = build(root_directory, "turns", "double")
    q = np.array([6.0, -6.0, 6.0, -6.0, 6.0, -6.0])
    for code, out in (built.fk(q), built.call("jac", q, out=np.full(36, -7.0))):
        assert code in (1, 2)
        assert (out == -7.0).all()


# -- by the generator ----------------------------------------------------------------------------------


def test_an_unknown_nominal_parameter_is_refused(tmp_path: Path) -> None:
    for nominal, words in (({"q9.r": 1.0}, r"q9\.r"), ({"q1.r": np.nan}, r"q1\.r = nan")):
        with pytest.raises(InputError, match=words):
            generate(machine_of(tmp_path, "nano"), tmp_path / "out", nominal=nominal)
