"""Laws of work on large matrices: it is what scipy's is, and the same digits however many threads there are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_triangular

from truepose.identification.posterior.halves import solve_large
from truepose.threads import VARIABLE


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 60), st.integers(1, 90), st.integers(0, 2**32 - 1))
def test_a_triangular_factor_is_solved_as_scipy_does(rows: int, columns: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    factor = np.tril(rng.standard_normal((rows, rows))) + rows * np.eye(rows)
    right = rng.standard_normal((rows, columns))
    before, expected = right.copy(), solve_triangular(factor, right, lower=True)
    for given_as in (factor, np.asfortranarray(factor)):
        found = solve_large(given_as, right)
        assert np.allclose(found, expected, rtol=1e-12, atol=1e-15)
    assert np.array_equal(right, before) and found.flags.c_contiguous


def test_digits_do_not_depend_on_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    factor = np.tril(rng.standard_normal((200, 200))) + 200.0 * np.eye(200)
    right, found = rng.standard_normal((200, 333)), []
    for threads in ("1", "3"):
        monkeypatch.setenv(VARIABLE, threads)
        found.append(solve_large(factor, right))
    assert np.array_equal(found[0], found[1])
