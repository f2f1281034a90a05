"""Expressions over several rows at once: every operation against CasADi, sine and cosine against many digits."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from support.examples import examples
from support.generated_c import needs_compiler
from support.lane_functions import TARGETS, Evaluate, compiled
from truepose.codegen.expressions import Graph
from truepose.codegen.lanes import LanePrinter
from truepose.codegen.printer import FARTHEST, Real

pytestmark = needs_compiler
mp: Any = import_module("mpmath")  # comes with sympy
Array = NDArray[np.float64]
REALS: tuple[Real, ...] = ("double", "float")
Q, P = ca.SX.sym("q", 3), ca.SX.sym("p", 2)


def operations(a: ca.SX, b: ca.SX) -> dict[str, ca.SX]:
    """Every operation that lanes know, of two numbers."""
    return {**arithmetic(a, b), **choices(a, b), **sines(a, b), **functions(a, b)}


def arithmetic(a: ca.SX, b: ca.SX) -> dict[str, ca.SX]:
    return {
        "add": a + b,
        "sub": a - b,
        "mul": a * b,
        "div": a / (1 + b * b),
        "neg": -a,
        "sq": a * a,
        "twice": 2 * a,
        "inv": 1 / (1 + a * a),
        "sqrt": ca.sqrt(1 + a * a),
        "fabs": ca.fabs(a),
        "copysign": ca.copysign(a, b),
        "fmod": ca.fmod(a, 2.5),
        "remainder": ca.remainder(a, 2.5),
        "hypot": ca.hypot(a, b),
    }


def choices(a: ca.SX, b: ca.SX) -> dict[str, ca.SX]:
    """Operations that compare or round."""
    return {
        "sign": ca.sign(a),
        "floor": ca.floor(a),
        "ceil": ca.ceil(a),
        "fmin": ca.fmin(a, b),
        "fmax": ca.fmax(a, b),
        "lt": a < b,
        "le": a <= b,
        "eq": a == b,
        "ne": a != b,
        "and": ca.logic_and(a > 0, b),
        "or": ca.logic_or(a > 0, b > 1),
        "not": ca.logic_not(a),
        "if": ca.if_else(a < b, a * b, 3.0),
    }


def sines(a: ca.SX, b: ca.SX) -> dict[str, ca.SX]:
    """Sines and cosines, alone and inside other operations."""
    return {
        "sin": ca.sin(a),
        "cos": ca.cos(b),
        "both": ca.sin(a + b) * ca.cos(a + b),
        "turned twice": ca.cos(ca.sin(a)),
        "size of a sine": ca.fabs(ca.sin(a)),
        "sine at most": ca.fmin(ca.sin(a), b),
        "sine and cosine in a call": ca.hypot(ca.sin(a), ca.cos(b)),
    }


def functions(a: ca.SX, b: ca.SX) -> dict[str, ca.SX]:
    """Other functions; arguments are kept where each is defined and smooth."""
    inside, positive = a / (1 + ca.fabs(a)), 1 + a * a
    return {
        "tan": ca.tan(inside),
        "asin": ca.asin(inside),
        "acos": ca.acos(inside),
        "atan": ca.atan(a),
        "atan2": ca.atan2(a, b),
        "exp": ca.exp(inside),
        "log": ca.log(positive),
        "pow": positive**inside,
        "constpow": positive**1.7,
        "sinh": ca.sinh(inside),
        "cosh": ca.cosh(inside),
        "tanh": ca.tanh(a),
        "asinh": ca.asinh(a),
        "acosh": ca.acosh(1 + positive),
        "atanh": ca.atanh(0.9 * inside),
        "erf": ca.erf(a),
        "log1p": ca.log1p(positive),
        "expm1": ca.expm1(inside),
    }


NAMES = list(operations(Q[0], Q[1]))
OUTPUTS = [ca.vertcat(*operations(x, y).values()) for x, y in ((Q[0], Q[1]), (Q[0], P[0]), (P[1], Q[2]))]
REFERENCE = ca.Function("reference", [Q, P], [ca.vertcat(*OUTPUTS)])
BREAKS = {"sign", "floor", "ceil", "lt", "le", "eq", "ne", "and", "or", "not", "if", "fmod", "remainder"}
"""Operations that jump: in single precision they may jump elsewhere."""


@pytest.fixture(scope="module", params=[(real, target) for real in REALS for target in TARGETS], ids=str)
def every(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> tuple[Real, Evaluate]:
    real, target = request.param
    where = tmp_path_factory.mktemp("lanes")
    return real, compiled(where, Q, P, OUTPUTS, real, TARGETS[target])


NUMBERS = st.one_of(
    st.floats(-50, 50, width=32), st.sampled_from([0.0, -0.0, 1.0, 2.0, -3.0, 0.5]), st.integers(-4, 4)
)
ROWS = st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=19)


@settings(max_examples=examples(60))
@given(rows=ROWS, shared=st.tuples(NUMBERS, NUMBERS))
def test_every_operation_is_that_of_casadi(
    every: tuple[Real, Evaluate], rows: list[tuple[float, ...]], shared: tuple[float, ...]
) -> None:
    real, evaluate = every
    q, p = np.array(rows, dtype=float), np.array(shared, dtype=float)
    expected = np.array([REFERENCE(row, p).full().ravel() for row in q])
    smooth = np.array([real == "double" or name not in BREAKS for name in NAMES * 3])
    # single precision: an argument of 2500 with half a unit in the last place moves a sine by 1e-4
    rtol, atol = (2e-14, 4e-14) if real == "double" else (2e-5, 3e-4)
    np.testing.assert_allclose(evaluate(q, p)[:, smooth], expected[:, smooth], rtol=rtol, atol=atol)


def test_what_is_no_number_stays_so(every: tuple[Real, Evaluate]) -> None:
    _, evaluate = every
    q = np.array([[np.nan, 1.0, 0.0], [np.inf, 1.0, 0.0], [1.0, np.nan, 0.0]])
    found = dict(zip(NAMES, evaluate(q, np.zeros(2)).T, strict=False))
    for name in ("add", "sqrt", "fabs", "floor", "ceil", "sin", "sign", "tan", "atan2"):
        assert np.isnan(found[name][0]), name
    assert np.isnan(found["sin"][1])
    assert found["fmin"][0] == found["fmax"][0] == 1.0  # as fmin and fmax of C: the number of the two
    assert found["fmin"][2] == found["fmax"][2] == 1.0


# -- sine and cosine ----------------------------------------------------------------------------------------------

RANGES = {"small": 1e-3, "about zero": 0.8, "a turn": 7.0, "many turns": 1e3, "as far as it goes": 1e5}
MOST_ULP = {"double": 1.0, "float": 1.0}
"""Measured: 0.77 and 0.73."""


@pytest.fixture(scope="module", params=[(r, t) for r in REALS for t in list(TARGETS)[:2]], ids=str)
def turns(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> tuple[Real, Evaluate]:
    real, target = request.param
    x = ca.SX.sym("x")
    where = tmp_path_factory.mktemp("turns")
    evaluate = compiled(where, x, Q[:1], [ca.sin(x), ca.cos(x), Q[0]], real, TARGETS[target])
    return real, lambda x, p: evaluate(x, p)[:, :2]


def off(real: Real, x: Array, found: Array) -> tuple[float, float]:
    """Largest error of sine and cosine (n, 2) at x (n,): in units in the last place, and absolute."""
    kind = np.float64 if real == "double" else np.float32
    ulps, size = 0.0, 0.0
    with mp.workdps(50):
        for value, pair in zip(x, found, strict=True):
            for got, exact in zip(pair, (mp.sin(mp.mpf(value)), mp.cos(mp.mpf(value))), strict=True):
                error = abs(mp.mpf(got) - exact)
                unit = np.spacing(kind(abs(float(exact))))
                ulps, size = max(ulps, float(error / mp.mpf(float(unit)))), max(size, float(error))
    return ulps, size


@pytest.mark.parametrize("most", RANGES.values(), ids=RANGES)
def test_sine_and_cosine_are_right_to_the_last_place(turns: tuple[Real, Evaluate], most: float) -> None:
    real, evaluate = turns
    x = np.random.default_rng(3).uniform(-most, most, 700).astype(np.float32).astype(float)
    if real == "double":
        x *= 1 + 1e-9
    assert off(real, x, evaluate(x[:, None], np.zeros(1)))[0] < MOST_ULP[real]


def test_next_to_multiples_of_a_quarter_turn(turns: tuple[Real, Evaluate]) -> None:
    """Where most digits cancel: in double precision all remain, in single those that are above 1e-12."""
    real, evaluate = turns
    kind = np.float64 if real == "double" else np.float32
    count = np.unique(np.geomspace(1, FARTHEST[real] / 1.6, 400).astype(int))
    x = np.concatenate([kind(np.pi / 2 * count), -kind(np.pi / 2 * count)]).astype(float)
    ulps, size = off(real, x, evaluate(x[:, None], np.zeros(1)))
    assert ulps < MOST_ULP["double"] if real == "double" else size < 6e-8


def test_far_away_by_the_c_library(turns: tuple[Real, Evaluate]) -> None:
    real, evaluate = turns
    x = np.array([1.5e5, -3e7, 2e9, 1.0, 1e22 if real == "double" else 1e18])
    found = evaluate(x[:, None], np.zeros(1))
    x = x if real == "double" else x.astype(np.float32).astype(float)
    assert off(real, x, found)[0] < 1.0
    assert not np.isfinite(evaluate(np.array([[np.inf], [np.nan]]), np.zeros(1))).any()


# -- printing -----------------------------------------------------------------------------------------------------


def test_an_operation_that_lanes_have_not_is_named() -> None:
    graph = Graph()
    (ends,) = graph.add({"x": Q}, [ca.erfinv(Q[0])])
    with pytest.raises(NotImplementedError, match="ERFINV"):
        LanePrinter(graph, "double", ()).statements([("y[0]", ends[0])])


def test_no_row_sees_another(every: tuple[Real, Evaluate]) -> None:
    """The same bits wherever a row stands, and beside whatever it stands."""
    _, evaluate = every
    rng = np.random.default_rng(2)
    q, p = rng.normal(0, 3, (37, 3)), rng.normal(0, 3, 2)
    q[5], q[11], q[20, 0] = np.nan, np.inf, 3e6
    order = rng.permutation(len(q))
    together = evaluate(q, p)
    np.testing.assert_array_equal(evaluate(q[order], p), together[order])
    np.testing.assert_array_equal(np.concatenate([evaluate(row[None], p) for row in q]), together)
