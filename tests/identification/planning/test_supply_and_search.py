"""Where planned poses come from, what they tell, how they are moved, and what a plan says of itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from support.graph_machines import machine_of
from support.plans import landscape, poses
from truepose.errors import InputError
from truepose.identification.leaves.planning.information import (
    CANDIDATES,
    STRONG,
    UNKNOWN,
    PoseInformation,
    Poses,
    Supply,
    rounded,
)
from truepose.identification.leaves.planning.plan import CRITERIA, DRAWS, Landscape, Plan, climb, plan
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]


def held(machine: Machine, **ranges: tuple[float, float] | None) -> Machine:
    """The machine with other ranges of some joints, in internal units."""
    actuators = tuple(replace(a, range=ranges.get(a.reading, a.range)) for a in machine.mechanism.actuators)
    return replace(machine, mechanism=replace(machine.mechanism, actuators=actuators))


def levels(information: PoseInformation, q: Array) -> NDArray[np.bool_]:
    """(n,) poses all joints of which stand low, in the middle or high."""
    share = (q - information.low) / information.span
    return np.asarray(np.all(np.abs(2 * share - np.round(2 * share)) < 1e-9, axis=1))


@pytest.mark.parametrize(("name", "all_levels"), [("serial", 27), ("pus", None)])
def test_candidates_are_drawn_inside_the_ranges_and_at_their_ends(name: str, all_levels: int | None) -> None:
    information = PoseInformation(machine_of(name))
    supply = Supply.of(information, None, np.random.default_rng(0))
    q = supply.poses.q
    assert ((q >= information.low) & (q <= information.high)).all()
    at = levels(information, q)
    assert np.sum(~at) <= CANDIDATES // 2 and np.sum(at) <= CANDIDATES // 2
    assert len(np.unique(q[at], axis=0)) == np.sum(at)
    share = np.round(2 * (q[at] - information.low) / information.span)
    assert set(share.ravel()) == {0.0, 1.0, 2.0}
    if all_levels is not None:
        assert np.sum(at) == all_levels and np.sum(~at) == CANDIDATES // 2
    assert not supply.given and supply.left_out == 0
    median = np.median(information.at(q).amplification)
    assert supply.strongest == pytest.approx(STRONG * median, rel=0.3)
    assert supply.poses.within(supply.strongest).all()


def test_poses_that_are_given_are_counted_where_they_are_no_use() -> None:
    information, rng = PoseInformation(machine_of("ups")), np.random.default_rng(1)
    q = poses(information, 12)
    q[[2, 7, 8]] = 1e5  # far beyond the legs' reach
    supply = Supply.of(information, q, rng)
    assert supply.given and supply.left_out == 3
    np.testing.assert_array_equal(supply.poses.q, np.delete(q, [2, 7, 8], axis=0))
    some, all_of_them, more = (supply.draw(n, rng).q for n in (5, 9, 10))
    rows = {row.tobytes() for row in supply.poses.q}
    for found, n in ((some, 5), (all_of_them, 9)):
        assert len({row.tobytes() for row in found}) == n and {row.tobytes() for row in found} <= rows
    assert len(more) == 10 and len({row.tobytes() for row in more}) < 10
    with pytest.raises(InputError, match="found no pose among 3 in which the mechanism can be assembled"):
        Supply.of(information, q[[2, 7, 8]], rng)


def test_poses_are_drawn_until_there_are_enough_that_can_be_assembled() -> None:
    information, rng = PoseInformation(machine_of("pus")), np.random.default_rng(2)
    supply = Supply.of(information, None, rng)
    strict = replace(supply, strongest=float(np.median(supply.poses.amplification)))
    found = strict.draw(9, rng)
    assert len(found.q) == 9 and found.within(strict.strongest).all()
    assert len({row.tobytes() for row in found.q}) == 9 and not levels(information, found.q).any()
    with pytest.raises(InputError, match="found 0 of 100 random poses in which the mechanism can be"):
        replace(supply, strongest=0.0).draw(2, rng)


# -- what poses tell -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["serial", "distance"])
def test_rows_of_a_sequence_and_their_pull_belong_together(name: str) -> None:
    """<rows(S), C> = <S, pulled(C)>; a reading that differs loses the pose before, the first itself."""
    information, rng = PoseInformation(machine_of(name)), np.random.default_rng(3)
    shape = (5, len(information.differs), len(information.names))
    signature, cotangent = rng.standard_normal((2, *shape))
    before, kept = signature.copy(), cotangent.copy()
    rows, pulled = information.rows(signature), information.pulled_rows(cotangent)
    assert np.sum(rows * cotangent) == pytest.approx(np.sum(signature * pulled), rel=1e-12)
    expected = np.diff(signature, axis=0, prepend=signature[:1]) if name == "distance" else signature
    np.testing.assert_allclose(rows, expected)
    np.testing.assert_array_equal(signature, before)
    np.testing.assert_array_equal(cotangent, kept)


def test_a_joint_that_is_held_has_a_range_of_nothing() -> None:
    information = PoseInformation(held(machine_of("serial"), q2=(0.5, 0.5)))
    assert information.span[1] == 1.0 and information.home[1] == 0.5
    assert information.span[0] == 300.0 and information.home[0] == 0.0
    found = climb(landscape(information.machine, "d"), poses(information, 3))
    assert (found[:, 1] == 0.5).all()


def test_poses_are_taken_by_number_by_mask_and_by_strength() -> None:
    information = PoseInformation(machine_of("pus"))
    found = information.at(poses(information, 6))
    some, masked = found.take(np.array([4, 1])), found.take(np.arange(6) == 4)
    np.testing.assert_array_equal(some.q, found.q[[4, 1]])
    np.testing.assert_array_equal(masked.signature[0], some.signature[0])
    assert masked.x.tolist() == [found.x[4].tolist()] and masked.amplification == found.amplification[4]
    limit = float(np.sort(found.amplification)[2])
    assert found.within(limit).sum() == 3  # itself among them
    lost = Poses(found.q, found.x, found.signature, np.arange(6) > 3, found.amplification)
    assert lost.within(np.inf).tolist() == [False] * 4 + [True] * 2


def test_what_nothing_states_counts_as_known_to_a_thousand_sizes() -> None:
    """The base of the hexapod is not stated; a tolerance of the drawing counts as itself."""
    information = PoseInformation(machine_of("ups"))
    weight = dict(zip(information.names, information.weight, strict=True))
    unknown = [name for name in weight if name.startswith("base.")]
    assert len(unknown) == 6 and {weight[name] for name in unknown} == {1.0 / UNKNOWN}
    assert {round(value, 12) for name, value in weight.items() if name not in unknown} == {1.0}


def test_without_loops_nothing_is_amplified() -> None:
    serial, telescope = (PoseInformation(machine_of(name)) for name in ("serial", "pus"))
    assert (serial.at(poses(serial, 4)).amplification == 0.0).all()
    assert (telescope.at(poses(telescope, 4)).amplification > 0.0).all()


# -- moving poses --------------------------------------------------------------------------------------


def test_poses_are_never_moved_next_to_a_singularity() -> None:
    plain = landscape(machine_of("pus"), "d")
    q = poses(plain.information, 4)
    amplification = plain.information.at(q).amplification
    strict = Landscape(plain.information, plain.objective, strongest=float(1.001 * np.max(amplification)))
    found = climb(strict, q)
    information = plain.information
    assert information.at(found).within(strict.strongest).all()
    assert strict.value(information.at(found)) > strict.value(information.at(q))
    assert ((found >= information.low) & (found <= information.high)).all()
    below = Landscape(information, plain.objective, strongest=float(0.999 * np.max(amplification)))
    assert below.value(information.at(q)) == -np.inf


def test_poses_that_are_alike_are_moved_apart() -> None:
    """The same from the same seed; the joints that are given stay as they were."""
    function = landscape(machine_of("serial"), "d")
    q = np.tile(poses(function.information, 1), (3, 1))
    before, heard = q.copy(), list[str]()
    found = climb(function, q, 1, heard.append)
    assert len(np.unique(found, axis=0)) == 3
    np.testing.assert_array_equal(climb(function, q, 1), found)
    np.testing.assert_array_equal(q, before)
    values = [float(line.removeprefix("moving the poses: log det(J'J + prior) = ")) for line in heard]
    assert values == sorted(values) and len(values) > 1
    assert values[-1] == pytest.approx(function.value(function.information.at(found)), abs=1e-4)


# -- a plan --------------------------------------------------------------------------------------------


def made(random: list[float], **more: Any) -> Plan:
    machine, nothing = machine_of("serial"), None
    given: dict[str, Any] = {
        "machine": machine, "method": "exchange", "criterion": CRITERIA["d"], "seed": 0, "q": np.zeros((2, 3)),
        "span": np.ones(3), "origin": None, "value": 7.0, "random": np.array(random), "by_exchange": 7.0,
        "determined": 2, "indices": nothing, "left_out": 0,
    }  # fmt: skip
    return Plan(**{**given, **more})


def test_what_is_left_of_a_sigma_is_told_against_random_poses() -> None:
    """log det grows by twice the log of each direction's 1-sigma."""
    found = made([1.0, 5.0])
    assert found.by_chance == (3.0, 2.0)
    assert found.shrinkage == pytest.approx(np.exp(-1.0))
    assert made([1.0, 5.0], determined=0).shrinkage is None
    assert made([1.0, 5.0], criterion=CRITERIA["a"]).shrinkage is None
    assert made([1.0, -np.inf]).by_chance is None and made([1.0, -np.inf]).shrinkage is None


