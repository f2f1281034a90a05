"""Parts that grow when they warm up."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import casadi as ca

from truepose.arrays import Array
from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import clock, limb_at, singly
from truepose.models.effects.sights import FROM, borrowed, from_settings, others, span
from truepose.models.file.driver import TEMPERATURE, Driver
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import ANY, NOT_NEGATIVE, ranges

REFERENCE = 20.0
LAGS = (300.0, 900.0, 1800.0, 3600.0)
LAGS_ELSEWHERE = (900.0, 3600.0)
"""Lags behind a thermometer of another place: fewer, because what is found is refined between them."""
GAIN = 3.0
"""How many times as much as another place's thermometer a part may warm up, usually. Chosen."""
TOOL = "tool"


@effects.add("thermal-expansion")
class ThermalExpansion(Effect):
    """Parts that grow when they warm up.

    Every length of the place grows by alpha (T - 20 degC) of itself; one part, or all legs alike. Of a slide that is no
    leg, the screw or scale grows: its reading means alpha (T - 20 degC) more of its way from zero.

    Settings: ``lag`` (s) of the body behind its thermometer, first order; for all legs together,
    ``thermometer`` k when only leg k's temperature was recorded (0: each leg its own). ``from.COLUMN`` (degC): a thermometer
    elsewhere stands in; it counts from that value, alpha has its gain in it, and the offset is the drawing's to bear.
    """

    slug = "thermal-expansion"
    setting_ranges = ranges({"lag": NOT_NEGATIVE, "thermometer": ANY, "from.": ANY})
    title = "Thermal expansion"
    formula = (
        "dL = alpha (T - 20 degC) L; T may reach the body with a first-order lag; elsewhere: T - its mean"
    )
    size = "alpha of 11 to 23 um/m/K from steel to aluminium: 11 to 23 um per metre and kelvin"
    look_alikes = ("mount-drift", "wrong-constant", "actuator-scale", "sensor-scale", "air-refraction")
    experiment = "heat this part alone by a few kelvin and repeat a reference pose; log its temperature"
    source = "handbook values of linear expansion; lag of a lumped body"
    continuous = ("lag",)
    borrowing = (FROM,)

    def places(self, machine: Machine) -> Sequence[Place]:
        names = (*machine.mechanism.lengths, TOOL)
        parts = [name for name in names if _has_length(machine, _ports(machine, name))] + _slides(machine)
        legs = tuple(limb.name for limb in machine.mechanism.limbs if limb.name in parts)
        return [*singly(parts), legs] if len(legs) > 1 else singly(parts)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        gain = 1.0 if borrowed(settings) is None else GAIN
        return (Coefficient("alpha", "1/K", scale=3e-5 * gain, lower=0.0, upper=1e-4 * gain**2),)

    def shifts(self, site: Site) -> Shifts:
        out: dict[str, ca.SX] = {}
        thermometers = _thermometers(site.machine, site.place, site.settings)
        start = (borrowed(site.settings) or ("", REFERENCE))[1]
        for part, thermometer in zip(site.place, thermometers, strict=True):
            strain = site.c["alpha"] * (site.driver(thermometer) - start)
            if part in _slides(site.machine):
                out[site.port(part)] = strain * site.moved(part)
            else:
                out |= {port: strain * site.value(port) for port in _ports(site.machine, part)}
        return out

    def drivers(self, machine: Machine, place: Place, settings: Settings) -> tuple[str, ...]:
        return tuple(dict.fromkeys(_thermometers(machine, place, settings)))

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """No lag, and lags that end within the campaign when time is recorded."""
        span = clock(recording)
        lags = [0.0, *(lag for lag in LAGS if span is not None and lag < span[1] - span[0])]
        if len(place) == 1:
            return [{"lag": lag} for lag in lags]
        recorded = [recording.driver(_driver(machine, part)) is not None for part in place]
        serves = 0.0 if all(recorded) or not any(recorded) else recorded.index(True) + 1.0
        return [{"lag": lag, "thermometer": serves} for lag in lags]

    def elsewhere(self, machine: Machine, place: Place, seen: Mapping[str, Array]) -> Sequence[Settings]:
        """Every thermometer that says something else than the place's own, without a lag and with few."""
        lags = [0.0, *(lag for lag in LAGS_ELSEWHERE if lag < span(seen))]
        names = others(
            machine, [Driver(TEMPERATURE, _part(machine, name)).served_by(seen) for name in place], seen
        )
        if place[0] in _slides(machine):  # right at 20 degC (ISO 1): no constant bears an offset
            return [{"lag": lag, f"{FROM}{name}": REFERENCE} for name in names for lag in lags]
        return [{"lag": lag, **from_settings(name, seen)} for name in names for lag in lags]

    def adds(self, settings: Settings) -> bool:
        """Heat from elsewhere comes by more than one way, and each way has its lag."""
        return borrowed(settings) is not None

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        found, slides = borrowed(settings), place[0] in _slides(machine)
        what = (
            f"The screw or scale of {place[0]} grows" if slides else f"The lengths of {', '.join(place)} grow"
        )
        if found is None:
            return f"{what} in proportion to {'its' if slides else 'their'} temperature above 20 degC."
        lag = settings.get("lag", 0.0)
        behind = f", {lag:g} s behind it" if lag else ""
        return (
            f"{what} with {found[0]}, a thermometer elsewhere{behind}: alpha is the expansion "
            "times how much more the part warms up."
        )


def _slides(machine: Machine) -> list[str]:
    """Readings of slides that are no part of a leg: their screw or scale has the length."""
    limbs = {limb.reading for limb in machine.mechanism.limbs}
    return [a.reading for a in machine.mechanism.actuators if a.unit == "mm" and a.reading not in limbs]


def _part(machine: Machine, name: str) -> str:
    """Name of the part that heats up: a leg may be called by its reading."""
    known = name == TOOL or name in machine.mechanism.lengths or name in _slides(machine)
    return name if known else limb_at(machine, name).name


def _ports(machine: Machine, name: str) -> tuple[str, ...]:
    if name == TOOL:
        return (f"{TOOL}.x", f"{TOOL}.y", f"{TOOL}.z")
    return tuple(machine.mechanism.lengths[_part(machine, name)])


def _has_length(machine: Machine, ports: Iterable[str]) -> bool:
    """Whether anything of a place can grow; displacements always can."""
    return any(p not in machine.geometry or machine.nominal_values[p] != 0.0 for p in ports)


def _driver(machine: Machine, part: str, lag: float = 0.0) -> str:
    return f"temperature.{_part(machine, part)}" + (f"~{lag:g}" if lag else "")


def _thermometers(machine: Machine, place: Place, settings: Settings) -> list[str]:
    """Driver of each part of a place."""
    lag, serves = settings.get("lag", 0.0), settings.get("thermometer")
    elsewhere = borrowed(settings)
    if elsewhere is not None:
        return [elsewhere[0] + (f"~{lag:g}" if lag else "")] * len(place)
    if serves is None:
        logged = [part for part in place if _driver(machine, part) in machine.drivers]
        serves = place.index(logged[0]) + 1 if logged and len(logged) < len(place) else 0
    return [_driver(machine, place[round(serves) - 1] if serves else part, lag) for part in place]
