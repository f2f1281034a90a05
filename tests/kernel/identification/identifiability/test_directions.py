"""What a Jacobian that is known by construction tells: levers, directions, limits on both sides, patterns of points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support import MACHINES
from support.short_arm import POSITION, arm
from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.fit.decomposition import Decomposition
from truepose.identification.identifiability.analysis import (
    drawn_poses,
    identifiability,
)
from truepose.identification.identifiability.observability import (
    LEVER,
    Direction,
    Knowledge,
    determined,
    nearly_unseen,
    unseen,
)
from truepose.identification.identifiability.patterns import Pattern, patterns, remaining
from truepose.models.load import load_machine

INF = float("inf")


def known(
    names: Sequence[str],
    rows: Array,
    units: Sequence[str] | None = None,
    sigma: Sequence[float] | None = None,
    scale: Sequence[float] | None = None,
    value: Sequence[float] | None = None,
) -> Knowledge:
    """A Jacobian for one unit of each; steps are 1, and so are tolerances, if nothing else is said."""
    n = len(names)
    steps = np.array(scale or [1.0] * n)
    width = np.array(sigma or [1.0] * n)
    weight = np.where(np.isinf(width), 0.0, steps / width)
    parts = Decomposition.of(np.asarray(rows, dtype=float) * steps, weight)
    return Knowledge(
        tuple(names), tuple(units or ["mm"] * n), np.array(value or [0.0] * n), width, steps, parts
    )


def test_an_angle_s_lever_is_what_shows_as_much_as_a_millimetre() -> None:
    """The middle of the columns of its unit over the middle of the lengths'; those that nothing shows do not count."""
    units = ["mm", "mm", "mm", "rad", "rad", "rad", "1/K", "N", "rad"]
    rows = np.diag([2.0, 6.0, 0.0, 800.0, 2000.0, 1600.0, 40.0, 0.0, 1e-12])
    steps = [1.0, 1.0, 1.0, 0.01, 0.01, 0.01, 1e-5, 0.1, 0.01]
    told = known("abcdefghi", rows, units, scale=steps)
    # N: nothing shows any; 300 mm for a thousand steps
    expected = [1.0, 1.0, 1.0, 400.0, 400.0, 400.0, 10.0, LEVER * 1e-3 / 0.1, 400.0]
    np.testing.assert_allclose(told.lever, expected)
    bare = known("ab", np.diag([5.0, 7.0]), ["rad", "1/K"], scale=[0.01, 1e-5])
    np.testing.assert_allclose(bare.lever, [LEVER, LEVER * 1e-3 / 1e-5])
    assert LEVER == 300.0


def test_a_parameter_is_determined_where_readings_halve_its_variance() -> None:
    """And no unseen direction moves it by a thousandth of its length."""
    told = known("abc", np.eye(3), sigma=[2.0, 2.0, INF])
    half = 2.0 * np.sqrt(0.5)
    std = np.array([0.999 * half, 1.001 * half, 5.0])
    assert determined(told, std).tolist() == [True, False, True]
    assert determined(told, np.array([0.1, 0.1, INF])).tolist() == [True, True, False]
    for part, flag in ((0.9e-3, True), (1.1e-3, False)):
        blind = np.array([[part, 0.0, np.sqrt(1.0 - part**2)]])
        assert determined(told, np.full(3, 0.1), blind).tolist() == [flag, True, False]
    # by readings of sigma 1 beside a tolerance of 1: just half
    assert determined(known("ab", np.diag([1.01, 0.99]))).tolist() == [True, False]


def test_frames_lead_where_they_take_part_and_small_parts_are_not_told() -> None:
    names = ("q1.d", "base.x", "q2.d", "q3.d")
    hidden = np.array([[3.0, -1.0, 0.0, 0.05], [0.0, 0.0, 1.0, 0.0]])
    rows = np.eye(4) - hidden.T @ np.linalg.pinv(hidden.T)
    first, second = unseen(known(names, rows, sigma=[INF, INF, 1.0, INF]))
    assert dict(first.parts) == {"q2.d": pytest.approx(1.0)} and not first.open_ended
    assert list(second.parts) == ["q1.d", "base.x"] and second.open_ended
    assert second.parts["base.x"] / second.parts["q1.d"] == pytest.approx(-1.0 / 3.0)
    assert max(abs(v) for v in second.parts.values()) == pytest.approx(1.0)
    shown = known(names, rows)
    for part, listed in ((0.07, True), (0.05, False)):  # a fiftieth of three
        (one,) = unseen(shown, np.array([[3.0, -1.0, 0.0, part]]))
        assert ("q3.d" in one.parts) == listed and one.size == 0.0


