"""An effect at a place, as data: what a machine holds of its physics (what effects do: ``truepose.models.machine.effect``)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar, Final, NamedTuple, Protocol

import casadi as ca

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.file.driver import STEP, Driver, DriverKind
from truepose.models.file.limits import LARGEST, LATEST
from truepose.wording import close_matches


@dataclass(frozen=True)
class Allowed:
    """Numbers from ``low`` to ``high``; ``zero``: 0 among them; ``whole``: no fractions."""

    low: float = -LARGEST
    high: float = LARGEST
    zero: bool = True
    whole: bool = False

    def __contains__(self, value: float) -> bool:
        inside = self.low <= value <= self.high and (self.zero or value != 0.0)
        return inside and (not self.whole or value == round(value))

    def __str__(self) -> str:
        number = "a whole number" if self.whole else "a number"
        return f"{number} from {self.low:g} to {self.high:g}{'' if self.zero else ' that is not 0'}"


ANY: Final = Allowed()
COLUMN: Final = Allowed(-LATEST, LATEST)
"""Values of a logged column: nanoseconds since 1970 are one."""
DURATION: Final = Allowed(0.0, LATEST)
"""Differences of two values of a logged column."""
SWITCH: Final = Allowed(0.0, 1.0)
NOT_NEGATIVE: Final = Allowed(low=0.0)
POSITIVE: Final = Allowed(low=1e-12)
ORDER: Final = Allowed(-1e4, 1e4, zero=False)
"""How often something repeats in a turn or a pitch."""
COUNT: Final = Allowed(1.0, 60.0, whole=True)
"""Terms of a series, degrees of a polynomial: each is a column of every fit."""
HARMONIC: Final = Allowed(1.0, 180.0, whole=True)
"""Orders of a long series: time and memory of a fit grow as the square of their number."""
SettingRanges = Mapping[str, Allowed]
"""By name; a name that ends with a dot stands for all that begin with it: ``from.``."""


def ranges(known: Mapping[str, Allowed]) -> SettingRanges:
    """Of an effect, for its class."""
    return MappingProxyType(dict(known))


NO_SETTINGS: Final = ranges({})


def check_settings(effect: str, known: SettingRanges, settings: Mapping[str, float], where: str) -> None:
    """Refuse settings that an effect does not have, or that are out of range. Raises InputError."""
    for name, value in settings.items():
        allowed = known.get(name) or known.get(f"{name.partition('.')[0]}.")
        if allowed is None:
            hint = close_matches(name, known) or "it has none"
            raise InputError(f"{where}: {effect} has no setting {name!r}; {hint}")
        if value not in allowed:
            raise InputError(f"{where}: found {name}: {value:g}, expected {allowed}")


SERIES = 24
"""From so many coefficients on an effect is a series, whose expected sizes are its prior."""
Place = tuple[str, ...]
Settings = Mapping[str, float]
Shifts = Mapping[str, ca.SX]


class EffectAtPlace(NamedTuple):
    """The slug of an effect and where it acts, at whatever settings."""

    effect: str
    place: Place

    def __str__(self) -> str:
        return f"{self.effect}@{'+'.join(self.place)}"


@dataclass(frozen=True)
class Coefficient:
    """One linear amplitude: unit, largest size to expect (prior scale) and physical bounds."""

    name: str
    unit: str
    scale: float
    lower: float = -float("inf")
    upper: float = float("inf")


class Observed(Protocol):
    """What an effect may ask of a recording to choose its settings."""

    @property
    def n_sessions(self) -> int: ...

    def driver(self, name: str) -> object | None: ...

    def inferred(self, name: str) -> bool: ...


class Effect(ABC):
    """A physics term that knows where on a machine it may act. Class fields describe it to users; methods define it.

    ``machine`` is a ``Machine`` (``models/machine/machine.py``) and ``site`` a ``Site`` (``effect.py``). Both hold placed
    effects, so that their types have no name down here.
    """

    slug: ClassVar[str]
    title: ClassVar[str] = ""
    counted: ClassVar[bool] = False
    """Whether the title takes an article in a sentence: a compliant joint, but backlash."""
    sentence: ClassVar[str] = ""
    """What it does, in plain words, for the finding; ``{0}`` is the first name of its place, ``{all}`` are all of them."""
    forms: ClassVar[tuple[Settings, ...]] = ({},)
    """What ``settings`` offers whatever the machine and its recording."""
    formula: ClassVar[str] = ""
    size: ClassVar[str] = ""
    look_alikes: ClassVar[tuple[str, ...]] = ()
    experiment: ClassVar[str] = ""
    source: ClassVar[str] = ""
    commonness: ClassVar[float] = 1.0
    """How often machines have it, in terms of the other effects: it decides between explanations that data leave equal."""
    needs_load: ClassVar[bool] = False
    driven_by: ClassVar[DriverKind | None] = None
    """What makes it vary, where its load, its drivers and its place do not say so already (see ``driver_kind``)."""
    setting_ranges: ClassVar[SettingRanges | None] = None
    """What its settings may be, by name; None: any number, and the effect looks at them itself."""
    settings_add: ClassVar[bool] = False
    """Whether terms of one place with different settings may stand together (orders) or exclude others."""
    continuous: ClassVar[tuple[str, ...]] = ()
    """Settings that are points of a continuum (a lag): one that was found is refined between its neighbours on the grid."""
    twins: ClassVar[Mapping[str, Mapping[str, float]]] = {}
    """By a setting: effects whose signature is the same function with it, with how likely each is relative to this one."""
    borrowing: ClassVar[tuple[str, ...]] = ()
    """Settings that ``elsewhere`` offers; a name that ends with a dot stands for all that begin with it, any other for a switch
    that is on."""
    unvaried: ClassVar[str] = ""
    """Why a recording cannot speak of the effect where ``settings`` offers nothing; empty for the usual reasons."""

    @abstractmethod
    def places(self, machine: Any) -> Sequence[Place]:
        """Where on this machine the effect may act."""

    def screened(self, machine: Any, place: Place) -> bool:
        """Whether a diagnosis should look for it there; where not, a user may still state it."""
        return True

    @abstractmethod
    def coefficients(self, machine: Any, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        """Amplitudes to estimate at a place."""

    @abstractmethod
    def shifts(self, site: Any) -> Shifts:
        """What is added at which ports (mm, rad, or the parameter's own unit)."""

    def drivers(self, machine: Any, place: Place, settings: Settings) -> tuple[str, ...]:
        """Columns beyond the joints that the formula reads."""
        return ()

    def driver_kind(self, machine: Any, place: Place, settings: Settings) -> DriverKind:
        """What makes it vary: its load, else as the class states, else the driver that it reads, else its position."""
        if self.reads_load(settings):
            return "load"
        if self.driven_by is not None:
            return self.driven_by
        read = [machine.drives(name) for name in self.drivers(machine, place, settings)]
        return next((kind for kind in read if kind is not None), "position")

    def driver_kinds(self, machine: Any, place: Place, settings: Settings) -> tuple[DriverKind, ...]:
        """All that makes it vary, where that is more than one thing."""
        return (self.driver_kind(machine, place, settings),)

    def explain(self, machine: Any, place: Place, settings: Settings) -> str:
        """One sentence in plain words for the finding, of terms with these settings."""
        names = ", ".join(place)
        return (
            self.sentence.format(*place, all=names)
            if self.sentence
            else f"{self.title or self.slug} at {names}"
        )

    def reads_load(self, settings: Settings) -> bool:
        """Whether the formula reads gravity loads with these settings."""
        return self.needs_load

    def settings(self, machine: Any, place: Place, recording: Observed) -> Sequence[Settings]:
        """Constants the formula is not linear in (order of a harmonic, lag): one candidate each."""
        return self.forms

    def elsewhere(self, machine: Any, place: Place, seen: Mapping[str, Array]) -> Sequence[Settings]:
        """Settings that read columns of other places in this one's stead: ``seen`` are the smooth drivers (n,) by name.

        All together are as likely as ``truepose.identification.prior.ELSEWHERE`` says, beside those of ``settings``.
        """
        return ()

    def likely(self, machine: Any, place: Place) -> float:
        """How often machines have it at a place, in terms of other places."""
        return 1.0

    def weight(self, settings: Settings) -> float:
        """How likely settings are among those of a place, relative to each other."""
        return 1.0

    def within(self, place: Place, settings: Settings, seen: Mapping[str, tuple[float, float]]) -> Settings:
        """Settings for a recording that saw joints over ranges ``seen`` (mm, rad): a form that says nothing beyond them."""
        return settings

    def adds(self, settings: Settings) -> bool:
        """Whether terms of one place with other settings may stand beside one with these."""
        return self.settings_add

    def told(self, settings: Settings) -> str:
        """What tells terms of one place apart, in their labels: the settings."""
        return "".join(f",{name}={value:g}" for name, value in sorted(settings.items()))

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        """What the fitted coefficients say, in words; empty where the numbers speak for themselves."""
        return ""


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
    kind: DriverKind = "position"

    @classmethod
    def at(
        cls,
        effect: Effect,
        machine: Any,
        place: Place,
        settings: Settings | None = None,
        values: Mapping[str, float] | None = None,
    ) -> PlacedEffect:
        """Bind an effect to a place; coefficient values default to 0.

        Raises InputError for settings that no machine file may hold, so that whatever is made can be written and read.
        """
        fixed = dict(settings or {})
        if effect.setting_ranges is not None:
            check_settings(effect.slug, effect.setting_ranges, fixed, f"{effect.slug}@{'+'.join(place)}")
        coefficients = effect.coefficients(machine, place, fixed)
        amplitudes = tuple(float((values or {}).get(c.name, 0.0)) for c in coefficients)
        drivers = effect.drivers(machine, place, fixed)
        spread = 1.0 if len(coefficients) >= SERIES else 100.0
        kind = effect.driver_kind(machine, place, fixed)
        return cls(
            effect, place, tuple(sorted(fixed.items())), coefficients, drivers, amplitudes, spread, kind
        )

    @property
    def at_place(self) -> EffectAtPlace:
        """What and where it is, without its settings."""
        return EffectAtPlace(self.effect.slug, self.place)

    @property
    def settings_map(self) -> Settings:
        """Settings by name."""
        return dict(self.settings)

    @property
    def borrows(self) -> bool:
        """Whether the settings are of those that ``elsewhere`` offers."""
        names = self.effect.borrowing
        return any(n.startswith(names) and (bool(v) or n not in names) for n, v in self.settings)

    @property
    def twins(self) -> Mapping[str, float]:
        """Effects whose signature is the same function here, with how likely each is relative to this one."""
        found = (twins for name, twins in self.effect.twins.items() if name in self.settings_map)
        return {slug: ratio for twins in found for slug, ratio in twins.items()}

    @property
    def values(self) -> Mapping[str, float]:
        """Coefficient values by name."""
        return dict(zip((c.name for c in self.coefficients), self.amplitudes, strict=True))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the coefficients among all parameters."""
        return tuple(f"{self.label}:{c.name}" for c in self.coefficients)

    @property
    def needs_load(self) -> bool:
        """Whether the formula reads gravity loads."""
        return self.effect.reads_load(self.settings_map)

    @property
    def moves_tool(self) -> bool:
        """Whether it moves a tool that stands: effects of sensors do not, nor do those of readings before it stood."""
        return self.kind != "sensor" and not any(Driver.of(name).kind == STEP for name in self.drivers)

    @property
    def label(self) -> str:
        """``slug@place+place`` with settings, unique within a machine."""
        return f"{self.at_place}{self.effect.told(self.settings_map)}"

    def with_values(self, amplitudes: Sequence[float]) -> PlacedEffect:
        """The same effect with other coefficient values, in order."""
        return replace(self, amplitudes=tuple(float(a) for a in amplitudes))

    def __str__(self) -> str:
        return self.label
