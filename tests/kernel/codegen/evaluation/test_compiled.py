"""Batches compiled to C: the same numbers as the virtual machine's, a cache that can be trusted, and no compiler at all."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from support.built_machines import TEXTS, manufactured, read_machines, simulated
from support.engines import compile_all, compile_none
from support.examples import by_day, examples
from support.generated_c import needs_compiler
from truepose.codegen.evaluation import batch, compiled
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.identification.fit.calibrate import calibrate

Array = NDArray[np.float64]


@pytest.fixture(autouse=True)
def _all_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    compile_all(monkeypatch)


def example(name: str = "example") -> BatchFunction:
    """Two inputs of each row, one that may be shared, an empty one; outputs of several shapes."""
    q, z, p, none = ca.SX.sym("q", 3), ca.SX.sym("z", 1), ca.SX.sym("p", 2), ca.SX.sym("n", 0)
    turn = ca.vertcat(ca.sin(q[0] + p[0]), ca.cos(q[1]) * ca.exp(p[1]), ca.atan2(q[2], z))
    outputs = [turn @ turn.T, ca.jacobian(turn, ca.vertcat(q, p)), ca.SX(2, 0), ca.sqrt(p[0] ** 2 + z**2)]
    return BatchFunction(name, [q, z, p, none], outputs, rows=1)


def inputs(n: int, seed: int = 1) -> tuple[Array, Array, Array, Array]:
    rng = np.random.default_rng(seed)
    return rng.normal(0, 2, (n, 3)), rng.normal(0, 2, (n, 1)), rng.normal(0, 1, 2), np.zeros((n, 0))


@needs_compiler
@pytest.mark.parametrize("n", [1, 2, 7, 8, 9, 100])
@pytest.mark.parametrize("shared", [True, False])
def test_the_virtual_machine_says_the_same(monkeypatch: pytest.MonkeyPatch, n: int, shared: bool) -> None:
    q, z, p, none = inputs(n)
    given = (q, z, p if shared else np.tile(p, (n, 1)), none)
    fast = example()
    found = fast(*given)
    assert fast.engine.compiled
    compile_none(monkeypatch)
    slow = example()
    expected = slow(*given)
    assert not slow.engine.compiled and not slow.engine.missed
    for one, other in zip(found, expected, strict=True):
        assert one.shape == other.shape and one.strides == other.strides
        np.testing.assert_allclose(one, other, rtol=1e-14, atol=1e-15)


@needs_compiler
def test_rows_may_be_shared_and_one_may_stand_for_all() -> None:
    q, z, p, none = inputs(5)
    function = example()
    for one, other in zip(function(q, z[:1], p, none), function(q, z[0], p, none), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-14, atol=1e-15)
    assert function(q[0], z[0], p, none[0])[0].shape == (1, 3, 3)


@needs_compiler
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(25))
@given(data=st.data())
def test_neither_order_nor_chunks_matter(data: st.DataObject) -> None:
    """Not to a single bit: a row does not know its place."""
    function, (q, z, p, none) = example(), inputs(41)
    whole = function(q, z, p, none)
    order = np.array(data.draw(st.permutations(range(41))))
    cut = data.draw(st.integers(0, 41))
    for some in (order, order[:cut], order[cut:]):
        for part, all_rows in zip(function(q[some], z[some], p, none[some]), whole, strict=True):
            np.testing.assert_array_equal(part, all_rows[some])


@needs_compiler
def test_a_long_function_in_many_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Values that one part leaves to another, of rows and of what they share, among them sines with their cosines."""
    x, p = ca.SX.sym("x", 4), ca.SX.sym("p", 3)
    value, shared, ends = ca.vertcat(x), ca.vertcat(p), []
    for k in range(12):
        shared = ca.vertcat(ca.sin(shared[1]), shared[2] * shared[0], ca.cos(shared[0]) + 0.1 * k)
        value = ca.vertcat(
            ca.sin(value[1]) + shared[0], ca.cos(value[1]) * value[3], value[0] / 2, value[2] - shared[2]
        )
        ends.append(value)
    rng = np.random.default_rng(3)
    given = rng.normal(0, 1, (20, 4)), rng.normal(0, 1, 3)
    expected = BatchFunction("long", [x, p], [ca.vertcat(*ends)])(*given)[0]
    for length in (1, 2, 5, 17, 1000):
        monkeypatch.setattr(batch, "LENGTH", length)
        function = BatchFunction("long", [x, p], [ca.vertcat(*ends)], rows=1)
        np.testing.assert_allclose(function(*given)[0], expected, rtol=1e-12, atol=1e-13)
        assert function.engine.compiled


