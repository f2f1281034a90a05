"""Expressions as the C that is printed of them; elimination, names and words beside it. No compiler is needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from truepose.codegen.blocks import rolled
from truepose.codegen.expressions import Graph
from truepose.codegen.features import ALL, Features
from truepose.codegen.left_out import LeftOut, left_out_json, left_out_words
from truepose.codegen.loops import Pivots, factors_of
from truepose.codegen.printer import Printer, Real, literal
from truepose.codegen.pruning import pruned
from truepose.codegen.texts import c_string, code_span, comment, identifiers, markdown, python_string
from truepose.errors import InputError
from truepose.models.task import Task

A, B = ca.SX.sym("a"), ca.SX.sym("b")
Made = Callable[[ca.SX, ca.SX], ca.SX]
PRINTED: dict[str, tuple[Made, str]] = {
    "sum": (lambda a, b: a + b, "x[0] + y[0]"),
    "difference": (lambda a, b: a - b, "x[0] - y[0]"),
    "product": (lambda a, b: a * b, "x[0] * y[0]"),
    "quotient": (lambda a, b: a / b, "x[0] / y[0]"),
    "brackets": (lambda a, b: (a + b) * (a - b), "(x[0] + y[0]) * (x[0] - y[0])"),
    "minus": (lambda a, b: -a, "-x[0]"),
    "square": (lambda a, b: a**2, "x[0] * x[0]"),
    "twice": (lambda a, b: 2 * a, "2.0 * x[0]"),
    "inverse": (lambda a, b: 1 / a, "1.0 / x[0]"),
    "a negative number": (lambda a, b: a - (-3.5), "x[0] - (-3.5)"),
    "not": (lambda a, b: ca.logic_not(a), "(x[0] == 0.0) ? 1.0 : 0.0"),
    "sign": (lambda a, b: ca.sign(a), "(real)((x[0] > 0.0) - (x[0] < 0.0))"),
    "if": (lambda a, b: ca.if_else(a, b, 0), "(x[0] != 0.0) ? y[0] : 0.0"),
    "less": (lambda a, b: a < b, "(x[0] < y[0]) ? 1.0 : 0.0"),
    "at most": (lambda a, b: a <= b, "(x[0] <= y[0]) ? 1.0 : 0.0"),
    "equal": (ca.eq, "(x[0] == y[0]) ? 1.0 : 0.0"),
    "and": (ca.logic_and, "((x[0] != 0.0) && (y[0] != 0.0)) ? 1.0 : 0.0"),
    "or": (ca.logic_or, "((x[0] != 0.0) || (y[0] != 0.0)) ? 1.0 : 0.0"),
    "root": (lambda a, b: ca.sqrt(a + b), "sqrt(x[0] + y[0])"),
    "two arguments": (lambda a, b: ca.atan2(a, b + 1), "atan2(x[0], y[0] + 1.0)"),
    "power": (lambda a, b: a**2.5, "pow(x[0], 2.5)"),
    "least": (ca.fmin, "fmin(x[0], y[0])"),
}


def printed(expression: ca.SX, real: Real = "double", own: dict[str, str] | None = None) -> list[str]:
    graph = Graph()
    ((node,),) = graph.add({"x": A, "y": B}, [expression])
    return Printer(graph, real, own=own).statements([("r", node)])


@pytest.mark.parametrize("case", PRINTED)
def test_an_operation_is_written_as_c_has_it(case: str) -> None:
    made, text = PRINTED[case]
    assert printed(made(A, B)) == [f"r = {text};"]


def test_single_precision_has_its_own_numbers_and_functions() -> None:
    assert printed(ca.exp(0.1 * A) + 2.0, "float") == ["r = expf(0.1f * x[0]) + 2.0f;"] or printed(
        ca.exp(0.1 * A) + 2.0, "float"
    ) == ["r = 2.0f + expf(0.1f * x[0]);"]
    assert printed(ca.atan2(A, B), own={"ATAN2": "arctan"}) == ["r = arctan(x[0], y[0]);"]
    assert [literal(v, "float") for v in (1e20, 3.0, 1 / 3)] == ["1e+20f", "3.0f", "0.33333334f"]
    assert literal(1e20, "double") == "1e+20"
    for value in (np.inf, np.nan):
        with pytest.raises(ValueError, match="expected a finite number"):
            literal(value, "double")


def test_what_is_read_twice_has_a_name_and_what_is_read_once_has_none() -> None:
    """A square reads its argument twice, and so does a sign."""
    shared = ca.exp(A)
    assert printed(shared * B + shared) == ["const real a0 = exp(x[0]);", "r = a0 + (a0 * y[0]);"] or printed(
        shared * B + shared
    ) == ["const real a0 = exp(x[0]);", "r = (a0 * y[0]) + a0;"]
    assert printed(ca.exp(A) ** 2) == ["const real a0 = exp(x[0]);", "r = a0 * a0;"]
    assert printed(ca.sign(ca.exp(A)))[0] == "const real a0 = exp(x[0]);"
    assert len(printed(ca.exp(A) + B)) == 1
    long = A
    for _ in range(7):
        long = ca.exp(long)
    assert max(map(len, printed(long))) < 56 + len("const real a0 = ;") + len("exp()")


def test_sine_and_cosine_of_an_angle_are_one_call() -> None:
    lines = printed(ca.sin(A) * ca.cos(A) + ca.sin(B))
    assert [line for line in lines if "sin_cos" in line] == [
        "sin_cos(x[0], &s0, &c0);",
        "sin_cos(y[0], &s2, &c2);",
    ]
    assert lines[-1].count("s0 * c0") + lines[-1].count("c0 * s0") == 1


def test_what_is_given_is_read_from_its_place() -> None:
    graph = Graph()
    ((node, inner),) = graph.add({"x": A, "y": B}, [ca.vertcat(ca.exp(A) + B, ca.exp(A))])
    assert Printer(graph, "double", {inner: "k[0]"}).statements([("r", node)]) == [
        "r = y[0] + k[0];"
    ] or Printer(graph, "double", {inner: "k[0]"}).statements([("r", node)]) == ["r = k[0] + y[0];"]


def test_elimination_fills_what_it_must() -> None:
    """A ring has no zero to keep: entries that were none come about, and are worth what elimination makes of them."""
    n, rng = 5, np.random.default_rng(1)
    pattern = (
        np.eye(n, dtype=bool)
        | np.roll(np.eye(n, dtype=bool), 1, axis=0)
        | np.roll(np.eye(n, dtype=bool), 1, axis=1)
    )
    samples = np.where(pattern, rng.uniform(1.0, 2.0, (4, n, n)), 0.0) + 4.0 * np.eye(n)
    own, matrix = ca.SX.sym("m", int(pattern.sum())), ca.SX(n, n)
    for k, (i, j) in enumerate(np.argwhere(pattern)):
        matrix[int(i), int(j)] = own[k]
    found = factors_of(matrix, Pivots.of(samples, pattern.astype(float)))
    values = ca.Function("f", [own], [found.values])
    solve = ca.Function("s", [own, found.symbols, found.right], [found.solution])
    for sample in samples:
        x = np.asarray(solve(sample[pattern], values(sample[pattern]), np.ones(n))).ravel()
        np.testing.assert_allclose(x, np.linalg.solve(sample, np.ones(n)), rtol=1e-12)


@pytest.mark.parametrize("n", [1, 3, 6])
def test_elimination_solves_a_sparse_system(n: int) -> None:
    """With few products: a matrix that is an arrow fills up only if its tip is taken first."""
    rng = np.random.default_rng(n)
    pattern = np.eye(n, dtype=bool)
    pattern[0], pattern[:, 0] = True, True
    samples = np.where(pattern, rng.uniform(1.0, 2.0, (5, n, n)), 0.0) + 3.0 * np.eye(n)
    pivots = Pivots.of(samples, pattern)
    assert sorted(i for i, _ in pivots.order) == sorted(j for _, j in pivots.order) == list(range(n))
    assert n == 1 or pivots.order[0] != (0, 0)
    own = ca.SX.sym("m", int(pattern.sum()))
    matrix, places = ca.SX(n, n), np.argwhere(pattern)
    for k, (i, j) in enumerate(places):
        matrix[int(i), int(j)] = own[k]
    found = factors_of(matrix, pivots)
    assert found.size == n and found.values.shape == found.symbols.shape
    # an inverse for each unknown, a multiplier beside the tip, and what the tip and the last one become; no more
    assert found.values.numel() <= 2 * n + 1
    values = ca.Function("f", [own], [found.values])
    solve = ca.Function("s", [own, found.symbols, found.right], [found.solution])
    for sample in samples:
        entries, right = sample[pattern], rng.normal(size=n)
        x = np.asarray(solve(entries, values(entries), right)).ravel()
        np.testing.assert_allclose(x, np.linalg.solve(sample, right), rtol=1e-12)


def test_a_pivot_is_large_in_every_sample() -> None:
    """One that vanishes in a single sample is none, however few products it would take."""
    samples = np.array([[[1.0, 1.0], [1.0, 0.0]], [[1.0, 1.0], [1.0, 0.04]], [[1.0, 1.0], [1.0, 5.0]]])
    assert Pivots.of(samples, np.ones((2, 2), dtype=bool)).order[0] != (1, 1)
    diagonal = np.array([np.diag([2.0, 8.0]), np.diag([4.0, 8.0]), np.diag([6.0, 8.0])])
    found = Pivots.of(diagonal, np.eye(2, dtype=bool))
    assert dict(zip(found.order, found.sizes.tolist(), strict=True)) == {(0, 0): 4.0, (1, 1): 8.0}


def test_identifiers_that_would_collide_are_counted() -> None:
    assert identifiers(["a.b", "a-b", "a_b", "a b_2", "c"]) == ["a_b", "a_b_3", "a_b_4", "a_b_2", "c"]


def test_names_are_quoted_for_their_place() -> None:
    assert comment("a \n b*/ /* ??/ \u00e4\U0001f600\\\\") == "a b* / / * ? ?/ \\u00e4\\U0001f600"
    assert c_string('a"\\\x7f ??/1') == '"a\\042\\134\\177 ?\\?/1"'
    assert python_string('a"\\\n~') == '"a\\"\\\\\\u000a~"'
    assert markdown("a_b _c `<&*[x]|\u00e4\x9f") == "a_b \\_c \\`&lt;&amp;\\*\\[x\\]\\|\u00e4\\\\u009f"
    assert [code_span(t) for t in ("a b", " a", "", "a`", "a\n")] == ["`a b`", " a", "", "a\\`", "a "]


def test_features_are_told_in_their_order() -> None:
    assert ALL.names == ("warm", "cold", "branches", "p", "batch", "state") and not ALL.listed
    found = Features.of(" p,warm ")
    assert found == Features(False, False, True, False, False, listed=True) and found.names == ("warm", "p")
    with pytest.raises(
        InputError, match=r"features: found 'stat', expected .*commas; did you mean 'state'\?"
    ):
        Features.of("warm,stat")
    with pytest.raises(InputError, match=r"found '', expected .* separated by commas$"):
        Features.of("warm,")


NOTHING = LeftOut(False, False, (), (), (), {})


def test_what_the_c_holds_and_leaves_out_is_said_in_sentences() -> None:
    (plain,) = left_out_words(NOTHING)
    assert (
        plain
        == "The machine file was not calibrated: the code has the drawing's constants and corrects nothing."
    )
    assert left_out_words(replace(NOTHING, stated=True))[0].endswith(
        "constants and the effects that the file states."
    )
    drivers = {"payload": (2.5, "kg"), "approach.q1": (0.0, "1"), "temperature.air": (20.0, "degC")}
    whole = LeftOut(True, True, ("a", "b"), ("c",), ("d", "e"), drivers, ("approach.q1",))
    assert left_out_words(whole) == [
        "The machine file was calibrated: without p the code has its values.",
        "Left out, because it moves no tool: a and b.",
        "Memory is left out: c depends on what was before, which the code does not follow; the controller gives its state in z,"
        " else it rests.",
        "Poses are those of the tool on the flange; the code has no other frame (d and e).",
        "Depends on what was before: approach.q1. The code's _state works it out from every motion and what is sensed; without"
        " it, it rests.",
        "Held still unless z gives it: payload at 2.5 kg and temperature.air at 20 degC.",
    ]
    rests = replace(NOTHING, drivers={"approach.q1": (0.0, "1")})
    assert left_out_words(rests)[-1] == "Held still unless z gives it: approach.q1 at 0."
    late = replace(NOTHING, drivers={"time": (1764000060.0, "s")})
    assert left_out_words(late)[-1] == "Held still unless z gives it: time at 1764000060 s."
    pointing = left_out_words(replace(NOTHING, task=Task(("x", "axis"))))
    assert pointing[1].startswith(
        "Of a pose ik and compensate meet x of the tool's position along axes of the base and the dir"
    )
    assert left_out_json(whole) == {
        "sensor": ["a", "b"],
        "memory": ["c"],
        "frames": ["d", "e"],
        "drivers": {name: {"value": value, "unit": unit} for name, (value, unit) in drivers.items()},
        "followed": ["approach.q1"],
    }


def test_blocks_that_fill_even_places_become_a_loop() -> None:
    """Of two on; each reads its own part of p, and what reads none needs no table of parts."""

    def block(first: int, step: int, text: str = "const real a = p[{0}] + p[{1}];") -> list[str]:
        return ["{", f"    {text.format(first, first + 2)}", f"    tilt_of(F, k + {step});", "}"]

    alone = block(3, 8)
    assert rolled([alone]) == alone
    assert rolled([block(3, 8), block(10, 12), block(11, 16)]) == [
        "{",
        "    static const unsigned short first[3] = { 3, 10, 11 };",
        "    int i;",
        "    for (i = 0; i < 3; ++i) {",
        "        const real *a = p + first[i];",
        "        const real a = a[0] + a[2];",
        "        tilt_of(F, k + 8 + 4 * i);",
        "    }",
        "}",
    ]
    still = [block(0, 8, "const real a = 1.0;"), block(0, 12, "const real a = 1.0;")]
    assert not any("first" in line or "*a" in line for line in rolled(still)) and len(rolled(still)) == 7
    other = block(3, 12, "const real a = p[{0}] - p[{1}];")
    assert rolled([alone, other]) == [*alone, *other]


FILE = """/* what it is */
#include <math.h>
#define USED 3
#define UNUSED 4
#define TWO(a) \\
    (2 * (a))

