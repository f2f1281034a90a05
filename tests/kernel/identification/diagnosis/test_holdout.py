"""What held-out rows say of two models: which count, what is worse, and what extrapolates."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from support.recordings import rows_of
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
from truepose.identification.recording.recording import Recording
from truepose.models.file.sections import NO_WORSE

Array = NDArray[np.float64]
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


def test_the_thermometer_that_varies_most_tells_the_warmest_rows() -> None:
    n, rng = 100, np.random.default_rng(6)
    calm, lively = 20.0 + 0.1 * rng.standard_normal(n), 25.0 + 3.0 * rng.standard_normal(n)
    for drivers in (
        {"temperature.air": calm, "temperature.q1": lively},
        {"temperature.air": lively, "temperature.q1": calm},
    ):
        _, blocks = held_out_blocks(rows(drivers, n), np.ones(n, dtype=bool))
        (warm,) = (b.rows for b in blocks if b.name == WARM)
        assert lively[warm].min() > np.median(lively)
        assert 0.1 * n <= warm.sum() <= 0.2 * n + 1


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
