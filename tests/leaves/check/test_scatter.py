"""Rows that count from others, and replicates: which rows are taken together, and what their scatter says of sigma."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import truepose
from support import MACHINES
from support.checked_arm import EXACT, document, rig_of
from truepose.identification.identifiability.analysis import drawn_poses
from truepose.identification.leaves.check.pair import Pair, chosen
from truepose.identification.leaves.check.result import Found
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.leaves.check.stated_sigma import SIGMA_FAR, sigmas


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """Readings with the noise that is stated."""
    exact = rig_of(tmp_path_factory.mktemp("rig"), document(sensor=EXACT), rows=40)
    return replicated(exact, 1.0, 1.0, 40, 1)


def test_rows_that_count_from_others_are_judged_with_these() -> None:
    """The first row of each motion, and the row that it starts at; repeats and rows at rest are no motions."""
    machine = truepose.load_machine(MACHINES / "distance.yaml")
    rows = drawn_poses(machine, 12)
    q = rows.q.copy()
    q[7], q[3] = q[5], q[2]
    q[9] = q[0]
    q[10, 1:] = q[4, 1:]  # of one joint only: it has moved
    origin = np.array([0, 0, 0, 2, 4, 4, 4, 4, 8, 0, 4, 11])
    names = [name for sensor in machine.sensors for name in sensor.columns]
    read = replace(rows, q=q, from_row=origin, observations={name: np.zeros(12) for name in names})
    rig = Rig(machine, read)
    # 3, 4, 8, 9, 11 have not moved; 7 is 5 again; 4 is where others start
    assert chosen(machine, rig.scene).tolist() == [0, 1, 2, 4, 5, 6, 10]
    lost = np.isin(np.arange(12), [2, 5])
    # the other of the two alike comes first now
    assert chosen(machine, replace(rig.scene, lost=lost)).tolist() == [0, 1, 4, 6, 7, 10]
    still = replace(rig.scene, rows=replace(read, q=np.tile(q[:1], (12, 1))))
    assert chosen(machine, still).tolist() == [0]
    nothing = replace(rig.scene, lost=np.ones(12, dtype=bool))
    assert len(chosen(machine, nothing)) == 0


def replicated(rig: Rig, xyz: float, rot: float, groups: int = 6, times: int = 5, **more: Any) -> Rig:
    """Poses read several times each, all of them with a scatter of their own in sigmas."""
    rng = np.random.default_rng(8)
    rows = rig.recording.subset(np.tile(np.arange(groups), times))
    sigma = np.array([0.03] * 3 + [np.radians(0.005)] * 3) * np.array([xyz] * 3 + [rot] * 3)
    names = ("x", "y", "z", "rx", "ry", "rz")
    seen = {
        n: rows.observations[n] + s * rng.standard_normal(len(rows))
        for n, s in zip(names, sigma, strict=True)
    }
    return Rig(rig.machine, replace(rows, observations=seen, **more))


def scatters(rig: Rig, price: float = 1.0) -> dict[str, Found]:
    return {f.where[0]: f for f in sigmas(rig, rig.stand(), price)}


@pytest.mark.parametrize(
    ("xyz", "rot", "kinds"),
    [
        (1.0, 1.0, []), (7.0, 0.14, []), (14.0, 1.0, ["xyz"]), (1.0, 0.07, ["rot"]), (0.07, 14.0, ["xyz", "rot"]),
    ],
)  # fmt: skip
def test_a_sigma_is_far_from_its_scatter_beyond_a_factor_of_ten(
    xyz: float, rot: float, kinds: list[str], rig: Rig
) -> None:
    assert SIGMA_FAR == 10.0
    found = scatters(replicated(rig, xyz, rot))
    assert list(found) == [f"sensor.sigma.{kind}" for kind in kinds]
    for kind, size, stated, unit in (("xyz", xyz, 0.03, "mm"), ("rot", rot, np.radians(0.005), "rad")):
        if kind in kinds:
            one = found[f"sensor.sigma.{kind}"]
            assert one.after is not None
            # six groups of five: 72 readings are free, and a middle of six
            assert one.after == pytest.approx(size * stated, rel=0.25) and one.before == pytest.approx(stated)
            assert (one.unit, one.verdict) == (unit, "suspect")


@pytest.mark.parametrize(("times", "groups", "told"), [(2, 1, False), (9, 1, False), (2, 2, True)])
def test_two_groups_with_six_spare_readings_tell_a_scatter(
    times: int, groups: int, told: bool, rig: Rig
) -> None:
    """Three readings of a kind in each row."""
    assert bool(scatters(replicated(rig, 100.0, 100.0, groups, times))) == told


def test_rows_of_other_sessions_sides_or_loads_are_no_replicates(rig: Rig) -> None:
    n = 12
    rows = {"session": np.arange(1, n + 1)}, {"drivers": {"payload": np.arange(float(n))}}
    sides = {"drivers": {"approach.q1": np.arange(float(n))}}
    heat = {"drivers": {"temperature": np.arange(float(n))}}
    for more, told in ((rows[0], False), (rows[1], False), (sides, False), (heat, True), ({}, True)):
        assert bool(scatters(replicated(rig, 100.0, 100.0, 2, 6, **more))) == told
    held = replicated(rig, 100.0, 100.0, 2, 6, validation=np.arange(n) > 1)
    assert not scatters(held)


def test_without_replicates_all_that_is_left_bounds_a_sigma(rig: Rig) -> None:
    """From above only: more may be physics."""
    assert scatters(rig, 0.11) == {} and scatters(rig, 30.0) == {}
    assert scatters(rig, 1e-12) == {}  # so few rows that the fit meets them all
    found = scatters(rig, 0.09)
    assert list(found) == ["sensor.sigma.xyz", "sensor.sigma.rot"]
    one = found["sensor.sigma.xyz"]
    assert one.says == "everything that is left varies by 0.0027 mm, sigma is stated as 0.03 mm"
    pair = Pair("m.yaml", "", {"sensor": [{"type": "level"}, {"sigma": {"xyz": 0.03, "rot": 0.005}}]}, ())
    assert one.mend is not None
    assert one.mend(pair).document["sensor"] == [{"type": "level"}, {"sigma": {"xyz": 0.0027, "rot": 0.005}}]
    turn = found["sensor.sigma.rot"]
    assert turn.mend is not None
    assert turn.mend(pair).get(("sensor", 1, "sigma", "rot")) == pytest.approx(0.00045, rel=0.02)
    alone = Pair("m.yaml", "", {"sensor": {"sigma": {"xyz": 0.03}}}, ())
    assert one.mend(alone).document == {"sensor": {"sigma": {"xyz": 0.0027}}}
    assert turn.mend(alone).document == alone.document
