"""Hostile input to the generated C under sanitizers: whatever comes in, every promise of the interface is kept."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

from support.examples import NIGHT, TIMES
from support.generated_c import CASES, needs_compiler
from support.generated_machines import machine_of
from support.hostile import answers, functions, hostile_program
from support.simulated import machine_from
from truepose.codegen.features import ALL, Features
from truepose.codegen.printer import Real
from truepose.models.machine.machine import Machine

pytestmark = pytest.mark.nightly
Counts = Mapping[str, tuple[int, ...]]

ROUNDS = 120 * TIMES
"""Of each machine: with fewer, some function meets hostile input that it refuses ten times or less."""
TURN_ABOUT = [case for k, case in enumerate(CASES) if case[0] in ("arm", "rails") or (k % 2 == 0)]
"""An open chain and a closed one in either precision, the other machines in one of them: templates are the same in both."""
TRIED = CASES if NIGHT else TURN_ABOUT
IDS = ["-".join(case) for case in TRIED]
MOUNT = """schema: truepose/machine/1
name: mount
mechanism:
  type: mount
  kind: alt-az
  latitude: 39
  first: {offset: 3, range: [-20, 200]}
  second: {offset: -1, tilt: 0.3, range: [-80, 260]}
frames: {base: {in: world, rpy: [0.4, -0.2, 0]}, tool: {in: flange, rpy: [0, 0, 0.5]}}
sensor: {type: direction, sigma: {angle: 1 arcsec}}
"""
PARTS = [
    ("arm", "warm"),
    ("rails", "warm,state"),
    ("rails", "warm,p,batch"),
    ("arm", "warm,cold,branches,p,batch,state"),
]
IN_PART: list[tuple[str, str, Real]] = [
    (*part, real)
    for k, part in enumerate(PARTS)
    for real in (("double", "float") if NIGHT else (("double", "float")[k % 2],))
]
"""As above: in either precision at night."""
RARE = ("state_init",)
"""Called once in 64 rounds."""


def tried(
    machine: Machine, folder: Path, real: Real, flags: list[str], features: Features | str = ALL
) -> tuple[Counts, set[str]]:
    """How often each function gave each code, none of them breaking a promise; and the functions that there are."""
    # nothing that the sanitizers watch is optimised away
    program = hostile_program(machine, folder / "out", real, ["-O0", *flags], features)
    found = answers(program, ROUNDS)
    assert found.code == 0, found.said
    return found.counts, functions(program)


@needs_compiler
@pytest.mark.parametrize(("name", "real"), TRIED, ids=IDS)
def test_hostile_input_keeps_every_promise(
    tmp_path: Path, sanitizers: list[str], name: str, real: Real
) -> None:
    counts, made = tried(machine_of(tmp_path, name), tmp_path, real, sanitizers)
    assert {"fk", "fk_from", "ik", "jac", "compensate", "fk_n", "ik_n", "compensate_n"} <= made
    assert ("ik_all" in made) or name not in ("arm", "nano")
    for function, by_code in counts.items():
        assert (sum(by_code) > 0) == (function in made), function
        if function in made and function not in RARE:
            assert by_code[0] > 10, (function, by_code)
            assert by_code[4] > 10, (function, by_code)
    assert sum(counts["ik"][1:4]) > 5


@needs_compiler
@pytest.mark.parametrize(("name", "features", "real"), IN_PART, ids=lambda part: part)
def test_what_is_generated_in_part_keeps_them_too(
    tmp_path: Path, sanitizers: list[str], name: str, features: str, real: Real
) -> None:
    counts, made = tried(machine_of(tmp_path, name), tmp_path, real, sanitizers, features=features)
    assert {function for function, by_code in counts.items() if sum(by_code)} == made
    wanted = {"batch": "fk_n", "state": "state_update", "branches": "ik_all"}
    asked = set(features.split(",")) & set(wanted)
    assert {word for word, function in wanted.items() if function in made} == asked


@needs_compiler
@pytest.mark.parametrize("real", ["double", "float"])
def test_two_axes_that_point_keep_them_too(tmp_path: Path, sanitizers: list[str], real: Real) -> None:
    counts, made = tried(machine_from(tmp_path, MOUNT, "mount"), tmp_path, real, sanitizers)
    assert "point" in made and counts["point"][0] > 10 and counts["point"][4] > 10
