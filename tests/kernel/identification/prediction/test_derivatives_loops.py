"""Total derivatives through closed loops against loops closed anew with 40 digits.

They are differenced with steps of 1e-12, whose error is the step squared. What is left is rounding of the double
arithmetic under test: measured 3e-15.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import mpmath  # type: ignore[import-untyped]
import numpy as np
import pytest

from support.derivative_machines import read_machines, readings, symbols_of
from support.moving_machines import drawn, record
from support.other_numbers import DIGITS, run
from truepose.arrays import Array
from truepose.identification.prediction.predictor import Predictor
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.mktemp("machines"))


def _closed(model: SymbolicModel, at: Sequence[Any], rough: Array) -> list[Any]:
    """The passive coordinates that close the loops, to 30 digits, from doubles: Newton with a double's slope."""
    function = ca.Function("closure", symbols_of(model), [ca.densify(model.closure)])
    slope = ca.Function("slope", symbols_of(model), [ca.densify(ca.jacobian(model.closure, model.x))])
    doubles = [np.array([float(v) for v in part]) for part in at]
    inverse = np.linalg.inv(slope(rough, *doubles).full())
    x = [mpmath.mpf(float(v)) for v in rough]
    for _ in range(60):
        (gap,) = run(function, [x, *at], DIGITS)
        step = [mpmath.fdot([mpmath.mpf(float(v)) for v in row], gap) for row in inverse]
        x = [a - b for a, b in zip(x, step, strict=True)]
        if max(abs(s) for s in step) < mpmath.mpf(10) ** -34:
            return x
    raise AssertionError("the loops did not close")


@pytest.mark.parametrize("name", ["6-pus", "6-ups", "hybrid"])
def test_total_derivatives_through_closed_loops(machines: Mapping[str, Machine], name: str) -> None:
    """The implicit function theorem against loops closed anew with 40 digits, along random directions."""
    machine, rng = machines[name], np.random.default_rng(9)
    q, p = readings(machine, rng, 2), drawn(machine, rng, 2.0)
    predictor = Predictor(machine, record(machine, q))
    x, good = predictor.assemble(p)
    assert good.all()
    pose, twists = predictor.twists(p, x)
    model = predictor.model
    world = ca.Function("world", symbols_of(model), [ca.densify(ca.vec(model.world[:3, :]))])
    sigma = np.array([parameter.tolerance for parameter in machine.parameters])
    worst = 0.0
    with mpmath.workdps(40):
        h = mpmath.mpf(10) ** -12
        for row in range(2):
            z = [mpmath.mpf(float(v)) for v in predictor.z[row]]
            reading = [mpmath.mpf(float(v)) for v in q[row]]
            for _ in range(3):
                way = sigma * rng.uniform(-1, 1, len(p))
                ends = []
                for sign in (-1, 1):
                    moved = [
                        mpmath.mpf(float(a)) + sign * h * mpmath.mpf(float(b))
                        for a, b in zip(p, way, strict=True)
                    ]
                    closed = _closed(model, [reading, z, moved], x[row])
                    ends.append(run(world, [closed, reading, z, moved], DIGITS)[0])
                slope = (
                    np.array([float((b - a) / (2 * h)) for a, b in zip(*ends, strict=True)]).reshape(4, 3).T
                )
                spin = slope[:, :3] @ pose[row, :3, :3].T
                expected = np.array([*slope[:, 3], spin[2, 1], spin[0, 2], spin[1, 0]])
                exact = twists[row] @ way
                for part in (slice(0, 3), slice(3, 6)):
                    off = np.max(np.abs(exact - expected)[part]) / np.max(np.abs(expected[part]))
                    worst = max(worst, float(off))
    assert worst < 1e-12
