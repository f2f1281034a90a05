"""What a physics effect is: shifts at named ports as a function of coefficients, drivers and loads.

To add one, write a file like the others in this folder: a class with a ``slug``, ``places``,
``coefficients`` and ``shifts``, registered with ``@effects.add(slug)``. Screening, naming, reporting,
prediction and the generated C follow from it. At zero coefficients the machine is untouched.
"""

from __future__ import annotations

import difflib
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Protocol

import casadi as ca

from truepose.errors import InputError
from truepose.models.registry import Registry

if TYPE_CHECKING:
    from truepose.models.machine import Machine

SERIES = 24
"""From so many coefficients on an effect is a series, whose expected sizes are its prior."""
Place = tuple[str, ...]
Settings = Mapping[str, float]
Shifts = Mapping[str, ca.SX]


class Observed(Protocol):
    """What an effect may ask of a recording to choose its settings."""

    @property
    def n_sessions(self) -> int: ...

    def driver(self, name: str) -> object | None: ...


@dataclass(frozen=True)
class Coefficient:
    """One linear amplitude: unit, largest size to expect (prior scale) and physical bounds."""

    name: str
    unit: str
    scale: float
    lower: float = -float("inf")
    upper: float = float("inf")


@dataclass(frozen=True)
class Site:
    """Symbols an effect may use at its place. Readings in column units, drivers in internal units."""

    machine: Machine
    place: Place
    settings: Settings
    c: Mapping[str, ca.SX]
    q: Mapping[str, ca.SX]
    z: Mapping[str, ca.SX]
    values: Mapping[str, ca.SX]
    loads: Mapping[str, ca.SX] = field(default_factory=dict)
    states: Mapping[str, ca.SX] = field(default_factory=dict)

    def displacement(self, reading: str) -> ca.SX:
        """Displacement of a joint before the effect, mm or rad."""
        from truepose.models.assembly import displacement_of

        return displacement_of(self.machine, reading, self.values, self.q)

    def moved(self, reading: str) -> ca.SX:
        """Displacement that the reading alone makes: gain * reading, mm or rad."""
        actuator = self.machine.mechanism.actuator(reading)
        return (self.values[actuator.gain] if actuator.gain else 1) * self.q[reading]

    def port(self, reading: str) -> str:
        """Port that adds to a joint's displacement."""
        return self.machine.mechanism.actuator(reading).displacement

    def value(self, port: str) -> ca.SX:
        """Present value of a parameter; of a displacement port, the whole displacement."""
        if port.endswith(".displacement"):
            return self.displacement(port.removesuffix(".displacement"))
        return self.values[port]

    def driver(self, name: str) -> ca.SX:
        """A recorded driver (payload kg, temperature degC, time s, approach +-1 ...)."""
        return self.z[name]

    def load(self, port: str, case: str = "") -> ca.SX:
        """Gravity's conjugate load at a port: N along lengths, N m about angles; a probe ``case`` is 1 kg."""
        return self.loads[f"{case}{port}"]

    def direction(self, end: str) -> ca.SX:
        """(3,) unit vector along a universal or spherical joint's child, or along a rod at its end ``R.a``, ``R.b``,
        in the frame that the joint is fixed in (``truepose.models.states``)."""
        return ca.vertcat(*(self.states[f"axis.{end}.{axis}"] for axis in "xyz"))

    def turn(self, joint: str) -> ca.SX:
        """Angle of a passive revolute joint, rad (``truepose.models.states``)."""
        return self.states[f"turn.{joint}"]

    def seen(self, column: str) -> ca.SX:
        """What a sensor's column should read, mm or rad (the whole length where readings are changes)."""
        return self.states[f"seen.{column}"]

    def checked(self, port: str, who: object) -> str:
        """The port, if this machine has it."""
        if port not in self.values:
            close = difflib.get_close_matches(port, self.values, n=2)
            near = ", ".join(close) or "none"
            raise InputError(f"effect {who}: found no port {port!r} on {self.machine.name}; close: {near}")
        return port


