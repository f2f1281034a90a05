"""States that follow row by row are those of a plain loop over the rows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truepose.identification.recording.history import affine, clipped

ROWS = st.integers(1, 70)
SEEDS = st.integers(0, 2**32 - 1)


@given(ROWS, SEEDS)
def test_affine_steps_follow_each_other(rows: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    factor, added, state = rng.uniform(-1, 1, rows), rng.normal(size=rows), float(rng.normal())
    found, wanted = affine(factor, added, state), []
    for f, c in zip(factor, added, strict=True):
        wanted.append(state := f * state + c)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-13 * rows)


@given(ROWS, SEEDS, st.floats(0.01, 2.0))
def test_clipped_steps_follow_each_other_and_begin_anew(rows: int, seed: int, limit: float) -> None:
    rng = np.random.default_rng(seed)
    first, second = rng.normal(size=(2, rows)) * rng.integers(0, 2, (2, rows))
    begins = np.where(rng.uniform(size=rows) < 0.1, rng.uniform(-limit, limit, rows), np.nan)
    found, state, wanted = clipped((first, second), begins, limit), 0.0, []
    for a, b, new in zip(first, second, begins, strict=True):
        state = min(max(state + a, -limit), limit)
        state = min(max(state + b, -limit), limit)
        state = state if np.isnan(new) else float(new)
        wanted.append(state)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-13 * rows)


def test_a_million_rows_take_as_many_steps_as_a_thousand_rows_have() -> None:
    """Segments are as many as each is long; at the ends of the first and the last one nothing is lost."""
    step = np.where(np.arange(1_000_003) % 2, 1.0, -1.0)
    found = clipped((np.zeros_like(step), step), np.full(step.shape, np.nan), 0.25)
    np.testing.assert_array_equal(found, 0.25 * step)
    assert affine(np.ones_like(step), np.ones_like(step), 0.0)[-1] == pytest.approx(len(step))
