"""Laws of readings before the machine stood: shares of the motion, and what leaves them out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

import truepose
from support.simulated import machine_from
from truepose.codegen.features import left_out
from truepose.models.effect_text import parse_effect
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import PlacedEffect

Array = NDArray[np.float64]
ARM = """schema: truepose/machine/1
name: planar
units: {angle: rad}
mechanism:
  type: serial
  joints:
    - {name: a, kind: revolute, range: [-2, 2]}
    - {name: b, kind: revolute, d: 300, range: [-2, 2]}
    - {name: s, kind: prismatic, alpha: 1.5707963267948966, range: [-100, 100]}
frames: {tool: {in: flange, xyz: [200, 0, 0]}}
sensor: {type: position, sigma: {xyz: 0.01}}
"""
TURNS = "    - {name: s, kind: prismatic, alpha: 1.5707963267948966, range: [-100, 100]}\n"
VISITS = np.array(
    [[0.0, 0.0, 0.0], [1.0, -0.5, 10.0], [1.0, -0.5, 10.0], [0.7, 0.3, -40.0], [-0.2, 0.3, 60.0]]
)


@pytest.fixture
def arm(tmp_path: Path) -> Machine:
    """Two turning joints in a plane."""
    return machine_from(tmp_path, ARM.replace(TURNS, ""), "arm")


@pytest.fixture
def mixed(tmp_path: Path) -> Machine:
    """The same with a slide behind them."""
    return machine_from(tmp_path, ARM, "mixed")


def table(q: Array, **columns: object) -> pd.DataFrame:
    return pd.DataFrame({name: q[:, k] for k, name in zip(range(q.shape[1]), "abs", strict=False)} | columns)


def seen(machine: Machine, rows: pd.DataFrame, effects: tuple[PlacedEffect, ...] = ()) -> Array:
    """(n, 3) where the tool is predicted."""
    return truepose.predict(machine.with_effects(effects), rows)[["x", "y", "z"]].to_numpy()


def effect(machine: Machine, text: str) -> tuple[PlacedEffect, ...]:
    return (parse_effect(f"early-reading@{text}", machine),)


def plane(q: Array) -> Array:
    """(n, 2) the planar arm's tool, written out."""
    a, b = q[:, 0], q[:, 0] + q[:, 1]
    return np.column_stack([300 * np.cos(a) + 200 * np.cos(b), 300 * np.sin(a) + 200 * np.sin(b)])


@pytest.mark.parametrize(
    ("text", "left"),
    [
        # e of the joint with the longest way; nothing where the arm did not move
        ("a+b:e=0.002", [[0, 0], [0.002, -0.001], [0, 0], [-0.00075, 0.002], [-0.002, 0]]),
        ("b:e=-0.002", [[0, 0], [0, 0.001], [0, 0], [0, -0.002], [0, 0]]),
        ("a+b:f=0.001,whole=1", [[0, 0], [0.001, -0.0005], [0, 0], [-0.0003, 0.0008], [-0.0009, 0]]),
    ],
)
def test_what_is_left_of_the_way_is_a_share_of_every_step(arm: Machine, text: str, left: Array) -> None:
    q = VISITS[:, :2]
    found = seen(arm, table(q), effect(arm, text))
    np.testing.assert_allclose(found[:, :2], plane(q - np.array(left)), atol=1e-9)


def test_ways_of_slides_and_turning_joints_are_compared_by_half_ranges(mixed: Machine) -> None:
    """From the fourth visit to the fifth the slide goes a whole half range, the joints less: it stands e * 100 mm short."""
    part = effect(mixed, "a+b+s:e=0.001")
    assert part[0].coefficients[0].unit == "1"
    short = table(
        VISITS - 0.001 * np.array([[0, 0, 0], [2, -1, 20], [0, 0, 0], [-0.6, 1.6, -100], [-0.9, 0, 100]])
    )
    apart = seen(mixed, table(VISITS), part) - seen(mixed, short)
    np.testing.assert_allclose(apart, 0.0, atol=1e-9)


def test_sessions_begin_at_rest_and_time_counts(arm: Machine) -> None:
    q, part = VISITS[:, :2], effect(arm, "a+b:e=0.002")
    clock = np.arange(5.0)
    order = [3, 0, 4, 2, 1]
    found = seen(arm, table(q, time=clock), part)
    np.testing.assert_allclose(seen(arm, table(q[order], time=clock[order]), part), found[order], atol=1e-12)
    apart = seen(arm, table(q, session=[1, 1, 1, 2, 2]), part)
    np.testing.assert_allclose(apart[3], seen(arm, table(q))[3], atol=1e-12)


def test_rows_that_are_shuffled_are_predicted_at_rest(arm: Machine) -> None:
    machine = arm.with_effects(effect(arm, "a+b:e=0.002"))
    rows = truepose.load_recording(machine, table(VISITS[:, :2]), need_observations=False, shuffled=True)
    found = truepose.predict(machine, rows)[["x", "y", "z"]].to_numpy()
    np.testing.assert_allclose(found, seen(arm, table(VISITS[:, :2])), atol=1e-12)


def test_a_tool_that_follows_a_path_is_not_read_before_it_stands(arm: Machine) -> None:
    """Nothing is to compensate, and the C holds the last motion at nothing; play is compensated by the path's own order."""
    early = arm.with_effects(effect(arm, "a+b:e=0.002"))
    path = truepose.load_recording(arm, table(VISITS[:, :2]), need_observations=False)
    np.testing.assert_allclose(truepose.compensate(early, path).command, path.q, atol=1e-9)
    assert left_out(early).sensor == ("early-reading@a+b",)
    assert not left_out(early).memory
    play = arm.with_effects((parse_effect("backlash@a:b=0.002", arm),))
    moved = truepose.compensate(play, path).command - path.q
    np.testing.assert_allclose(moved[:, 0], 0.001 * np.array([0, 1, 1, -1, -1]), atol=1e-9)


def test_an_arm_of_many_joints_may_have_a_wrist_that_brakes_harder(arm: Machine, mixed: Machine) -> None:
    def known(machine: Machine, rows: pd.DataFrame) -> list[Mapping[str, float]]:
        read = truepose.load_recording(machine, rows, need_observations=False)
        kind = effect(machine, "a:e=0.001")[0].effect
        return list(kind.settings(machine, ("a",), read))

    assert known(arm, table(VISITS[:, :2])) == [{}, {"whole": 1.0}]
    assert known(mixed, table(VISITS)) == [{}, {"whole": 1.0}]
    moving = table(VISITS[:, :2], **{"velocity.a": [0.0, 0.1, 0.0, 0.0, 0.0]})
    assert known(arm, moving) == []
    joints = tuple(replace(a, reading=f"j{k}") for k in range(4) for a in arm.mechanism.actuators[:1])
    six = replace(arm, mechanism=replace(arm.mechanism, actuators=joints))
    kind = effect(arm, "a:e=0.001")[0].effect
    still = truepose.load_recording(arm, table(VISITS[:, :2]), need_observations=False)
    assert {"wrist": 2.0} in kind.settings(six, ("j0",), still)
