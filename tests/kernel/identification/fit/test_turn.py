"""Long series of an effect by what readings see of them: everything known is the same as with all of their entries."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from truepose.arrays import Array
from truepose.identification.fit.decomposition import Decomposition
from truepose.identification.fit.turn import Turn, Turned, turn_of
from truepose.identification.prediction.by_ports import ByPorts, Part
from truepose.identification.prior import LONG

Index = NDArray[np.intp]
FIRST, SECOND = np.arange(3, 3 + 14), np.arange(18, 18 + 15)
PLAIN = np.array([0, 1, 2, 17, 33])
N = 34
WEIGHT = np.ones(N)
WEIGHT[PLAIN] = [0.5, 0.0, 2.0, 0.0, 1.0]
WEIGHT[FIRST], WEIGHT[SECOND] = 2.5, 0.4


def orthonormal(rows: int, columns: int, seed: int) -> Array:
    return np.asarray(np.linalg.qr(np.random.default_rng(seed).normal(size=(rows, columns)))[0])


TURN = Turn(PLAIN, ((FIRST, orthonormal(14, 3, 1)), (SECOND, orthonormal(15, 2, 2))))


def jacobian() -> Array:
    """Of readings that see the directions of the turn alone, and nothing of one plain entry without a tolerance."""
    by_steps = np.random.default_rng(5).normal(size=(40, 10))
    by_steps[:, 3] = 0.0
    return np.asarray(by_steps @ TURN.matrix.toarray().T)


def same_span(one: Array, other: Array) -> None:
    """Rows that are orthonormal span the same."""
    assert one.shape == other.shape
    np.testing.assert_allclose(one.T @ one, other.T @ other, atol=1e-9)


def test_what_is_known_by_turned_steps_is_what_all_entries_say() -> None:
    rows = jacobian()
    known, turned = Decomposition.of(rows, WEIGHT), Turned.by(rows @ TURN.matrix.toarray(), WEIGHT, TURN)
    assert turned.rank == known.rank == 9
    np.testing.assert_allclose(turned.singular, known.singular, atol=1e-9)
    for name in ("seen", "null_space", "unknown"):
        same_span(getattr(turned, name), getattr(known, name))
    assert len(turned.unknown) == 1 and abs(turned.unknown[0, 17]) == pytest.approx(1.0)
    np.testing.assert_allclose(turned.lengths, known.lengths, atol=1e-9)
    np.testing.assert_allclose(turned.root @ turned.root.T, known.root @ known.root.T, atol=1e-9)
    part = rows[::2]
    by_steps = part @ TURN.matrix.toarray()
    assert turned.effective == pytest.approx(known.effective)
    assert turned.share(by_steps) == pytest.approx(known.share(part))
    louder, own = known.root_with(0.7, [0.5 * part]), turned.root_with(0.7, [0.5 * by_steps])
    np.testing.assert_allclose(own @ own.T, louder @ louder.T, atol=1e-9)
    seen = TURN.matrix.toarray() @ turned.own.root
    np.testing.assert_allclose(turned.root[:, : seen.shape[1]], seen, atol=1e-12)


# -- which directions readings see ---------------------------------------------------------------------


def parts(values: Array, port: Index | None = None, twice: bool = False) -> list[Part]:
    """Two parts of rows, of which columns FIRST follow port 1 by ``values`` (n, 14), all other entries are dense."""
    rng = np.random.default_rng(9)
    n = len(values)
    column = np.append(FIRST, FIRST[:1]) if twice else FIRST
    own = np.full(len(column), 1) if port is None else port
    values = np.hstack([values, values[:, :1]]) if twice else values
    others = np.setdiff1d(np.arange(N + 1), FIRST)
    out = []
    for rows in (slice(0, n // 2), slice(n // 2, n)):
        count = len(values[rows])
        dense, slopes = rng.normal(size=(count, 3, len(others))), rng.normal(size=(count, 3, 2))
        out.append(Part(dense, others, ByPorts(slopes, own, column, values[rows])))
    return out


def seen_in_three() -> Array:
    return np.random.default_rng(11).normal(size=(30, 3)) @ orthonormal(14, 3, 4).T


def test_only_long_series_of_one_port_and_one_tolerance_are_turned() -> None:
    values = seen_in_three()
    uneven, open_ended = WEIGHT.copy(), WEIGHT.copy()
    uneven[FIRST[3]] *= 1.001
    open_ended[FIRST] = 0.0
    mixed = np.where(np.arange(14) == 5, 0, 1)
    bare = [replace(part, ports=None) for part in parts(values)]
    assert turn_of([FIRST], parts(values), WEIGHT) is not None
    assert turn_of([FIRST[: LONG + 1]], parts(values), WEIGHT) is not None
    for effects, given, weight in (
        ([FIRST[:LONG]], parts(values), WEIGHT),
        ([FIRST], parts(values), uneven),
        ([FIRST], parts(values), open_ended),
        ([FIRST], parts(values, mixed), WEIGHT),
        ([FIRST], parts(values, twice=True), WEIGHT),
        ([FIRST], bare, WEIGHT),
        ([FIRST], [parts(values)[0], bare[1]], WEIGHT),
        ([SECOND], parts(values), WEIGHT),
        ([], parts(values), WEIGHT),
    ):
        assert turn_of(effects, given, weight) is None
    both = turn_of([SECOND, FIRST], parts(values), WEIGHT)
    assert both is not None and len(both.series) == 1
