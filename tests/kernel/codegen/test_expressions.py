"""Laws of expressions on their way to C: what is shared, what is kept, and how lanes round."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from support.generated_c import needs_compiler
from support.lane_functions import compiled
from truepose.codegen.expressions import Graph
from truepose.codegen.printer import Real

X, P = ca.SX.sym("x", 3), ca.SX.sym("p", 2)


def test_a_graph_computes_what_its_functions_do() -> None:
    """Entries column by column, two functions in one graph."""
    one = ca.vertcat(ca.horzcat(X[0] * P[0], ca.sin(X[1])), ca.horzcat(ca.atan2(X[2], P[1]), X[0] - X[1]))
    two = ca.exp(P[0] * P[1]) / (1 + X[2] ** 2)
    graph = Graph(("p",))
    first, second = graph.add({"x": X, "p": P}, [one, two])
    (again,) = graph.add({"p": P, "x": X}, [one.T])
    assert again == [first[k] for k in (0, 2, 1, 3)]  # nothing new
    x, p = [0.3, -1.2, 2.5], [1.7, -0.4]
    expected = [np.array(v) for v in ca.Function("f", [X, P], [one, two])(x, p)]
    known = {"x": x, "p": p}
    np.testing.assert_allclose(graph.evaluate(first, known), expected[0].ravel(order="F"), rtol=1e-15)
    np.testing.assert_allclose(graph.evaluate(second, known), expected[1].ravel(), rtol=1e-15)
    assert graph.evaluate([graph.negative(first[0])], known) == [-x[0] * p[0]]


@needs_compiler
@pytest.mark.parametrize("real", ["double", "float"])
def test_rounding_in_lanes_is_exact_up_to_the_largest_fraction(tmp_path: Path, real: Real) -> None:
    """Numbers of a half, next to whole ones, and where whole numbers begin to be all there are."""
    kind = np.float64 if real == "double" else np.float32
    most = 2.0 ** (52 if real == "double" else 23)
    some = [
        0.0,
        0.3,
        0.5,
        1.0,
        1.5,
        2.5,
        1e3 + 0.5,
        most / 2 - 0.5,
        most / 2 + 0.5,
        most - 0.5,
        most,
        most + 1,
    ]
    whole = np.array([1.0, 2.0, 7.0], dtype=kind)
    x = np.concatenate([some, np.nextafter(whole, kind(0)), np.nextafter(whole, kind(9))])
    x = np.concatenate([x, -x]).astype(kind).astype(float)
    a, one = ca.SX.sym("a"), ca.SX.sym("p", 1)
    found = compiled(tmp_path, a, one, [ca.floor(a) * one, ca.ceil(a) * one], real, ())(
        x[:, None], np.ones(1)
    )
    np.testing.assert_array_equal(found, np.column_stack([np.floor(x), np.ceil(x)]))
