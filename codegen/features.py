"""What the generated C offers, and what it leaves out of a machine file's physics.

It offers everything by default, or what a list names.

A list also asks for small code: what is not the way from a nearby guess is compiled for size on controllers, and what
nothing calls is left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from truepose.codegen.memory import followed
from truepose.errors import InputError
from truepose.models.file.driver import Driver
from truepose.models.machine.controllability import free_joints, machine_task
from truepose.models.machine.kinematics import driver_default, driver_names, symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.task import WHOLE, Task
from truepose.wording import joined, meant

FEATURES: Final[Mapping[str, str]] = {
    "warm": "fk, jac, ik from a nearby guess, compensate; always there",
    "cold": "ik goes on from other starts where the guess does not lead to the pose",
    "branches": "ik_all: every solution of an open chain of six readings",
    "p": "parameters at run time; without it the calibrated ones are built in, and p must be NULL",
    "batch": "NAME_batch.c: many poses a call",
    "state": "NAME_state.c: drivers that remember (direction of motion, lagged heat), worked out in every control cycle",
}
"""Names and what they stand for."""


@dataclass(frozen=True)
class Features:
    """``listed``: whether someone asked for these and for nothing else; the others are those of ``FEATURES``."""

    cold: bool = True
    branches: bool = True
    p: bool = True
    batch: bool = True
    state: bool = True
    listed: bool = False

    @classmethod
    def of(cls, text: str) -> Features:
        """Features of a list, separated by commas. Raises InputError that lists what exists."""
        names = [name.strip() for name in text.split(",")]
        unknown = [name for name in names if name not in FEATURES]
        if unknown:
            hint = meant(unknown[0], FEATURES)
            raise InputError(
                f"features: found {unknown[0]!r}, expected one or several of {joined(FEATURES)}, separated by commas"
                + (f"; {hint}" if hint else "")
            )
        chosen = {name: name in names for name in FEATURES if name != "warm"}
        return cls(**chosen, listed=True)

    @property
    def names(self) -> tuple[str, ...]:
        """Those that are on, in the order of ``FEATURES``."""
        return tuple(name for name in FEATURES if name == "warm" or getattr(self, name))


ALL: Final = Features()


@dataclass(frozen=True)
class LeftOut:
    """calibrated: whether the file came from a fit; stated: whether it has effects; sensor: labels of effects that move no
    tool; memory: labels of effects that depend on what was before, which is not followed; frames: further ones of the
    machine; drivers: value and unit where the controller gives none; followed: those of them that ``NAME_state`` works out;
    task: which components of a pose its inverse meets; near: whether it has commands next to singular poses."""

    calibrated: bool
    stated: bool
    sensor: tuple[str, ...]
    memory: tuple[str, ...]
    frames: tuple[str, ...]
    drivers: Mapping[str, tuple[float, str]]
    followed: tuple[str, ...] = ()
    task: Task = WHOLE
    near: bool = False


def left_out(machine: Machine, features: Features = ALL) -> LeftOut:
    """What the C of a machine holds and leaves out."""
    sensor = [e.label for e in machine.effects if not e.moves_tool]
    memory = [
        e.label
        for e in machine.effects
        if any(Driver.of(name).numbers for name in e.drivers) and e.label not in sensor and not features.state
    ]
    names = driver_names(machine, machine.effects)
    readings = machine.mechanism.readings
    own = [name for name in names if features.state and followed(Driver.of(name), readings)]
    drivers = {name: (driver_default(machine, name), machine.driver_unit(name) or "1") for name in names}
    calibrated = machine.file is not None and bool(machine.file.nominal)
    frames = tuple(mount.name for mount in machine.mounts)
    stated, task = bool(machine.effects), machine_task(machine)
    near = not task.is_whole and bool(free_joints(symbolic_model(machine, machine.effects), task))
    return LeftOut(calibrated, stated, tuple(sensor), tuple(memory), frames, drivers, tuple(own), task, near)


def left_out_words(found: LeftOut) -> list[str]:
    """The same in sentences, for README.md and the terminal."""
    if found.calibrated:
        said = ["The machine file was calibrated: without p the code has its values."]
    else:
        what = "the effects that the file states" if found.stated else "corrects nothing"
        said = [f"The machine file was not calibrated: the code has the drawing's constants and {what}."]
    if not found.task.is_whole:
        said.append(
            f"Of a pose ik and compensate meet {found.task.words}; code 0 says nothing of the rest."
            + (" Next to a singular pose a joint may move far for it." if found.task.position else "")
        )
    if found.near:
        said.append(
            "There compensate returns 1; compensate_near meets the position, and says how much of the turn is left."
        )
    if found.sensor:
        said.append(f"Left out, because it moves no tool: {joined(found.sensor)}.")
    if found.memory:
        said.append(
            f"Memory is left out: {joined(found.memory)} depends on what was before, which the code does not follow; the"
            " controller gives its state in z, else it rests."
        )
    if found.frames:
        said.append(
            f"Poses are those of the tool on the flange; the code has no other frame ({joined(found.frames)})."
        )
    if found.followed:
        said.append(
            f"Depends on what was before: {joined(found.followed)}. The code's _state works it out from every motion and what"
            " is sensed; without it, it rests."
        )
    held = [_held(name, *value) for name, value in found.drivers.items() if name not in found.followed]
    if held:
        said.append(f"Held still unless z gives it: {joined(held)}.")
    return said


def _held(name: str, value: float, unit: str) -> str:
    return f"{name} at {value:.12g}" + ("" if unit == "1" else f" {unit}")


def left_out_json(found: LeftOut) -> dict[str, object]:
    """The same as data."""
    drivers = {name: {"value": value, "unit": unit} for name, (value, unit) in found.drivers.items()}
    return {
        "sensor": list(found.sensor),
        "memory": list(found.memory),
        "frames": list(found.frames),
        "drivers": drivers,
        "followed": list(found.followed),
    }
