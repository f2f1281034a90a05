"""A recording as the machine would give it: its own effects, the ones named, and the sensor's noise.

Effects are named as on the command line, ``SLUG@PLACE+PLACE:name=value[unit],name2=...``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from truepose.errors import InputError
from truepose.identification.prediction.predict import predicted, predictor_for
from truepose.identification.recording.load import Sources, as_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import read_table
from truepose.models.effects.base import Effect, PlacedEffect, effects
from truepose.models.load import place_effect, resolve_place
from truepose.models.machine import FRAMES, Machine
from truepose.models.machine_file import EffectSpec
from truepose.models.units import convert, parse_unit
from truepose.wording import close_matches

Array = NDArray[np.float64]
_HEAD = re.compile(r"^(?P<slug>[^@:=\s]+)@(?P<place>[^:=]+)(?::(?P<rest>.*))?$")
_ITEM = re.compile(
    r"\s*(?P<name>[^=]+?)\s*=\s*(?P<value>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?:\[(?P<unit>[^\]]*)\])?\s*(?:,|$)"
)
_FORM = "SLUG@PLACE:name=value[unit]"


def simulate(
    machine: Machine, poses: Recording | Sources, extra: Sequence[PlacedEffect] = (), *, seed: int | None = 0
) -> pd.DataFrame:
    """The sensor's columns for every row of ``poses`` (a path, a DataFrame or a dict, too), in the machine file's units.

    Noise is the instrument's, drawn from ``seed``; None leaves it out. Raises InputError naming the first row
    that cannot be assembled, and a column of labels that a sensor without readings needs.
    """
    poses = as_recording(machine, poses, need_observations=False)
    _check_labels(machine, poses)
    predictor = predictor_for(machine.with_effects((*machine.effects, *extra)), poses)
    found = predicted(predictor, with_std=False)
    if not found.good.all():
        row = int(np.flatnonzero(~found.good)[0])
        raise InputError(f"{poses.where(row)}: the mechanism cannot be assembled there; mend or drop the row")
    rng = np.random.default_rng(0 if seed is None else seed)
    units = machine.units
    data: dict[str, Array] = {}
    offset = 0
    for sensor in machine.sensors:
        values = found.values[:, offset : offset + len(sensor.columns)]
        offset += len(sensor.columns)
        read = values if seed is None else sensor.noisy(values, rng)
        if sensor.differs_from_row and poses.from_row is not None:  # a change since itself is nothing
            read = np.where((poses.from_row == np.arange(len(poses)))[:, None], 0.0, read)
        for k, (name, unit) in enumerate(sensor.columns.items()):
            data[name] = convert(read[:, k], unit, units.written(unit))
    return pd.DataFrame(data)


def _check_labels(machine: Machine, poses: Recording) -> None:
    for sensor in machine.sensors:
        for name in sensor.label_columns:
            if name not in poses.labels:
                raise InputError(
                    f"{', '.join(poses.files)}: missing column {name!r}, which the sensor {sensor.type} needs"
                )


def with_inputs(path: Path | str, simulated: pd.DataFrame) -> pd.DataFrame:
    """The columns of a file of poses as they stand, then the simulated readings in place of its own."""
    table = read_table(path)
    kept = {}
    for column in table.columns:
        if column.name not in simulated:
            header = column.name if column.unit is None else f"{column.name} [{column.unit}]"
            kept[header] = list(table.cells[column.name])
    return pd.concat([pd.DataFrame(kept), simulated], axis=1)


def parse_effect(text: str, machine: Machine, option: str = "--effect") -> PlacedEffect:
    """One effect named on the command line: places joined by ``+``, settings among the coefficients.

    Raises InputError, which names the ``option``, for an unknown slug, place or name (with close matches) and for
    a bad unit.
    """
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
    return place_effect(machine, EffectSpec(slug, place, own, settings=settings, where=where), where)


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
        out[item["name"]] = (float(item["value"]), item["unit"])
        at = item.end()
    return out


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
    parts = {*mechanism.readings, *mechanism.lengths, *mechanism.bodies, *FRAMES, *machine.geometry}
    parts |= {limb.name for limb in mechanism.limbs} | {joint.name for joint in mechanism.joints}
    for name in place:
        if name not in parts:
            raise InputError(f"{where}: {machine.name} has no part {name!r}; {close_matches(name, parts)}")
    return place


class _Anything:
    """A recording that logged everything: asked for the settings that an effect knows."""

    n_sessions = 2

    def driver(self, name: str) -> Array:
        return np.array([0.0, 1e5])


def _settings(
    effect: Effect, machine: Machine, place: tuple[str, ...], numbers: Mapping[str, tuple[float, str | None]]
) -> dict[str, float]:
    """The settings named, the rest as in the effect's first form that knows all names (else its first)."""
    forms = []
    for known in effect.settings(machine, place, _Anything()) or ({},):
        named = {name: value for name, (value, _) in numbers.items() if name in known}
        settings = {**known, **named}
        names = {c.name for c in effect.coefficients(machine, place, settings)}
        forms.append((len(set(numbers) - names - set(settings)), settings))
    return dict(min(forms, key=lambda form: form[0])[1])


__all__ = ["parse_effect", "simulate", "with_inputs"]
