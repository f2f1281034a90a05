"""Sums over rows of w [J r]'[J r]: those of the rows written out, by both engines, in memory that does not grow."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from support.engines import compile_all, compile_none
from support.generated_c import needs_compiler
from truepose.codegen.evaluation import gram
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.codegen.evaluation.gram import GramFunction

Array = NDArray[np.float64]
ENGINES = [pytest.param("compiled", marks=needs_compiler), "virtual machine"]


@pytest.fixture(params=ENGINES)
def engine(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Each engine in turn."""
    name: str = request.param
    if name == "compiled":
        compile_all(monkeypatch)
    else:
        compile_none(monkeypatch)
    return name


def problem(m: int, n: int, seed: int) -> tuple[list[ca.SX], ca.SX, ca.SX]:
    """Inputs, r (m,) and J (m, n) with zeros where many a Jacobian has them."""
    rng = np.random.default_rng(seed)
    q, y, p = ca.SX.sym("q", 4), ca.SX.sym("y", m), ca.SX.sym("p", n)
    weights = [rng.normal(0, 1, n) * (rng.uniform(size=n) < 0.6) for _ in range(m)]
    rows = [ca.sin(ca.dot(ca.DM(w), p) + q[k % 4]) + 0.1 * q[(k + 1) % 4] for k, w in enumerate(weights)]
    predicted = ca.vertcat(*rows)
    return [q, y, p], predicted - y, ca.jacobian(predicted, p)


def inputs(m: int, n: int, rows: int, seed: int = 1) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    return rng.normal(0, 1, (rows, 4)), rng.normal(0, 1, (rows, m)), rng.normal(0, 1, n)


def written_out(given: tuple[Array, ...], m: int, n: int, seed: int, weight: Array | None = None) -> Array:
    """The same sums from all rows side by side."""
    symbols, residual, jacobian = problem(m, n, seed)
    stacked = BatchFunction("rows", symbols, [ca.horzcat(jacobian, residual)])(*given)[0]
    root = np.ones(len(stacked)) if weight is None else np.sqrt(weight)
    flat = (stacked * root[:, None, None]).reshape(-1, n + 1)
    return np.asarray(flat.T @ flat)


@pytest.mark.parametrize(("m", "n"), [(1, 1), (6, 30), (7, 12)])
@pytest.mark.parametrize("rows", [1, 7, 8, 33])
def test_the_sums_are_those_of_the_rows(engine: str, m: int, n: int, rows: int) -> None:
    symbols, residual, jacobian = problem(m, n, m + n)
    function, given = GramFunction("f", symbols, residual, jacobian, rows=1), inputs(m, n, rows)
    found, expected = function(*given), written_out(given, m, n, m + n)
    assert function.engine.compiled == (engine == "compiled")
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected))) + 1e-300
    np.testing.assert_allclose(found / size, expected / size, atol=1e-13)
    np.testing.assert_array_equal(found, found.T)


def test_weights_count_rows(engine: str) -> None:
    """A weight of two is the row twice, one of zero is no row, whatever is in it."""
    m, n, rows = 6, 9, 45
    function = GramFunction("f", *problem(m, n, 2), rows=1)
    q, y, p = inputs(m, n, rows)
    weight = np.random.default_rng(4).integers(0, 3, rows).astype(float)
    expected = written_out((q, y, p), m, n, 2, weight)
    q[weight == 0], y[weight == 0] = np.nan, np.inf
    again = np.repeat(np.arange(rows), weight.astype(int))
    for found in (function(q, y, p, weight=weight), function(q[again], y[again], p)):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(function(q, y, p, weight=np.zeros(rows)), 0.0)


def test_pieces_add_up(engine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    m, n = 3, 6
    function, given = GramFunction("f", *problem(m, n, 2), rows=1), inputs(m, n, 200)
    whole = function(*given)
    np.testing.assert_array_equal(function(*given), whole)  # and to the bit when asked again
    q, y, p = given
    pieces = function(q[:77], y[:77], p) + function(q[77:], y[77:], p)
    np.testing.assert_allclose(pieces, whole, rtol=1e-12, atol=1e-12)
    monkeypatch.setattr(gram, "CHUNK", 13)
    np.testing.assert_allclose(function(*given), whole, rtol=1e-12, atol=1e-12)


@needs_compiler
def test_both_engines_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    m, n = 6, 30
    given, found = inputs(m, n, 100), []
    for compiled in (True, False):
        compile_all(monkeypatch) if compiled else compile_none(monkeypatch)
        found.append(GramFunction("f", *problem(m, n, 2), rows=1)(*given))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12, atol=1e-11)
