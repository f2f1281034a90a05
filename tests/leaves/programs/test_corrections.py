"""Corrections asked of the library: refusals with their reasons, what a controller would do elsewhere, what was assumed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from support import MACHINES
from support.command import input_error
from support.program_robots import (
    RANGES,
    Arm,
    arms,
    frame,
    joints,
    machine_file,
    numbers_of,
    status_turn,
)
from truepose.arrays import Array
from truepose.identification.leaves.programs.correct import Correction, correct
from truepose.identification.leaves.programs.dialects import DIALECTS
from truepose.identification.leaves.programs.frames import Cell
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

DRAWN, REAL = arms()
GUN = frame((30.0, 0.0, 150.0, 0.0, 80.0, 15.0))


def corrected(machine: Machine, text: str, dialect: str = "kuka", **cell: Any) -> Correction:
    return correct(machine, DIALECTS[dialect].read(text, machine), Cell(**cell))


def axes(q: Array) -> str:
    return "PTP {" + ",".join(f"A{k + 1} {v:.10f}" for k, v in enumerate(np.degrees(q).tolist())) + "}\n"


def ptp(arm: Arm, q: Array) -> str:
    """A motion to where an arm's tool is, with status and turn."""
    status, turn = status_turn(DRAWN, q)
    return f"PTP {numbers_of(arm.pose(q), 'kuka')[:-1]},S {status},T {turn}}}\n"


def test_programs_of_other_robots_are_refused(machine: Machine) -> None:
    small = load_machine(MACHINES / "serial.yaml")
    pose = f"LIN {numbers_of(DRAWN.pose(joints(1)[0]), 'kuka')}\n"
    for text, says in (
        (
            axes(joints(1)[0]) + pose,
            "arm: found 3 joints, which meet x and z of .*, expected six, or fewer that meet x, y and z: a program's pose",
        ),
        (pose, "arm: found 3 joints, which meet"),
        (axes(joints(1)[0]), "arm: found 3 joints, expected 6 joints in angles and lengths, as the program"),
        ("DEF a()\n", "found no target in the program, expected poses or joints"),
    ):
        with input_error(says):
            corrected(small, text)
    three = DIALECTS["csv"].read("q1,q2,q3\n1,2,3\n", small)
    assert len(correct(small, three).done) == 1
    turning = tuple(replace(a, reading_unit="turn") for a in machine.mechanism.actuators[:2])
    odd = replace(
        machine,
        mechanism=replace(machine.mechanism, actuators=(*turning, *machine.mechanism.actuators[2:])),
    )
    program = DIALECTS["kuka"].read(axes(joints(1)[0]), machine)
    with input_error("found joints q1, q2 in turns, expected 6 joints in angles"):
        correct(odd, program)


def test_what_would_leave_the_range_or_swing_is_left_and_told(machine: Machine) -> None:
    """At either end of axis 1 the same change of it leads out of the range at one of them."""
    low, high = np.radians(RANGES).T
    q = np.tile(joints(1)[0], (2, 1))
    q[0, 0], q[1, 0] = low[0], high[0]
    found = corrected(machine, axes(q[0]) + axes(q[1]))
    assert len(found.done) == 1 and len(found.left) == 1
    assert found.left[0].why == "the correction would take q1 out of the range"
    stretched = joints(1)[0]
    stretched[4] = 3e-4  # the wrist is nearly straight: axes 4 and 6 are one
    (left,) = corrected(machine, axes(stretched)).left
    assert left.why.startswith("next to a singular pose: the correction would move q")
    told = float(left.why.rpartition(" by ")[2].removesuffix(" deg"))
    assert abs(told) > np.degrees(0.1)


def test_a_correction_without_a_nominal_drawing_is_of_effects_alone(tmp_path: Path) -> None:
    """The machine file's own constants are then the controller's, so that only the gain of axis 4 is corrected."""
    path = machine_file(tmp_path, REAL)
    text = path.read_text(encoding="utf-8")
    before, _, after = text.partition("nominal:")
    path.write_text(before + "effects:" + after.partition("effects:")[2], encoding="utf-8")
    bare, q = load_machine(path), joints(1)[0]
    (done,) = corrected(bare, axes(q)).done
    turned = np.radians([float(n) for n in done.numbers])
    expected = q.copy()
    expected[3] /= 1 + REAL.scale
    np.testing.assert_allclose(turned, expected, atol=1e-7)
