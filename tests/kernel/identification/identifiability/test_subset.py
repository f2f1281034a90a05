"""Which columns of a Jacobian are kept, and what those left out show like: in cases that are known by construction."""

from __future__ import annotations

import numpy as np
import pytest

from truepose.identification.identifiability.observability import (
    Columns,
    independent_subset,
    subset_of,
)

NAMES = ("a", "b", "c", "d")
SCALE = np.array([1.0, 0.5, 2.0, 1.0])


def columns(*rows: list[float], scale: np.ndarray = SCALE) -> Columns:
    return Columns(NAMES, np.array(rows, dtype=float), scale)


# d shows like 2 a - 3 b, in steps; c alone
KNOWN = columns([5.0, 0.0, 0.0, 10.0], [0.0, 1.0, 0.0, -3.0], [0.0, 0.0, 2.0, 0.0])


def test_what_shows_most_is_kept_first_and_the_rest_shows_like_it() -> None:
    found = independent_subset(KNOWN)
    assert found.kept == ("d", "c", "a")  # of a, beside d, more is left than of b
    assert set(found.relations) == {"b"}
    # d = 2 a - 3 b: in steps b = 2/3 a - 1/3 d; in units by the steps of each
    assert found.relations["b"] == pytest.approx({"a": 2 / 3 / 0.5, "d": -1 / 3 / 0.5})


def test_relations_are_in_units_of_their_own() -> None:
    found = subset_of(KNOWN, [0, 1, 2])
    assert found.kept == ("a", "b", "c")
    assert found.relations == {"d": pytest.approx({"a": 2.0 * 1.0 / 1.0, "b": -3.0 * 0.5 / 1.0})}
    assert found.condition == pytest.approx(5.0)
    matrix = KNOWN.factor / SCALE  # for one unit of each
    parts = found.relations["d"]
    np.testing.assert_allclose(
        matrix[:, 3], sum(v * matrix[:, NAMES.index(n)] for n, v in parts.items()), atol=1e-12
    )


def test_columns_that_show_alike_are_taken_in_their_order() -> None:
    for noise in (0.0, 1e-9, -1e-9):
        tie = columns(
            [1.0, 0.0, 0.0, 0.0], [0.0, 1.0 + noise, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 2.0]
        )
        assert independent_subset(tie).kept == ("d", "a", "b", "c")


def test_what_readings_tell_worse_than_so_many_sigmas_is_left_out() -> None:
    assert independent_subset(KNOWN, least=1.5).kept == ("d", "c")
    assert independent_subset(KNOWN, least=100.0).kept == ()
    assert independent_subset(KNOWN, least=100.0).condition == 0.0
    assert set(independent_subset(KNOWN, least=100.0).relations) == set(NAMES)


def test_a_column_that_nothing_shows_is_like_nothing() -> None:
    blank = columns([1.0, 0.0, 0.5, 0.0], [0.0, 1.0, 0.5, 0.0])
    found = independent_subset(blank)
    assert set(found.kept) | set(found.relations) == set(NAMES) and len(found.kept) == 2
    assert found.relations["d"] == {}
    assert found.relations["c"] if "c" not in found.kept else True
