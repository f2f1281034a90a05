"""What held-out rows say of two models: which count, what is worse, and what extrapolates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from support.examples import examples
from support.recordings import rows_of
from truepose.arrays import Array
from truepose.identification.diagnosis.holdout import (
    OUTERMOST,
    VALIDATION,
    Comparison,
    Held,
    Trial,
    held_out_blocks,
    ratio_interval,
)
from truepose.identification.diagnosis.result import BlockProof, PoseError
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.models.file.sections import NO_WORSE

NOTHING = np.zeros(0)
HEAVY, WARM = "heaviest loads", "warmest rows"


def squares(*values: float) -> Held:
    """Readings alone."""
    return Held(np.array(values), NOTHING)


def both(readings: Array, points: Array) -> Held:
    return Held(readings, points)


def trials(before: Mapping[str, Held], after: Mapping[str, Held], split: str = "blocks") -> Comparison:
    fitted = squares(1.0, 4.0), squares(1.0, 1.0)
    return Trial(split, after, fitted[1]).against(Trial(split, before, fitted[0]))


def rows(drivers: Mapping[str, Array], n: int, validation: int = 0, reach: Array | None = None) -> Recording:
    """Poses of two joints, a second apart; the last of them for validation."""
    q = np.random.default_rng(3).uniform(-1.0, 1.0, (n, 2)) if reach is None else reach
    return rows_of(q, drivers=drivers, validation=np.arange(n) >= n - validation)


# -- two models beside each other ---------------------------------------------------------------------------------


def test_all_blocks_count_together_by_their_rows_where_none_is_for_validation() -> None:
    before = {"quarter 1 in time": squares(4.0, 4.0), OUTERMOST: squares(16.0)}
    after = {"quarter 1 in time": squares(1.0, 1.0), OUTERMOST: squares(25.0)}
    found = trials(before, after)
    assert found.split == "blocks" and found.pose is None
    assert sorted(found.before) == [4.0, 4.0, 16.0] and sorted(found.after) == [1.0, 1.0, 25.0]
    assert found.ratio == pytest.approx(np.sqrt(27.0 / 24.0))
    assert [(b.name, b.rows, b.extrapolates) for b in found.blocks] == [
        ("quarter 1 in time", 2, False),
        (OUTERMOST, 1, True),
    ]
    assert [b.ratio for b in found.blocks] == pytest.approx([0.5, 1.25])


def test_validation_rows_count_alone_and_extrapolations_stand_beside_them() -> None:
    before = {OUTERMOST: squares(1.0), VALIDATION: squares(4.0, 4.0)}
    after = {OUTERMOST: squares(100.0), VALIDATION: squares(1.0, 1.0)}
    found = trials(before, after, "role")
    assert found.ratio == pytest.approx(0.5) and not found.worse
    assert {b.name: b.extrapolates for b in found.blocks} == {OUTERMOST: True, VALIDATION: False}
    assert found.worse_beyond()


def test_rows_that_either_model_cannot_assemble_count_for_neither() -> None:
    found = trials({OUTERMOST: squares(np.nan, 4.0, 9.0)}, {OUTERMOST: squares(1.0, np.nan, 36.0)})
    assert found.before.tolist() == [9.0] and found.after.tolist() == [36.0]
    assert found.blocks[0].rows == 1 and found.ratio == pytest.approx(2.0)


def test_a_block_that_one_model_lacks_is_no_comparison() -> None:
    """Too little was left to fit it. Without any block, the rows that were fitted say what they can."""
    one = trials({OUTERMOST: squares(1.0), HEAVY: squares(1.0)}, {HEAVY: squares(4.0), WARM: squares(9.0)})
    assert [b.name for b in one.blocks] == [HEAVY] and one.ratio == pytest.approx(2.0)
    none = trials({OUTERMOST: squares(1.0)}, {HEAVY: squares(4.0)})
    assert none.split == "none" and none.blocks == () and none.pose is None
    assert none.before.tolist() == [1.0, 4.0] and none.after.tolist() == [1.0, 1.0]
    empty = trials(
        {OUTERMOST: squares(np.nan), HEAVY: squares(1.0)}, {OUTERMOST: squares(1.0), HEAVY: squares(9.0)}
    )
    assert [b.name for b in empty.blocks] == [HEAVY] and empty.ratio == pytest.approx(3.0)


def test_the_tool_is_judged_by_the_points_of_the_rows_that_count() -> None:
    """Root mean squares, mm; of each block by itself as after over before."""
    ones = np.ones(2)
    before = {OUTERMOST: both(ones, np.array([1.0, 7.0])), HEAVY: both(ones, np.array([4.0, 4.0]))}
    after = {OUTERMOST: both(ones, np.array([16.0, 16.0])), HEAVY: both(ones, np.array([1.0, 1.0]))}
    found = trials(before, after)
    assert found.pose is not None
    assert (found.pose.plain, found.pose.model) == pytest.approx((2.0, np.sqrt(34.0 / 4.0)))
    assert [b.pose for b in found.blocks] == pytest.approx([2.0, 0.5])
    unread = trials({OUTERMOST: both(ones, NOTHING)}, {OUTERMOST: both(ones, ones)})
    assert unread.blocks[0].pose is None


@pytest.mark.parametrize(
    ("ratio", "pose", "worse"),
    [
        (NO_WORSE - 1e-6, None, False),
        (NO_WORSE + 1e-6, None, True),
        (0.5, NO_WORSE - 1e-6, False),
        (0.5, NO_WORSE + 1e-6, True),
        (0.5, None, False),
    ],
)
def test_a_block_is_worse_beyond_two_per_cent_of_readings_or_of_the_tool(
    ratio: float, pose: float | None, worse: bool
) -> None:
    assert NO_WORSE == 1.02
    block = BlockProof(OUTERMOST, 5, ratio, pose, extrapolates=True)
    assert block.worse_than(None) is worse
    # another model that is better than plain calibration asks for no more than that
    assert block.worse_than(BlockProof(OUTERMOST, 5, 0.2, 0.2)) is worse
    assert block.worse_than(BlockProof(OUTERMOST, 5, 0.2)) is worse
    assert block.worse_than(BlockProof(OUTERMOST, 5, 2.0, 2.0)) is False
    whole = Comparison(
        "role", np.ones(3), ratio**2 * np.ones(3), (), None if pose is None else PoseError(1.0, pose)
    )
    assert whole.worse is worse


def test_an_end_that_another_model_was_not_tried_at_is_judged_by_itself() -> None:
    end = BlockProof(OUTERMOST, 5, 1.5, extrapolates=True)
    found = Comparison("role", np.ones(1), np.ones(1), (end,), None)
    elsewhere = Comparison(
        "role", np.ones(1), np.ones(1), (BlockProof(HEAVY, 5, 3.0, extrapolates=True),), None
    )
    assert found.worse_beyond(elsewhere) and found.worse_beyond()
    inside = Comparison("role", np.ones(1), np.ones(1), (BlockProof(VALIDATION, 5, 9.0),), None)
    assert not inside.worse_beyond()


# -- blocks -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("levels", "held"), [(3, False), (4, True)])
def test_largest_loads_are_predicted_from_others_where_there_are_four_levels(levels: int, held: bool) -> None:
    load = np.resize(np.repeat(np.arange(float(levels)), 2), 80)
    _, blocks = held_out_blocks(rows({"payload": load}, 80), np.ones(80, dtype=bool))
    assert (HEAVY in [b.name for b in blocks]) is held


@pytest.mark.parametrize(("rows_for_validation", "split"), [(0, "blocks"), (2, "blocks"), (3, "role")])
def test_three_validation_rows_are_a_split(rows_for_validation: int, split: str) -> None:
    recording = rows({}, 40, rows_for_validation)
    name, blocks = held_out_blocks(recording, ~recording.validation)
    assert name == split
    if split == "blocks":
        names = [f"quarter {k} in time" for k in (1, 2, 3, 4)]
        assert [b.name for b in blocks] == [OUTERMOST, *names]
        quarters = [np.flatnonzero(b.rows) for b in blocks[1:]]
        assert all(a.max() < b.min() for a, b in pairwise(quarters))
        assert max(map(len, quarters)) - min(map(len, quarters)) <= 1
    else:
        assert [b.name for b in blocks] == [OUTERMOST, VALIDATION]
        blocks[-1].rows[:] = False  # a copy: the recording keeps its own
        assert recording.validation.sum() == rows_for_validation
    assert not any((b.rows & recording.validation).any() for b in blocks if b.name != VALIDATION)


def test_rows_all_alike_in_reach_make_no_outermost_block() -> None:
    """More than two fifths of the rows, or fewer than three, are no end of what was seen."""
    alike = np.column_stack([np.where(np.arange(40) % 2 == 0, 1.0, -1.0), np.ones(40)])
    _, blocks = held_out_blocks(rows({}, 40, reach=alike), np.ones(40, dtype=bool))
    assert OUTERMOST not in [b.name for b in blocks]
    _, few = held_out_blocks(rows({}, 8), np.ones(8, dtype=bool))
    assert OUTERMOST not in [b.name for b in few] and sum(b.rows.sum() for b in few) == 8


def test_the_interval_of_a_ratio_holds_19_in_20() -> None:
    """Of rows drawn anew the true ratio (1/2) lies below and above it one time in forty each."""
    rng, below, above, times = np.random.default_rng(11), 0, 0, 200
    for _ in range(times):
        before, after = rng.chisquare(3, 60), 0.25 * rng.chisquare(3, 60)
        ratio, (low, high) = ratio_interval(before, after)
        assert low < ratio < high
        below, above = below + (high < 0.5), above + (low > 0.5)
    for missed in (below, above):  # a bootstrap of 60 rows is a little too sure
        assert 0.003 * times < missed < 0.08 * times


def test_of_very_many_rows_the_interval_is_the_limit_of_the_bootstrap() -> None:
    rng = np.random.default_rng(5)
    before, after = rng.chisquare(3, 20_000), 0.25 * rng.chisquare(3, 20_000)
    ratio, interval = ratio_interval(before, after)
    drawn, bootstrap = ratio_interval(before[1:], after[1:])
    assert ratio == pytest.approx(0.5, abs=0.02)
    assert drawn == pytest.approx(ratio, rel=1e-3)
    assert interval == pytest.approx(bootstrap, rel=2e-3)
    assert np.ptp(interval) == pytest.approx(np.ptp(bootstrap), rel=0.15)  # of 1000 draws


@settings(max_examples=examples(25), deadline=None)
@given(st.permutations(range(30)))
def test_the_interval_does_not_depend_on_the_order_of_rows(order: list[int]) -> None:
    rng = np.random.default_rng(10)
    before, after = rng.chisquare(3, 30), 0.2 * rng.chisquare(3, 30)
    ratio, interval = ratio_interval(before, after)
    again, moved = ratio_interval(before[order], after[order])
    assert again == pytest.approx(ratio)
    assert moved == pytest.approx(interval)
    assert interval[0] <= ratio <= interval[1]


def test_extrapolations_are_farther_heavier_and_warmer_than_what_they_are_predicted_from() -> None:
    rng, n = np.random.default_rng(4), 300
    drivers = {
        "payload": rng.choice(np.arange(12.0), n),
        "temperature.air": rng.normal(22.0, 0.1, n),
        "temperature.leg": rng.normal(30.0, 3.0, n),
    }
    recording = rows_of(rng.normal([5.0, -3.0], [1.0, 40.0], (n, 2)), drivers=drivers)
    _, blocks = held_out_blocks(recording, np.ones(n, dtype=bool))
    off = (recording.q - recording.q.mean(axis=0)) / recording.q.std(axis=0)
    scores = {
        OUTERMOST: np.hypot(*off.T),
        "heaviest loads": drivers["payload"],
        "warmest rows": drivers["temperature.leg"],
    }
    left = np.ones(n, dtype=bool)
    found = {block.name: block.rows for block in blocks}
    for name, score in scores.items():  # each leaves its rows to itself
        held = found[name]
        assert 0.1 * n < held.sum() < 0.25 * n
        assert score[held].min() > score[left & ~held].max()
        left &= ~held


@pytest.mark.parametrize(("heaviest", "held"), [(0.3, True), (0.65, False)])
def test_no_more_than_two_fifths_are_held_out_at_once(
    case: tuple[Estimate, Recording], heaviest: float, held: bool
) -> None:
    """Loads of which the heaviest are most of all: the others say too little to predict them from."""
    _, recording = case
    n = len(recording)
    order = np.random.default_rng(4).permutation(n)
    loads = np.where(order < heaviest * n, 9.0, order % 4)
    loaded = replace(recording, drivers={"payload": loads}, pose=np.arange(n, dtype=np.int64))
    _, blocks = held_out_blocks(loaded, np.ones(n, dtype=bool))
    assert ("heaviest loads" in [b.name for b in blocks]) is held
    assert blocks[0].name == OUTERMOST and all(3 <= b.rows.sum() <= 0.4 * n for b in blocks)


def test_repeats_of_a_pose_are_held_out_together(case: tuple[Estimate, Recording]) -> None:
    _, recording = case
    n = len(recording)
    pose = np.arange(n, dtype=np.int64) // 2
    paired = replace(recording, pose=pose, drivers={}, q=recording.q[2 * pose])
    _, (outermost, *quarters) = held_out_blocks(paired, np.ones(n, dtype=bool))
    assert outermost.name == OUTERMOST
    assert set(pose[outermost.rows]).isdisjoint(pose[~outermost.rows])
    assert len(quarters) == 4
    sizes = [int(b.rows.sum()) for b in quarters]
    assert max(sizes) - min(sizes) <= 1 and sum(sizes) + outermost.rows.sum() == n


def campaign(n: int, drivers: Mapping[str, Array], validation: NDArray[np.bool_] | None = None) -> Recording:
    """Readings of two joints in time order."""
    rng = np.random.default_rng(8)
    given = {} if validation is None else {"validation": validation}
    return rows_of(rng.uniform(-1, 1, (n, 2)), drivers=drivers, **given)


def test_validation_rows_are_the_split_where_there_are_any() -> None:
    validation = np.arange(50) >= 40
    split, blocks = held_out_blocks(campaign(50, {}, validation), ~validation)
    assert split == "role"
    np.testing.assert_array_equal(blocks[-1].rows, validation)


def test_blocks_extrapolate_in_reach_load_and_temperature_and_share_no_row() -> None:
    rng = np.random.default_rng(9)
    drivers = {
        "payload": rng.choice([0.0, 1.0, 2.0, 3.0, 5.0], 100),
        "temperature.air": rng.normal(22, 1, 100),
    }
    recording = campaign(100, drivers)
    split, blocks = held_out_blocks(recording, np.ones(100, dtype=bool))
    assert split == "blocks"
    assert [b.name for b in blocks[:3]] == [OUTERMOST, "heaviest loads", "warmest rows"]
    assert np.sum([b.rows for b in blocks], axis=0).max() == 1
    assert np.any([b.rows for b in blocks], axis=0).all()
