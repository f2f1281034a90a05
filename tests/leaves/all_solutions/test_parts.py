"""Laws of what generated C is made from: the drawn arm, the order of pivots, natural units, samples."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from support.six_joint_arms import ARMS, BUILT, DRAWN, GENERAL
from truepose.codegen.chain import ChainExpressions
from truepose.codegen.leaves.all_solutions.solutions import branches_of
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model
from truepose.models.machine.velocities import chain_of

TURNING = (True,) * 6


# -- arms ----------------------------------------------------------------------------------------------


@cache
def arm(name: str) -> tuple[SymbolicModel, ChainExpressions]:
    with TemporaryDirectory() as folder:
        model = symbolic_model(ARMS[name].machine(Path(folder)))
    chain = chain_of(model)
    assert chain is not None
    return model, ChainExpressions.of(model, chain)


@pytest.mark.parametrize("name", [*DRAWN, *BUILT])
def test_the_drawn_arm_is_the_arm_next_to_it(name: str) -> None:
    """Exactly where it was built as drawn; else with axes within 0.05 rad and a meeting point within 2 % of the reach."""
    frames = ARMS[name].frames(np.zeros((1, 6)))[0]
    reach = 1500.0
    found = branches_of(*arm(name), reach, TURNING)
    assert found is not None
    alike = [1, 2] if found.kind == "wrist" else [1, 2, 3]
    last = [3, 4, 5] if found.kind == "wrist" else [4, 5]
    angle, distance = (1e-9, 1e-6) if name in DRAWN else (0.05, 0.02 * reach)
    np.testing.assert_allclose(np.linalg.norm(found.axes, axis=1), 1.0, atol=1e-12)
    assert np.linalg.norm(np.cross(found.axes, frames[:6, :, 2]), axis=1).max() <= angle
    assert (np.sum(found.axes * frames[:6, :, 2], axis=1) > 0.9).all()
    np.testing.assert_allclose(found.axes[alike], found.signs[: len(alike), None] * found.common, atol=1e-12)
    assert set(found.signs.tolist()) <= {-1.0, 1.0} and found.signs[0] == 1.0  # along the second axis
    off = np.linalg.norm(np.cross(found.points - frames[:6, :, 3], frames[:6, :, 2]), axis=1)
    assert off.max() <= distance
    np.testing.assert_array_equal(found.points[last], np.tile(found.meeting, (len(last), 1)))
    np.testing.assert_allclose(found.tool, frames[6], atol=1e-9)
    across = found.axes[5] if found.kind == "wrist" else found.common
    assert found.side @ across == pytest.approx(0.0, abs=1e-12) and np.linalg.norm(
        found.side
    ) == pytest.approx(1.0)


@pytest.mark.parametrize("name", GENERAL)
def test_no_drawn_arm_is_next_to_a_general_one(name: str) -> None:
    assert branches_of(*arm(name), 1500.0, TURNING) is None


def test_an_arm_with_a_joint_that_does_not_repeat_after_a_turn_has_no_closed_form() -> None:
    for k in range(6):
        assert branches_of(*arm("ur"), 1500.0, (*TURNING[:k], False, *TURNING[k + 1 :])) is None


# -- natural units -------------------------------------------------------------------------------------


# -- samples -------------------------------------------------------------------------------------------
