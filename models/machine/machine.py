"""A machine: its mechanism, where it stands, what it carries, what measures it and which physics it has.

Frames: the sensor sees ``world_T_base * base_T_flange(q) * flange_T_tool``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Protocol, TypeAlias

from truepose.errors import InputError
from truepose.models.file.driver import RECORDING, DeclaredDriver, Driver, DriverKind
from truepose.models.file.machine_file import MachineFile
from truepose.models.machine.mechanism import AXES, AXIS_UNITS, BASE, Mechanism, Parameter
from truepose.models.machine.placed import PlacedEffect
from truepose.models.machine.sensor import TOOL, TOOL_IN_WORLD, Channel, Sensor, View
from truepose.models.units import UnitSystem
from truepose.shown.result import Shown

FRAMES = ("base", "tool")
FRAME_OF: Mapping[str, str] = {f"{frame}.{axis}": frame for frame in FRAMES for axis in AXES}
"""The frame that each of the twelve parameters ``base.x`` ... ``tool.rz`` is of."""

WEIGHT = "weight|"
"""Load case of gravity alone, where measured forces push too."""


@dataclass(frozen=True)
class Port:
    """Where physics may act beside the parameters: ``of`` is a reading (displacement), a joint or mount (motion), or a
    sensor's column (reading)."""

    of: str
    kind: Literal["displacement", "motion", "reading"]
    unit: str


@dataclass(frozen=True)
class Mass:
    """A point mass in a body's frame (``tool`` for the tool frame): kg and centre, mm.

    The mass called ``payload`` takes its kg from the recording's column where there is one. ``parameters`` are
    NAME.kg, NAME.x, NAME.y and NAME.z where not all of them are exactly known; then ``kg`` and ``com`` are nominal.
    """

    name: str
    kg: float
    com: tuple[float, float, float]
    body: str
    parameters: tuple[Parameter, ...] = ()


@dataclass(frozen=True)
class Spring:
    """A spring or balancer between two points, each of a body's frame (mm): it pulls its ends together.

    ``constants`` are force (N), stiffness (N/mm) and free_length (mm), in this order; ``parameters`` the same as unknowns,
    where not all of them are exactly known.
    """

    name: str
    ends: tuple[tuple[str, tuple[float, float, float]], tuple[str, tuple[float, float, float]]]
    constants: Mapping[str, float]
    parameters: tuple[Parameter, ...] = ()


@dataclass(frozen=True)
class MeasuredForce:
    """A force (N) that three columns hold, and its moment (N m) in three more, if any: what pushes at ``body`` in the point
    ``at`` (mm) of its frame.

    ``axes``: the body or frame along whose axes the columns are given; ``sign`` -1: they hold what the machine pushes with.
    """

    name: str
    columns: tuple[str, ...]
    body: str
    at: tuple[float, float, float]
    axes: str
    sign: float = 1.0


@dataclass(frozen=True)
class Equipment:
    """What some recordings were measured with: ``files`` (patterns) or ``sessions`` say which.

    tool: x y z mm and roll pitch yaw rad on the flange in place of ``frames.tool``, or (``on_tool``) in its frame; mass: what
    is carried in place of the payload; date: when the file was begun, s since 1970.
    """

    name: str
    files: tuple[str, ...]
    sessions: tuple[int, ...]
    tool: tuple[float, ...] | None
    on_tool: bool
    mass: Mass | None
    date: float | None

    @property
    def driver(self) -> str:
        """What is 1 in their rows and 0 in others."""
        return f"{RECORDING}.{self.name}"


@dataclass(frozen=True)
class Mount:
    """A further frame of the machine file, a tip or where a sensor rides: on ``body`` (or ``tool``, ``base``, ``world``)."""

    name: str
    body: str