typedef struct {
    int n;
} kept_type;

typedef double lost_type;

#if defined(LOST)
static int sometimes(void)
{
    return UNUSED;
}
#endif

static const int table[USED] = { 1, 2, 3 };

/* ---- a part that goes ---- */

/* of a function that goes */
static int lost(int a)
{
    return helper(a);
}
/* ---- a part that stays ---- */

static int helper(int a)
{
    return a + table[0];
}

int m_fk(kept_type *m)
{
    return helper(m->n);
}
"""


def test_what_the_interface_does_not_come_to_use_is_left_out() -> None:
    """With its comment, the heading of a part that is empty, and conditions around nothing."""
    text = pruned(FILE, "m")
    for gone in ("UNUSED", "TWO", "lost_type", "lost", "a part that goes", "defined(LOST)", "#endif"):
        assert gone not in text, gone
    for kept in (
        "what it is",
        "#include <math.h>",
        "USED 3",
        "kept_type",
        "table[USED]",
        "a part that stays",
        "helper",
    ):
        assert kept in text, kept
    assert "\n\n\n" not in text and text.endswith("}\n") and pruned(text, "m") == text
    assert "m_fk" not in pruned(FILE, "other") and "main" in pruned(
        "int main(void)\n{\n    return 0;\n}\n", "m"
    )