def test_poses_are_repeats_where_all_joints_are_as_near_as_a_share_of_their_ranges() -> None:
    span = np.array([100.0, 1.0, 2.0])
    q = np.array([[0.0, 0.0, 0.0], [1.0, 0.01, 0.02], [1.0, 0.02, 0.0], [50.0, 0.0, 0.0], [1.0, 0.01, 0.02]])
    counts = [made([1.0], q=q, span=span).repeats(share) for share in (0.0, 0.005, 0.0101, 0.02, 0.6)]
    assert counts == [1, 1, 3, 3, 4]


def test_a_plan_says_how_far_it_is_and_has_the_parts_that_it_says() -> None:
    heard = list[str]()
    found = plan(machine_of("distance"), 6, progress=heard.append)
    assert heard[:2] == ["looking at candidates", "exchanging poses"] and heard[2].startswith(
        "moving the poses: "
    )
    assert found.seed == 0 and found.method == "continuous" and found.criterion.name == "d"
    assert found.origin is not None and found.origin.tolist() == [0, 0, 1, 2, 3, 4]
    assert len(found.random) == DRAWS == len(set(found.random)) and found.left_out == 0
    random = plan(machine_of("distance"), 6, method="random")
    assert random.by_exchange is None and random.determined == found.determined
    assert random.value == pytest.approx(random.random[0], rel=1e-6)
    np.testing.assert_array_equal(random.random, found.random)
    assert found.span.tolist() == PoseInformation(found.machine).span.tolist()


