"""What a machine file leaves out is what it would say with the default written out."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.built_machines import FRAMES, POSE
from support.moving_machines import written
from support.telescope_legs import leg_rows
from truepose.models.machine import Machine

HOME = "  home: [0, 0, 440, 0, 0, 5]\n  legs:\n"


def legs(kind: str, fields: str) -> str:
    return FRAMES + f"mechanism:\n  type: {kind}\n" + HOME + leg_rows(fields) + POSE


MECHANISMS = {
    "6-pus": (legs("6-pus", "length: 500"), legs("6-pus", "length: 500, offset: 0, gain: 1, u: [0, 0, 1]")),
    "6-ups": (legs("6-ups", "range: [480, 560]"), legs("6-ups", "range: [480, 560], offset: 0, gain: 1")),
}


def same(one: Machine, other: Machine) -> None:
    assert one.parameters == other.parameters
    assert one.mechanism == other.mechanism
    assert one.sensors == other.sensors


@pytest.mark.parametrize("name", MECHANISMS)
def test_what_a_leg_leaves_out_is_no_offset_a_gain_of_one_and_a_rail_upwards(
    tmp_path: Path, name: str
) -> None:
    short, long = (written(tmp_path, text, "m") for text in MECHANISMS[name])
    same(short, long)
