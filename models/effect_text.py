"""Effects in one line of text, as on the command line: ``SLUG@PLACE+PLACE:name=value[unit],name2=...``."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.file.driver import TIME, VELOCITY, Driver
from truepose.models.file.effect_entry import EffectSpec
from truepose.models.file.limits import LARGEST, within
from truepose.models.load import place_effect, resolve_place
from truepose.models.machine.effect import effects
from truepose.models.machine.kinematics import driver_default
from truepose.models.machine.machine import Machine, MachineLike, as_machine
from truepose.models.machine.placed import Coefficient, Effect, PlacedEffect
from truepose.models.units import parse_unit
from truepose.wording import close_matches

_HEAD = re.compile(r"^(?P<slug>[^@:=\s]+)@(?P<place>[^:=]+)(?::(?P<rest>.*))?$")
_ITEM = re.compile(
    r"\s*(?P<name>[^=]+?)\s*=\s*(?P<value>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?:\[(?P<unit>[^\]]*)\])?\s*(?:,|$)"
)
_FORM = "SLUG@PLACE:name=value[unit]"
_NAMED = 6
"""Coefficients that a message names: some series have dozens."""


def parse_effect(
    text: str, machine: MachineLike, option: str = "--effect", *, stated: bool = False
) -> PlacedEffect:
    """One effect named on the command line: places joined by ``+``, settings among the coefficients.

    ``stated``: it is to be added as it stands, so that it needs a value, and one that can be. Raises InputError, which
    names the ``option``, for an unknown slug, place or name (with close matches) and for a bad unit.
    """
    machine = as_machine(machine)
    where = f"{option} {text}"
    head = _HEAD.match(text.strip())
    if head is None:
        raise InputError(
            f"{where}: expected {_FORM}, such as actuator-scale@{machine.mechanism.readings[0]}:s=1e-3"
        )
    slug, place = head["slug"], tuple(part.strip() for part in head["place"].split("+"))
    effect = effects.get(slug, where)()
    place = _known_place(effect, machine, place, where)
    numbers = _numbers(head["rest"] or "", where)
    settings = _settings(effect, machine, place, numbers)
    coefficients = {c.name: c for c in effect.coefficients(machine, place, settings)}
    for name in numbers:
        if name not in coefficients and name not in settings:
            raise InputError(
                f"{where}: unknown name {name!r}; {close_matches(name, [*coefficients, *settings])}"
            )
    own = {
        name: (
            value,
            coefficients[name].unit if unit is None else parse_unit(unit, "any", f"{where}: {name}"),
        )
        for name, (value, unit) in numbers.items()
        if name in coefficients
    }
    if stated:
        _check_stated(text.strip(), coefficients, own, where)
    return place_effect(machine, EffectSpec(slug, place, own, settings=settings, where=where), where)


def effect_text(placed: PlacedEffect) -> str:
    """Return the text that ``parse_effect`` reads as this effect: its settings, and its coefficients that are not 0."""
    told = [f"{name}={value:.9g}" for name, value in placed.settings]
    told += [f"{name}={value:.4g}" for name, value in placed.values.items() if value]
    return f"{placed.at_place}:{','.join(told)}" if told else str(placed.at_place)


def _numbers(text: str, where: str) -> dict[str, tuple[float, str | None]]:
    """``a=1[mm],b=2`` as name: (value, unit). Names may hold commas and brackets, ``K[1,1]``."""
    out: dict[str, tuple[float, str | None]] = {}
    at = 0
    while at < len(text):
        item = _ITEM.match(text, at)
        if item is None:
            raise InputError(
                f"{where}: found {text[at:]!r}, expected name=value or name=value[unit], with commas between"
            )
        if item["name"] in out:
            raise InputError(f"{where}: found {item['name']!r} twice, expected once")
        out[item["name"]] = (_number(item["value"], f"{where}: {item['name']}"), item["unit"])
        at = item.end()
    return out


def _number(text: str, where: str) -> float:
    value = float(text)
    if not within(value):
        raise InputError(f"{where}: found {value:g}, expected a number of at most {LARGEST:g} by size")
    return value


def _check_stated(
    text: str, coefficients: Mapping[str, Coefficient], own: Mapping[str, tuple[float, str]], where: str
) -> None:
    """Refuse an effect that would add nothing, and one of a sign that it cannot have."""
    for name, (value, unit) in own.items():
        if coefficients[name].lower == 0.0 and value < 0.0:
            raise InputError(f"{where}: found {name} = {value:g} {unit}, expected a value >= 0")
    if coefficients and not own:
        wanted = ", ".join(f"{name} ({c.unit})" for name, c in list(coefficients.items())[:_NAMED])
        first = next(iter(coefficients.values()))
        example = f"{text.rstrip(':')}:{first.name}={first.scale / 10:.0e}[{first.unit}]"
        raise InputError(
            f"{where}: adds nothing as it stands, expected a value of {wanted}, such as {example}"
        )


def _known_place(effect: Effect, machine: Machine, place: tuple[str, ...], where: str) -> tuple[str, ...]:
    """The place, if the effect may act there: one of its places, or several of its single ones."""
    known = [tuple(p) for p in effect.places(machine)]
    place = resolve_place(machine, place, known)
    if place in known or all((name,) in known for name in place):
        return place
    if not known and effect.coefficients(machine, place, {}):
        return _named_parts(
            machine, place, where
        )  # diagnosis does not look for it here; its formula may hold
    if not known:
        raise InputError(f"{where}: {effect.slug} has no place on {machine.name} where it could be simulated")
    named = "+".join(place)
    hint = close_matches(named, ["+".join(p) for p in known])
    raise InputError(f"{where}: {effect.slug} has no place {named!r}; {hint}")


def _named_parts(machine: Machine, place: tuple[str, ...], where: str) -> tuple[str, ...]:
    """The place, if every name in it means a part of the machine."""
    mechanism = machine.mechanism
    parts = {*mechanism.readings, *mechanism.lengths, *mechanism.bodies, *machine.standing, *machine.geometry}
    parts |= {limb.name for limb in mechanism.limbs} | {joint.name for joint in mechanism.joints}
    for name in place:
        if name not in parts:
            raise InputError(f"{where}: {machine.name} has no part {name!r}; {close_matches(name, parts)}")
    return place


class _Anything:
    """A recording that logged everything, at rest: asked for the settings that an effect knows."""

    n_sessions = 2

    def driver(self, name: str) -> Array:
        return np.array([0.0, 0.0 if Driver.of(name).kind == VELOCITY else 1e5])

    def inferred(self, name: str) -> bool:
        return False


def _settings(
    effect: Effect, machine: Machine, place: tuple[str, ...], numbers: Mapping[str, tuple[float, str | None]]
) -> dict[str, float]:
    """The settings named, the rest as in the effect's first form that knows all names (else its first); where none does, those
    that are named alone.

    What drifts begins with the drifts of the machine, where it has some.
    """
    forms, began = [], driver_default(machine, TIME)
    columns = [name.partition(".")[2] for name in numbers if name.startswith("from.")]
    elsewhere = effect.elsewhere(machine, place, {name: np.array([0.0, 1e5]) for name in ("time", *columns)})
    allowed = effect.setting_ranges or {}
    alone = {
        name: v
        for name, (v, _) in numbers.items()
        if name in allowed or f"{name.partition('.')[0]}." in allowed
    }
    for known in [*effect.settings(machine, place, _Anything()), *elsewhere, alone]:
        named = {name: value for name, (value, _) in numbers.items() if name in known}
        settings = {**known, **({"start": began} if began and "start" in known else {}), **named}
        names = {c.name for c in effect.coefficients(machine, place, settings)}
        forms.append((len(set(numbers) - names - set(settings)), settings))
    return dict(min(forms, key=lambda form: form[0])[1])