def test_what_readings_see_less_than_tolerances_say() -> None:
    """Sizes are sigmas a tolerance: of each by itself here, the least first, none above one."""
    told = known("abcd", np.diag([4.0, 0.3, 0.05, 0.99]), sigma=[0.1, 2.0, 3.0, 1.0])
    found = nearly_unseen(told)
    assert [(list(d.parts), round(d.size, 9)) for d in found] == [
        (["c"], 0.15), (["a"], 0.4), (["b"], 0.6), (["d"], 0.99),
    ]  # fmt: skip
    assert not any(d.open_ended for d in found)
    wide = known("abcd", np.diag([4.0, 0.3, 0.05, 1.01]), sigma=[0.1, 6.0, 3.0, INF])
    assert [list(d.parts) for d in nearly_unseen(wide)] == [["c"], ["a"]]
    # a step of another size says the same
    steps = known(
        "abcd", np.diag([4.0, 0.3, 0.05, 0.99]), sigma=[0.1, 2.0, 3.0, 1.0], scale=[0.1, 5.0, 3.0, 0.02]
    )
    assert [round(d.size, 9) for d in nearly_unseen(steps)] == [0.15, 0.4, 0.6, 0.99]


POINTS = {"P1": (100.0, 20.0, -5.0), "P2": (-40.0, 60.0, 10.0), "P3": (10.0, -90.0, 30.0)}
FRAME = ("tool.x", "tool.y", "tool.z")


def of_points(
    hidden: Array, axes: str = "xyz", more: Sequence[str] = ()
) -> tuple[Knowledge, Array, dict[str, float]]:
    """Points whose coordinates no reading tells along ``hidden`` (k, n)."""
    names = [f"{p}.{a}" for p in POINTS for a in axes] + list(more)
    values = {f"{p}.{a}": v for p, place in POINTS.items() for a, v in zip("xyz", place, strict=True)}
    rows = np.eye(len(names)) - np.linalg.pinv(hidden) @ hidden
    told = known(names, rows, value=[values.get(name, 0.0) for name in names])
    return told, told.decomposition.null_space, values


def turned(axis: int) -> Array:
    return np.concatenate([np.cross(np.eye(3)[axis], place) for place in POINTS.values()])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_points_that_may_move_as_one_body_are_told_with_their_motion(axis: int) -> None:
    frames = dict.fromkeys(POINTS, "flange")
    for motion, hidden in (("along", np.tile(np.eye(3)[axis], 3)), ("about", turned(axis))):
        told, blind, values = of_points(hidden[None])
        (one,) = [p for p in patterns(told, blind, values, frames) if p.kind == "body"]
        assert (one.members, one.motion, one.undone_by) == (("P1", "P2", "P3"), f"{motion} {'xyz'[axis]}", ())
        cosine = one.change @ hidden / np.linalg.norm(one.change) / np.linalg.norm(hidden)
        assert cosine == pytest.approx(1.0, abs=1e-9)
        assert remaining(told, unseen(told, blind), [one]) == ()
        # points of which nobody said whose they are are no body
        assert not [p for p in patterns(told, blind, values, {}) if p.kind == "body"]
        other = {"P1": "flange", "P2": "base", "P3": "base"}
        assert not [p for p in patterns(told, blind, values, other) if p.kind == "body"]