class Effect(ABC):
    """A physics term. Class fields describe it to users; methods define it."""

    slug: ClassVar[str]
    title: ClassVar[str] = ""
    formula: ClassVar[str] = ""
    size: ClassVar[str] = ""
    look_alikes: ClassVar[tuple[str, ...]] = ()
    experiment: ClassVar[str] = ""
    source: ClassVar[str] = ""
    commonness: ClassVar[float] = 1.0
    """How often machines have it, in terms of the other effects: it decides between explanations that data leave equal."""
    needs_load: ClassVar[bool] = False
    settings_add: ClassVar[bool] = False
    """Whether terms of one place with different settings may stand together (orders) or exclude others."""
    continuous: ClassVar[tuple[str, ...]] = ()
    """Settings that are points of a continuum (a lag): one that was found is refined between its neighbours on the grid."""
    unvaried: ClassVar[str] = ""
    """Why a recording cannot speak of the effect where ``settings`` offers nothing; empty for the usual reasons."""

    @abstractmethod
    def places(self, machine: Machine) -> Sequence[Place]:
        """Where on this machine the effect may act."""

    @abstractmethod
    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        """Amplitudes to estimate at a place."""

    @abstractmethod
    def shifts(self, site: Site) -> Shifts:
        """What is added at which ports (mm, rad, or the parameter's own unit)."""

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        """Columns beyond the joints that the formula reads."""
        return ()

    def reads_load(self, settings: Settings) -> bool:
        """Whether the formula reads gravity loads with these settings."""
        return self.needs_load

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """Constants the formula is not linear in (order of a harmonic, lag): one candidate each."""
        return ({},)

    def screened(self, machine: Machine, place: Place) -> bool:
        """Whether a diagnosis should look for it there; where not, a user may still state it."""
        return True

    def weight(self, settings: Settings) -> float:
        """How likely settings are among those of a place, relative to each other."""
        return 1.0

    def twins(self, settings: Settings) -> Mapping[str, float]:
        """Effects whose signature is the same function here, with how likely each is relative to this one."""
        return {}

    def explain(self, machine: Machine, place: Place) -> str:
        """One sentence in plain words for the finding."""
        return f"{self.title or self.slug} at {', '.join(place)}"

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        """What the fitted coefficients say, in words; empty where the numbers speak for themselves."""
        return ""


effects: Registry[type[Effect]] = Registry("effect", "truepose.models.effects")


@dataclass(frozen=True)
class PlacedEffect:
    """An effect at a place with its settings and coefficient values."""

    effect: Effect
    place: Place
    settings: tuple[tuple[str, float], ...] = ()
    coefficients: tuple[Coefficient, ...] = ()
    drivers: tuple[str, ...] = ()
    amplitudes: tuple[float, ...] = ()
    spread: float = 100.0
    """Prior 1-sigma of the coefficients in a fit, in units of their scale."""

    @classmethod
    def at(
        cls,
        effect: Effect,
        machine: Machine,
        place: Place,
        settings: Settings | None = None,
        values: Mapping[str, float] | None = None,
    ) -> PlacedEffect:
        """Bind an effect to a place; coefficient values default to 0."""
        fixed = dict(settings or {})
        coefficients = effect.coefficients(machine, place, fixed)
        amplitudes = tuple(float((values or {}).get(c.name, 0.0)) for c in coefficients)
        drivers = effect.drivers(machine, place, fixed)
        spread = 1.0 if len(coefficients) >= SERIES else 100.0
        return cls(effect, place, tuple(sorted(fixed.items())), coefficients, drivers, amplitudes, spread)

    @property
    def settings_map(self) -> Settings:
        """Settings by name."""
        return dict(self.settings)

    @property
    def values(self) -> Mapping[str, float]:
        """Coefficient values by name."""
        return dict(zip((c.name for c in self.coefficients), self.amplitudes, strict=True))

    @property
    def needs_load(self) -> bool:
        """Whether the formula reads gravity loads."""
        return self.effect.reads_load(self.settings_map)

    @property
    def label(self) -> str:
        """``slug@place+place`` with settings, unique within a machine."""
        tail = "".join(f",{name}={value:g}" for name, value in self.settings)
        return f"{self.effect.slug}@{'+'.join(self.place)}{tail}"

    def with_values(self, amplitudes: Sequence[float]) -> PlacedEffect:
        """The same effect with other coefficient values, in order."""
        return replace(self, amplitudes=tuple(float(a) for a in amplitudes))

    def __str__(self) -> str:
        return self.label
