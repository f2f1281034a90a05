"""Columns that follow ports, written out and summed up: the same numbers by plain products of whole matrices."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from truepose.identification.prediction.by_ports import ByPorts, GramSum, Part
from truepose.identification.prediction.predictor import told
from truepose.identification.prediction.sensor_rows import Block, joined, written_out

Array = NDArray[np.float64]
ROWS, CHANNELS, PORTS = 5, 3, 2
AT = np.array([0, 3, 6])
"""Columns that follow no port, of eight."""
COLUMN, PORT = np.array([1, 2, 4, 5, 7]), np.array([0, 1, 0, 1, 1])


def part(seed: int, rows: int = ROWS) -> Part:
    rng = np.random.default_rng(seed)
    ports = ByPorts(
        rng.normal(size=(rows, CHANNELS, PORTS)), PORT, COLUMN, rng.normal(size=(rows, len(COLUMN)))
    )
    return Part(rng.normal(size=(rows, CHANNELS, len(AT))), AT, ports)


def whole(one: Part) -> Array:
    """(n, m, 8) column by column."""
    out = np.zeros((len(one.dense), CHANNELS, 8))
    for k, place in enumerate(one.at):
        out[:, :, place] = one.dense[:, :, k]
    if one.ports is not None:
        for k, place in enumerate(one.ports.column):
            out[:, :, place] = one.ports.slopes[:, :, one.ports.port[k]] * one.ports.values[:, k, None]
    return out


def test_columns_are_written_out_where_they_belong() -> None:
    one = part(1)
    np.testing.assert_allclose(one.written(8), whole(one))
    np.testing.assert_allclose(written_out(one.dense, AT, one.ports), whole(one))
    bare = Part(one.dense, AT, None)
    np.testing.assert_allclose(bare.written(8)[:, :, AT], one.dense)
    assert not bare.written(8)[:, :, COLUMN].any()
    assert written_out(one.dense, None, None) is one.dense


@pytest.mark.parametrize("channels", [None, [0, 2], [1]])
@pytest.mark.parametrize("ports", [True, False])
def test_sums_of_products_are_those_of_whole_columns(channels: list[int] | None, ports: bool) -> None:
    parts = [part(2), part(3, rows=4)]
    if not ports:
        parts = [Part(one.dense, one.at, None) for one in parts]
    total = GramSum(8, channels)
    for one in parts:
        total.add(one)
    some = slice(None) if channels is None else channels
    flat = np.concatenate([whole(one)[:, some].reshape(-1, 8) for one in parts])
    np.testing.assert_allclose(total.matrix(), flat.T @ flat, atol=1e-12)
    total.add(parts[0])  # what was added before is gone
    again = whole(parts[0])[:, some].reshape(-1, 8)
    np.testing.assert_allclose(total.matrix(), again.T @ again, atol=1e-12)


def test_parts_of_other_columns_are_not_added() -> None:
    total = GramSum(8)
    total.add(part(1))
    with pytest.raises(ValueError, match="same columns"):
        total.add(Part(part(1).dense, AT + 1, part(1).ports))


def test_rows_and_columns_are_taken_and_scaled() -> None:
    one = part(4)
    ports = one.ports
    assert ports is not None
    rows, kept = np.array([3, 1]), np.array([True, False, True, True, False])
    np.testing.assert_allclose(Part(one.dense[rows], AT, ports.of_rows(rows)).written(8), whole(one)[rows])
    some = Part(one.dense, AT, ports.of_columns(kept)).written(8)
    np.testing.assert_allclose(some[:, :, COLUMN[kept]], whole(one)[:, :, COLUMN[kept]])
    assert not some[:, :, COLUMN[~kept]].any()
    weight, scale = np.arange(1.0, ROWS + 1)[:, None, None], np.array([2.0, 3.0, 4.0, 5.0, 6.0])
    moved = Part(one.dense * weight, AT, ports.scaled(weight, scale, COLUMN)).written(8)
    factor = np.ones(8)
    factor[COLUMN] = scale
    np.testing.assert_allclose(moved, whole(one) * weight * factor)


def test_rows_that_read_nothing_are_not_counted() -> None:
    one = part(5)
    assert one.ports is not None
    dense, slopes = one.dense.copy(), one.ports.slopes.copy()
    dense[1], slopes[1] = 0.0, 0.0  # a row that reads nothing
    dense[2] = 0.0  # one that shows through ports alone
    dense[3, 0], slopes[3, 0] = 0.0, 0.0  # one that has lost a channel
    lost = Part(dense, AT, one.ports.with_slopes(slopes))
    assert [lost.readings(c) for c in ([0], [1], [0, 1], [0, 1, 2])] == [3, 4, 3 + 4, 3 + 4 + 4]
    assert Part(dense, AT, None).readings([1]) == 3


def block(seed: int, lost: bool = False) -> Block:
    one = part(seed)
    rng = np.random.default_rng(seed)
    gone = rng.random((ROWS, CHANNELS)) < 0.3 if lost else None
    return Block(
        slice(0, ROWS), rng.normal(size=(ROWS, CHANNELS)), one.dense, lost=gone, at=AT, ports=one.ports
    )


@pytest.mark.parametrize("lost", [False, True])
def test_columns_of_a_block_are_those_of_its_jacobian(lost: bool) -> None:
    one = block(6, lost)
    np.testing.assert_allclose(one.columns([6, 0]), one.jacobian[:, :, [6, 0]])
    if one.lost is not None:
        assert not one.jacobian[one.lost].any() and one.jacobian[~one.lost].all()
    bare = Block(one.rows, one.residual, one.here, lost=one.lost)
    np.testing.assert_allclose(bare.columns([1, 5]), one.jacobian[:, :, [1, 5]])


def test_the_part_of_a_block_has_the_weighed_rows_and_the_residual_last() -> None:
    one = block(7)
    place = np.array([0, 1, -1, 2, 3, -1, -1, 4])  # three constants are held
    scale, rows, weight = np.arange(1.0, 9.0), np.array([4, 0, 2]), np.array([2.0, 0.5, 3.0])
    found = one.part(rows, place, scale, weight)
    assert found is not None
    expected = (
        np.concatenate([one.jacobian * scale, one.residual[..., None]], axis=2)[rows] * weight[:, None, None]
    )
    np.testing.assert_allclose(found.written(6), expected[:, :, [0, 1, 3, 4, 7, 8]])
    assert Block(one.rows, one.residual, one.here).part(rows, place, scale, weight) is None


@pytest.mark.parametrize("lost", [False, True])
@pytest.mark.parametrize("ports", [False, True])
def test_blocks_of_sensors_stand_side_by_side(lost: bool, ports: bool) -> None:
    one, other = block(8, lost), block(9)
    assert one.ports is not None and other.ports is not None
    other = Block(
        other.rows, other.residual, other.dense, at=AT, ports=one.ports.with_slopes(other.ports.slopes)
    )
    parts = [one, other] if ports else [Block(b.rows, b.residual, b.here, lost=b.lost) for b in (one, other)]
    both = joined(one.rows, parts)
    np.testing.assert_allclose(both.residual, np.hstack([one.residual, other.residual]))
    np.testing.assert_allclose(both.jacobian, np.concatenate([one.jacobian, other.jacobian], axis=1))
    assert (both.lost is not None) == lost and (both.ports is not None) == ports


def test_a_reading_that_compares_rows_stands_beside_one_that_does_not() -> None:
    def since_the_first(change: Array) -> Array:
        return np.asarray(change - change[:1])

    one = block(10)
    comparing = Block(one.rows, one.residual, one.here, since_the_first)
    plain = Block(one.rows, one.residual, 2.0 * one.here)
    both = joined(one.rows, [comparing, plain])
    expected = np.concatenate([since_the_first(one.here), 2.0 * one.here], axis=1)
    np.testing.assert_allclose(both.jacobian, expected)


def test_channels_that_read_something_are_counted() -> None:
    residual = np.zeros((3, 4))
    lost = np.array([[False] * 4, [True, True, False, False], [True] * 4])
    assert told(residual, None).tolist() == [4.0, 4.0, 4.0]
    assert told(residual, lost).tolist() == [4.0, 2.0, 1.0]  # at least one, to be divided by
