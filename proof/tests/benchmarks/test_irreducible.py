"""Sets of identifiable parameters as the polisher's paper makes them."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

from truepose.errors import InputError
from truepose.identification.identifiability.observability import Columns

irreducible = import_module("polisher.irreducible")


def columns(seed: int = 0) -> Columns:
    """a, b, c independent; d = 2a - b; e nearly c; f unseen."""
    rng = np.random.default_rng(seed)
    a, b, c = rng.standard_normal((3, 30))
    factor = np.column_stack([a, b, c, 2 * a - b, c + 1e-3 * rng.standard_normal(30), np.zeros(30)])
    scale = np.array([1.0, 10.0, 0.1, 1.0, 1.0, 1.0])
    return Columns(tuple("abcdef"), factor * scale, scale)


def test_sequential_sets_take_columns_in_order() -> None:
    h = columns()
    assert irreducible.sequential_subset(h).kept == ("a", "b", "c", "e")
    assert irreducible.sequential_subset(h, tolerance=0.1).kept == (
        "a",
        "b",
        "c",
    )  # e is new by a thousandth of itself
    assert irreducible.sequential_subset(h, ("d", "f")).kept == ("d", "a", "c", "e")
    relation = irreducible.sequential_subset(h).relations["d"]
    assert relation == pytest.approx({"a": 2.0, "b": -1.0})
    assert irreducible.sequential_subset(h, order="cb").kept == ("c", "b")
    with pytest.raises(InputError, match="found no free parameter 'z'"):
        irreducible.sequential_subset(h, ("z",))


def test_spectral_reduction_is_of_full_rank_and_loses_nothing() -> None:
    h = columns()
    found = irreducible.spectral_reduction(h)
    reduced = h.factor @ found.directions.T
    assert reduced.shape[1] == h.rank == 4
    np.testing.assert_allclose(np.diag(reduced.T @ reduced), found.eigenvalues, rtol=1e-8)
    np.testing.assert_allclose(reduced @ found.directions, h.factor, atol=1e-7)
