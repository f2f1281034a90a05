"""The largest departure that a true model makes is one number, however its covariance is rounded and ordered."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from truepose.identification.fit.summary import largest_departure


@given(seen=st.integers(0, 12), unseen=st.integers(1, 12), seed=st.integers(0, 99))
def test_rounding_changes_nothing_where_eigenvalues_are_alike(seen: int, unseen: int, seed: int) -> None:
    """Directions that no reading sees have one eigenvalue in common."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.standard_normal((seen + unseen, seen + unseen)))
    exact = (q * np.repeat([1.0, 0.0], [seen, unseen])) @ q.T
    noise = 1e-14 * rng.standard_normal(exact.shape)
    assert largest_departure(exact + noise + noise.T) == pytest.approx(largest_departure(exact), abs=1e-5)


def test_independent_departures_have_the_largest_of_so_many_normal_numbers() -> None:
    expected = norm.ppf(0.5 + 0.5 * 0.99 ** (1 / 20))
    assert largest_departure(np.eye(20)) == pytest.approx(expected, rel=0.02)
