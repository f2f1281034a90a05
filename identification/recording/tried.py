"""Columns that nobody declared, as drivers: those that a user tries, and what joints' drives hold, which needs none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from truepose.errors import InputError
from truepose.identification.recording.load import Sources, load_recording, tables
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import Table
from truepose.models.file.driver import MEASURED_LOADS, DeclaredDriver, Driver
from truepose.models.file.sections import DriverEntry
from truepose.models.machine.columns import declared_driver
from truepose.models.machine.machine import Machine
from truepose.wording import close_matches


def try_columns(machine: Machine, source: Sources, names: Sequence[str] = ()) -> Machine:
    """The machine with undeclared columns of a recording as drivers: the ``names``, or all that hold numbers which vary.

    A recording that is loaded for it has them, and ``diagnose`` weighs what they drive, each at a share of the prior that the
    number of them divides. Raises InputError for a name that is no such column.
    """
    files = tables(source, machine.mechanism.readings)
    untried = load_recording(machine, files, need_observations=False).untried
    known = [d.name for d in machine.declared_drivers]
    for name in names:
        if name not in untried and name not in known:
            raise InputError(
                f"--try-columns: found {name!r}, expected a column of numbers that vary and that nothing else reads; "
                f"{close_matches(name, untried) or 'this recording has none'}"
            )
    wanted = [name for name in untried if name in names or not names]
    return _with(machine, [_tried(machine, files[0], name) for name in wanted])


def with_measured_loads(machine: Machine, recording: Recording) -> Machine:
    """The machine with the torques and currents of its joints that were recorded as drivers."""
    of_joints = [n for n in recording.drivers if Driver.of(n).kind in MEASURED_LOADS]
    missing = [n for n in of_joints if n not in machine.drivers]
    units = machine.mechanism.reading_units
    added = [declared_driver(n, Driver.of(n).unit(units), "", DriverEntry(name=n)) for n in missing]
    return _with(machine, added)


def tried(machine: Machine) -> tuple[str, ...]:
    """Names of the columns that are tried."""
    return tuple(driver.name for driver in machine.declared_drivers if driver.tried)


def _tried(machine: Machine, table: Table, name: str) -> DeclaredDriver:
    own = Driver.of(name).unit(machine.mechanism.reading_units)
    return declared_driver(name, own, table.unit(name, own, own or "any"), DriverEntry(name=name), tried=True)


def _with(machine: Machine, added: Sequence[DeclaredDriver]) -> Machine:
    if not added:
        return machine
    return replace(
        machine,
        drivers=(*machine.drivers, *(driver.name for driver in added)),
        declared_drivers=(*machine.declared_drivers, *added),
    )
