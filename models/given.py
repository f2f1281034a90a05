"""A machine, or a result that holds one in its place: what every public function takes."""

from __future__ import annotations

from typing import Protocol, TypeAlias

from truepose.errors import InputError
from truepose.models.machine.machine import Machine


class HoldsMachine(Protocol):
    """A result that holds a machine: an estimate, a calibration, a diagnosis."""

    @property
    def machine(self) -> Machine:
        """The machine with the values that were found."""
        ...


MachineLike: TypeAlias = Machine | HoldsMachine


def as_machine(given: MachineLike) -> Machine:
    """Return the machine itself, or the one that a result holds. Raises InputError for anything else."""
    found = given if isinstance(given, Machine) else getattr(given, "machine", None)
    if not isinstance(found, Machine):
        hint = "; load_machine reads a file" if isinstance(given, str) or hasattr(given, "__fspath__") else ""
        raise InputError(
            f"machine: found {type(given).__name__}, expected a machine or a result of calibrate, diagnose or estimate{hint}"
        )
    return found