def test_a_frame_that_undoes_a_body_s_motion_is_named() -> None:
    hidden = np.concatenate([np.tile([1.0, 0.0, 0.0], 3), [-1.0, 0.0, 0.0]])
    told, blind, values = of_points(hidden[None], more=FRAME)
    (one,) = patterns(told, blind, values, dict.fromkeys(POINTS, "flange"))
    assert (one.kind, one.motion, one.undone_by) == ("body", "along x", ("tool.x",))
    np.testing.assert_allclose(one.change / one.change[0], hidden, atol=1e-9)


def test_a_coordinate_that_is_exactly_known_forbids_what_would_move_it() -> None:
    """Without z among the unknowns points may move along x and y and about z, but nothing tilts them."""
    flat = np.array([np.tile([1.0, 0.0], 3), turned(2).reshape(-1, 3)[:, :2].ravel()])
    told, blind, values = of_points(flat, "xy")
    found = [p.motion for p in patterns(told, blind, values, dict.fromkeys(POINTS, "flange"))]
    assert found == ["along x", "about z"]


def test_directions_that_patterns_do_not_explain_remain() -> None:
    hidden = np.array([np.tile([1.0, 0.0, 0.0], 3), np.eye(9)[4]])
    told, blind, values = of_points(hidden)
    found = patterns(told, blind, values, dict.fromkeys(POINTS, "flange"))
    assert [p.motion for p in found] == ["along x"]
    (left,) = remaining(told, unseen(told, blind), found)
    assert list(left.parts) == ["P2.y"]
    every = unseen(told, blind)
    assert remaining(told, every, ()) == every
    whole = Pattern("shift", hidden[1], ("P2.y",))
    assert remaining(told, every, (*found, whole)) == ()
    assert remaining(told, (Direction({"P2.y": 1.0}),), (whole,)) == ()


@pytest.mark.parametrize(("values", "kinds"), [([3.0, 0.0, 5.0], ["shift"]), ([3.0, 4.0, 5.0], ["scale"])])
def test_a_scale_is_one_of_three_lengths_at_least(values: list[float], kinds: list[str]) -> None:
    """Of two that stand in the ratio of their values something else may be meant; angles have no scale."""
    names = ("leg1.d", "leg2.d", "leg3.d") if kinds == ["scale"] else ("leg1.d", "q.theta", "leg3.d")
    hidden = np.array(values) / np.linalg.norm(values)
    told = known(names, np.eye(3) - np.outer(hidden, hidden), ["mm", "rad", "mm"] if "q.theta" in names else None,
                 value=values)  # fmt: skip
    found = [p.kind for p in patterns(told, told.decomposition.null_space, {}, {})]
    assert found == (["scale"] if kinds == ["scale"] else [])
    equal = known(("leg1.d", "leg2.d"), np.eye(2) - 0.5, value=[3.0, 4.0])
    (shift,) = patterns(equal, equal.decomposition.null_space, {}, {})
    assert (shift.kind, shift.members) == ("shift", ("leg1.d", "leg2.d"))


@pytest.mark.parametrize(
    ("share", "status"), [(3.0, "determined"), (0.7, "partly"), (0.4, "tolerance decides")]
)
def test_a_status_says_who_decides(share: float, status: str, tmp_path: Path) -> None:
    """By the tolerance in parts of what readings alone leave: one over the square of a sigma adds up."""
    (alone,) = identifiability(arm(tmp_path, "q3.d: .inf", frames="", sensor=POSITION)).parameters
    readings = alone.std_at_drawing
    machine = arm(tmp_path, f"q3.d: {share * readings:.9g}", frames="", sensor=POSITION)
    (one,) = identifiability(machine).parameters
    assert one.std_at_drawing == pytest.approx(readings * (1.0 + share**-2) ** -0.5, rel=1e-4)
    assert one.status == status and one.partners == () and one.unit == "mm"
    assert one.tolerance == pytest.approx(share * readings, rel=1e-6)


def test_nothing_is_drawn_over_a_range_without_an_end() -> None:
    machine = load_machine(MACHINES / "serial.yaml")
    endless = tuple(replace(a, range=(0.0, INF)) for a in machine.mechanism.actuators)
    with pytest.raises(InputError, match="found no range to draw poses from"):
        drawn_poses(replace(machine, mechanism=replace(machine.mechanism, actuators=endless)), 3)
