"""Laws of expressions on their way to C: what is shared, what is kept, and how lanes round."""

from __future__ import annotations

import casadi as ca
import numpy as np

from truepose.codegen.expressions import Graph

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