@pytest.mark.parametrize(
    ("n", "options", "says"),
    [
        (1, {}, "found 1 poses, expected at least 2"),
        (3, {"method": "best"}, "found 'best', expected one of continuous, exchange, random"),
        (3, {"criterion": "z"}, "found 'z', expected one of d, a, o1, o2, o3, o4, o5"),
        (3, {"candidates": np.zeros((4, 3))}, "found 'continuous' with candidates, expected 'exchange' or 'random'"),
        (3, {"criterion": "o1"}, r"criterion o1: found 3 poses \(9 readings\), expected at least 13 readings"),
    ],
)  # fmt: skip
def test_plans_that_cannot_be_made_are_refused(n: int, options: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        plan(machine_of("serial"), n, **options)


def test_as_few_poses_as_can_be_are_planned() -> None:
    machine = machine_of("serial")
    assert len(plan(machine, 2, method="exchange").q) == 2
    enough = plan(machine, 8, criterion="o1", method="random")
    assert np.isfinite(enough.value) and enough.determined == 13
    candidates = np.vstack([poses(PoseInformation(machine), 9), np.zeros((1, 3))])
    found = plan(machine, 3, method="random", candidates=candidates)
    assert {row.tobytes() for row in found.q} <= {row.tobytes() for row in candidates}


def test_joints_without_a_range_are_not_rounded() -> None:
    machine = held(machine_of("serial"), q2=None)
    q = np.array([[1.23456789, 0.123456789, 0.23456789]])
    found = rounded(q, machine, 1e-3)
    assert found[0, 1] == q[0, 1] and found[0, 0] == pytest.approx(1.2) and found[0, 2] != q[0, 2]
    assert q[0, 0] == 1.23456789