def test_few_rows_are_not_worth_a_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    x = ca.SX.sym("x")
    small = BatchFunction("small", [x], [ca.sin(x)], rows=batch.FEWEST_ROWS)
    unknown = BatchFunction("unknown", [x], [ca.sin(x)])
    for function in (small, unknown):
        function(np.zeros((3, 1)))
        assert not function.engine.compiled


# -- the cache ----------------------------------------------------------------------------------------------------


def refuse(*args: object) -> None:
    raise AssertionError("compiled again")


@needs_compiler
def test_what_was_compiled_once_is_not_compiled_again(monkeypatch: pytest.MonkeyPatch) -> None:
    first = example("one")(*inputs(9))
    monkeypatch.setattr(compiled, "_build", refuse)
    function = example("another_name")
    for one, other in zip(first, function(*inputs(9)), strict=True):
        np.testing.assert_array_equal(one, other)
    assert function.engine.compiled


# -- without a compiler -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("setting", ["", "no-such-compiler", sys.executable])
def test_without_a_compiler_the_virtual_machine_says_so(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, setting: str
) -> None:
    """An empty setting, a program that is not there, one that is no compiler: the numbers come all the same."""
    batch.log_once.cache_clear()
    monkeypatch.setenv("TRUEPOSE_CC", setting)
    with caplog.at_level(logging.WARNING):
        functions = [example(), example()]
        results = [function(*inputs(9)) for function in functions]
    compile_none(monkeypatch)
    for found in results:
        for one, other in zip(found, example()(*inputs(9)), strict=True):
            np.testing.assert_array_equal(one, other)
    for function in functions:
        assert function.engine.missed
    (record,) = caplog.records  # once, not for each function
    assert "virtual machine" in record.getMessage()
    assert {"": "TRUEPOSE_CC is empty"}.get(setting, setting) in record.getMessage()


@pytest.mark.parametrize("expression", ["operation", "constant"])
def test_what_c_cannot_say_is_left_to_the_virtual_machine(expression: str) -> None:
    x = ca.SX.sym("x")
    value = ca.erfinv(x) if expression == "operation" else ca.if_else(x > 1, ca.SX.inf(), x)
    function = BatchFunction("odd", [x], [value], rows=1)
    assert np.isfinite(function(np.full((3, 1), 0.25))[0]).all()
    assert function.engine.missed


# -- a whole calibration ------------------------------------------------------------------------------------------


@needs_compiler
@pytest.mark.parametrize("name", by_day(TEXTS, "arm"))
def test_a_calibration_is_the_same_by_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    machine, rng = read_machines(tmp_path)[name], np.random.default_rng(6)
    recording = simulated(machine, manufactured(machine, rng), rng)
    fast = calibrate(machine, recording)
    compile_none(monkeypatch)
    slow = calibrate(machine, recording)
    # parts of the parameter, of 1 mm or 1 rad where it is smaller: poses of 500 mm round by 1e-13 mm
    np.testing.assert_allclose(fast.fit.p, slow.fit.p, rtol=1e-12, atol=1e-12)
    assert fast.fit.chi2 == pytest.approx(slow.fit.chi2, rel=1e-11)  # tolerances pull: it is not stationary
    np.testing.assert_allclose(fast.fit.std, slow.fit.std, rtol=1e-9)
    assert fast.notes == slow.notes
