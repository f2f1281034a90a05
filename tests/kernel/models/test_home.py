"""Where closed loops start: next to the home that a file gives, also where Newton's method does not get away from it."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from truepose.models.machine.closure import CoordinateScale, closed_home


def closure(x: ca.SX, equations: ca.SX) -> ca.Function:
    """Equations, their Jacobian and gaps, as a machine's loops give them."""
    return ca.Function("closure", [x], [equations, ca.densify(ca.jacobian(equations, x)), equations])


def scale(*size: float, moved: tuple[bool, ...] = ()) -> CoordinateScale:
    moved = moved or (True,) * len(size)
    limit = np.where(moved, 0.2 * np.array(size), np.inf)
    return CoordinateScale(np.array(size), limit, np.inf)


X = ca.SX.sym("x")


@pytest.mark.parametrize(("given", "found"), [(0.9, 1.0), (-1.9, -2.0), (2.0, 1.0)])
def test_the_next_assembly_is_taken(given: float, found: float) -> None:
    home = closed_home(closure(X, (X - 1.0) * (X + 2.0)), np.array([given]), scale(1.0))
    assert home is not None and home[0] == pytest.approx(found, abs=1e-9)


def test_without_unknowns_home_is_what_was_given() -> None:
    nothing = ca.SX.sym("x", 0)
    home = closed_home(closure(nothing, ca.SX(0, 1)), np.zeros(0), scale())
    assert home is not None and home.shape == (0,)


@pytest.mark.parametrize("size", [1.0, 100.0])
def test_from_a_singular_home_the_nearest_assembly_is_found(size: float) -> None:
    """x^3 - 3 x + 1 is level at 1; its zeros are at 1.53, 0.35 and -1.88. In every unit the same one is taken."""
    x = X / size
    home = closed_home(closure(X, x**3 - 3 * x + 1), np.array([size]), scale(size))
    assert home is not None and home[0] / size == pytest.approx(1.5320888862, abs=1e-9)


def test_starts_go_as_far_as_a_reach_and_no_further() -> None:
    """Level on both sides: only starts further away see a slope."""
    near = ca.if_else(ca.fabs(X) < 0.7, 1.0, X - 1.0)
    home = closed_home(closure(X, near), np.zeros(1), scale(1.0))
    assert home is not None and home[0] == pytest.approx(1.0)
    far = ca.if_else(ca.fabs(X) < 1.2, 1.0, X - 1.3)
    assert closed_home(closure(X, far), np.zeros(1), scale(1.0)) is None


def test_what_never_closes_has_no_home() -> None:
    assert closed_home(closure(X, 1.0 + 0.0 * X), np.array([0.0]), scale(1.0)) is None


def test_forces_start_where_they_are_and_count_for_no_distance() -> None:
    """An unknown without a largest step is no coordinate: of two assemblies the one that is nearer in coordinates is taken,
    whatever force it needs."""
    both = ca.SX.sym("x", 2)
    x, force = both[0], both[1]
    equations = ca.vertcat(x**3 - 3 * x + 1, force - 1e4 * (x - 0.3473) ** 2)
    home = closed_home(closure(both, equations), np.array([1.0, 0.0]), scale(1.0, 1.0, moved=(True, False)))
    assert home is not None and home[0] == pytest.approx(1.5320888862, abs=1e-9)
    assert home[1] == pytest.approx(1e4 * (home[0] - 0.3473) ** 2)
