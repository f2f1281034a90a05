"""Drivers that a machine file declares, with the units that they have inside the program."""

from __future__ import annotations

from truepose.errors import InputError
from truepose.models.driver import DeclaredDriver, Driver, driven_by_unit
from truepose.models.driver_entry import DriverSpec
from truepose.models.machine_file import MachineFile
from truepose.models.mechanism import Mechanism
from truepose.models.units import INTERNAL, compatible, parse_unit


def declared_drivers(file: MachineFile, mechanism: Mechanism) -> tuple[DeclaredDriver, ...]:
    """What the file says of each driver, of a name that stands twice the first. Raises InputError naming the field.

    A name alone is a driver whose kind says the rest (``temperature.base``); a joint's is none.
    """
    out: dict[str, DeclaredDriver] = {}
    for k, spec in enumerate(file.drivers):
        where = f"{file.path}: drivers[{k}]"
        if spec.name in mechanism.readings:
            if spec.unit is not None:
                raise InputError(
                    f"{where}.name: found {spec.name!r}, a joint, expected a column beyond the joints"
                )
            continue
        out.setdefault(spec.name, _declared(spec, mechanism, where))
    return tuple(out.values())


def _declared(spec: DriverSpec, mechanism: Mechanism, where: str) -> DeclaredDriver:
    driver = Driver.of(spec.name)
    own = driver.unit(mechanism.reading_units)
    written = spec.unit
    if written is not None:
        written = parse_unit(written, own or "any", f"{where}.unit")
    return declared_driver(spec.name, own, written or own, spec)


def declared_driver(
    name: str, own: str, written: str, spec: DriverSpec, *, tried: bool = False
) -> DeclaredDriver:
    """A driver whose columns are ``written`` in a unit (empty: as they are); ``own``: that of its kind, where it has one."""
    unit = own or internal_unit(written)
    drives = spec.drives or Driver.of(name).drives or driven_by_unit(unit)
    return DeclaredDriver(name, unit, written, drives, tried)


def internal_unit(unit: str) -> str:
    """The program's own unit of the same dimension; the unit itself where it has none."""
    return next((own for own in INTERNAL.values() if compatible(unit, own)), unit)


__all__ = ["declared_driver", "declared_drivers", "internal_unit"]