@dataclass(frozen=True, repr=False)
class Machine(Shown):
    """Everything the machine file says, in internal units (mm, rad).

    ``frames`` holds the twelve parameters base.x ... tool.rz (rpy angles), then six of each of ``mounts``, the file's
    further frames. ``set_up``: frames that are set up anew for each session. ``gravity`` is m/s^2 in the base frame.
    ``notes`` say what was taken from elsewhere than the file. ``drivers`` are names of columns; of those that
    ``declared_drivers`` holds, units are known.
    ``to_frame()``: constants, one a row: ``parameter``, ``value``, ``nominal`` (of the drawing), ``unit``, ``tolerance``,
    ``free``. mm, rad; coefficients of effects follow in their own units, NaN where there is no drawing.
    """

    name: str
    mechanism: Mechanism
    frames: tuple[Parameter, ...]
    sensors: tuple[Sensor, ...]
    gravity: tuple[float, float, float] | None = None
    masses: tuple[Mass, ...] = ()
    mounts: tuple[Mount, ...] = ()
    springs: tuple[Spring, ...] = ()
    forces: tuple[MeasuredForce, ...] = ()
    equipment: tuple[Equipment, ...] = ()
    effects: tuple[PlacedEffect, ...] = ()
    drivers: tuple[str, ...] = ()
    file: MachineFile | None = None
    notes: tuple[str, ...] = ()
    set_up: tuple[str, ...] = ()
    declared_drivers: tuple[DeclaredDriver, ...] = ()

    @property
    def mechanism_type(self) -> str:
        """What the file calls the type of its mechanism (``serial``, ``ups``); empty where there is no file."""
        return "" if self.file is None else str(self.file.mechanism.get("type", ""))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Geometry, frames, sensors, and masses that are not exactly known, in one fixed order."""
        sensor = tuple(p for s in self.sensors for p in s.parameters)
        return (*self.mechanism.parameters, *self.frames, *sensor, *self.pulling)

    @property
    def pulling(self) -> tuple[Parameter, ...]:
        """Constants of masses and springs that are not exactly known: only effects of loads show them."""
        weighing = (p for mass in (*self.masses, *self.own_payloads) for p in mass.parameters)
        return (*weighing, *(p for spring in self.springs for p in spring.parameters))

    @property
    def own_payloads(self) -> tuple[Mass, ...]:
        """Payloads that single recordings carry."""
        return tuple(own.mass for own in self.equipment if own.mass is not None)

    @property
    def standing(self) -> tuple[str, ...]:
        """Frames that something stands in: base, tool, and the file's further ones."""
        return (*FRAMES, *(mount.name for mount in self.mounts))

    @property
    def views(self) -> tuple[View, ...]:
        """What the sensors read and from where, each once; first the tool seen from the world."""
        return tuple(dict.fromkeys((TOOL_IN_WORLD, *(sensor.view for sensor in self.sensors))))

    @property
    def units(self) -> UnitSystem:
        """Units that its file, and recordings of it, are written in."""
        return self.file.units if self.file else UnitSystem()

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Residual components of every sensor, in order."""
        return tuple(channel for sensor in self.sensors for channel in sensor.channels)

    @property
    def residual_units(self) -> Mapping[str, str]:
        """Internal unit of each kind of residual component."""
        return {channel.kind: channel.unit for channel in self.channels}

    @cached_property
    def geometry(self) -> Mapping[str, Parameter]:
        """Every parameter by name."""
        return {parameter.name: parameter for parameter in self.parameters}

    @cached_property
    def nominal_values(self) -> Mapping[str, float]:
        """Value of every parameter in the nominal model, mm and rad, which a calibrated file keeps beside its own.

        Formulas that hold numbers of the geometry take them from here: a fit, and the file of it, then are the same model.
        """
        kept = {} if self.file is None else self.file.nominal
        return {p.name: kept.get(p.name, p.nominal) for p in self.parameters}

    @property
    def parameter_units(self) -> Mapping[str, str]:
        """Internal unit of every parameter, then of every coefficient of its effects, by name."""
        units = {parameter.name: parameter.unit for parameter in self.parameters}
        for effect in self.effects:
            units |= {n: c.unit for n, c in zip(effect.parameter_names, effect.coefficients, strict=True)}
        return units

    @cached_property
    def ports(self) -> Mapping[str, Port]:
        """Ports by name: displacements, error motions of joints and of mounts, readings."""
        out = {a.displacement: Port(a.reading, "displacement", a.unit) for a in self.mechanism.actuators}
        driven = self.mechanism.driven
        for part in (*(j.name for j in self.mechanism.tree if j.name in driven), *self.standing):
            out |= {f"{part}.motion.{axis}": Port(part, "motion", unit) for axis, unit in AXIS_UNITS.items()}
        for sensor in self.sensors:
            out |= {f"{c}.reading": Port(c, "reading", sensor.columns[c]) for c in sensor.shiftable}
        return out

    def column_unit(self, reading: str) -> str:
        """Return the unit of a joint's column unless its header says otherwise: counts, or that of the file."""
        actuator = self.mechanism.actuator(reading)
        return actuator.counted or self.units.of_joint(actuator.reading_unit)

    def ports_of(self, *kinds: str) -> set[str]:
        """Names of the ports of these kinds."""
        return {name for name, port in self.ports.items() if port.kind in kinds}

    def unit_of(self, name: str) -> str:
        """Unit of a parameter or of what is added at a port."""
        return self.ports[name].unit if name in self.ports else self.geometry[name].unit

    @property
    def weighs(self) -> bool:
        """Whether gravity and at least one mass are known."""
        return self.gravity is not None and any(self.gravity) and bool(self.masses or self.own_payloads)

    @property
    def stated_loads(self) -> bool:
        """Whether anything is known to pull: masses in gravity, springs, or measured forces."""
        return self.weighs or bool(self.springs or self.forces)

    @property
    def loaded(self) -> bool:
        """Whether effects may ask for loads: elastic legs balance the weight themselves."""
        return self.stated_loads and self.mechanism.loops != "elastic"

    @property
    def weight_case(self) -> str:
        """The load case of gravity alone, which knows which way is down."""
        return WEIGHT if self.forces and self.weighs else ""

    @property
    def force_columns(self) -> tuple[str, ...]:
        """Columns of measured forces, each once."""
        return tuple(dict.fromkeys(column for force in self.forces for column in force.columns))

    @property
    def load_cases(self) -> tuple[str, ...]:
        """What pulls: ``""`` for all stated masses, springs and forces; without any, 1 kg at each far body's origin.

        A compliance can then be seen although nobody weighed the arm: its product with the mass is found.
        """
        if self.loaded:
            return tuple(dict.fromkeys(("", self.weight_case)))
        if self.gravity is None or not any(self.gravity) or self.masses or self.mechanism.passive:
            return ()
        return (*(f"{joint.child}|" for joint in self.mechanism.tree[1:]), "tool|")

    def declared(self, driver: str) -> DeclaredDriver | None:
        """What the file, or a user who tries columns, says of a driver, with memory or without."""
        column = Driver.of(driver).now.name
        return next((known for known in self.declared_drivers if known.name == column), None)

    def driver_unit(self, driver: str) -> str:
        """Its unit inside the program; empty where nobody knows."""
        known = self.declared(driver)
        return known.unit if known else Driver.of(driver).unit(self.mechanism.reading_units)

    def drives(self, driver: str) -> DriverKind | None:
        """In which way a driver makes an error vary; None where nobody knows."""
        known = self.declared(driver)
        return known.drives if known else Driver.of(driver).drives

    def motion(self, reading: str, axis: str) -> str:
        """Port of one error motion (x y z mm, rx ry rz rad) of the joint that ``reading`` drives."""
        return f"{self.mechanism.actuator(reading).drives}.motion.{axis}"

    def with_effects(self, effects: tuple[PlacedEffect, ...]) -> Machine:
        """The same machine with these effects and no others."""
        return replace(self, effects=effects)


def body_of(mechanism: Mechanism, name: str) -> str | None:
    """Body that the ``in`` of a mass or frame means: a body, ``flange``, ``platform``, ``tool`` (kept) or ``base``."""
    if name in (TOOL, BASE) or name in mechanism.bodies:
        return name
    return {"flange": mechanism.flange, "platform": mechanism.platform}.get(name)


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
