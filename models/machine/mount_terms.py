"""A telescope mount's constants and effects in the words of its field: the terms of TPOINT, in arcsec.

Signs are TPOINT's: a term is what is added to what the encoders say for where the telescope really points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from truepose.models.file.driver import PAYLOAD
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import PlacedEffect

ARCSEC: Final = 180.0 * 3600.0 / np.pi
ZENITH_AIR: Final = 57.8
"""arcsec: refraction at 45 deg, 20 degC and 1013.25 hPa."""


@dataclass(frozen=True)
class Term:
    """name: TPOINT's; ours: the constant or coefficient; factor: from its unit to arcsec, sign included; formula and words."""

    name: str
    ours: str
    factor: float
    formula: str
    words: str


@dataclass(frozen=True)
class Said:
    """A term with its value and 1-sigma, arcsec."""

    term: Term
    value: float
    std: float


_EQUATORIAL: Final = (
    ("IH", "{0}.offset", 1, "dh = IH", "index of hour angle"),
    ("ID", "{1}.offset", 1, "dd = ID", "index of declination"),
    ("CH", "tool.rz", -1, "dh = CH sec d", "collimation"),
    ("NP", "{1}.tilt", 1, "dh = NP tan d", "axes that are not square"),
    ("MA", "base.rx", -1, "dh = -MA cos h tan d, dd = MA sin h", "polar axis to the east"),
    ("ME", "base.ry", -1, "dh = ME sin h tan d, dd = ME cos h", "polar axis too low"),
)
_ALTAZ: Final = (
    ("IA", "{0}.offset", -1, "dA = -IA", "index of azimuth"),
    ("IE", "{1}.offset", 1, "dE = IE", "index of altitude"),
    ("CA", "tool.rz", 1, "dA = -CA sec E", "collimation"),
    ("NPAE", "{1}.tilt", -1, "dA = -NPAE tan E", "axes that are not square"),
    ("AN", "base.ry", 1, "dA = -AN sin A tan E, dE = -AN cos A", "vertical axis to the north"),
    ("AW", "base.rx", -1, "dA = -AW cos A tan E, dE = AW sin A", "vertical axis to the west"),
)
_DISC: Final = {
    "equatorial": (
        ("HCES", 0, "a", 1, "dh = HCES sin h"),
        ("HCEC", 0, "b", 1, "dh = HCEC cos h"),
        ("DCES", 1, "a", 1, "dd = DCES sin d"),
        ("DCEC", 1, "b", 1, "dd = DCEC cos d"),
    ),
    "alt-az": (
        ("ACES", 0, "a", -1, "dA = -ACES sin A"),
        ("ACEC", 0, "b", 1, "dA = ACEC cos A"),
        ("ECES", 1, "a", 1, "dE = ECES sin E"),
        ("ECEC", 1, "b", 1, "dE = ECEC cos E"),
    ),
}


def terms_of(machine: Machine, effects: tuple[PlacedEffect, ...] = ()) -> tuple[Term, ...]:
    """Terms that a mount's free constants, and effects, are; none of another machine."""
    section = machine.file.mechanism if machine.file else {}
    if section.get("type") != "mount":
        return ()
    kind, axes = section["kind"], machine.mechanism.readings
    table = _EQUATORIAL if kind == "equatorial" else _ALTAZ
    own = (Term(n, ours.format(*axes), sign * ARCSEC, f, words) for n, ours, sign, f, words in table)
    free = {parameter.name for parameter in machine.parameters if parameter.free}
    out = [term for term in own if term.ours in free]
    for effect in effects:
        out += _of_effect(machine, kind, effect)
    return tuple(out)


def said_terms(
    machine: Machine, effects: tuple[PlacedEffect, ...], values: Mapping[str, float], std: Mapping[str, float]
) -> tuple[Said, ...]:
    """The terms with their values: ``values`` and ``std`` by name of constant or coefficient, internal units."""
    return tuple(
        Said(term, term.factor * values[term.ours], abs(term.factor) * std[term.ours])
        for term in terms_of(machine, effects)
        if term.ours in values
    )


def _of_effect(machine: Machine, kind: str, placed: PlacedEffect) -> list[Term]:
    """What an effect is called there; nothing where it has no term."""
    slug, place, settings, label = placed.effect.slug, placed.place, placed.settings_map, placed.label
    axes = machine.mechanism.readings
    if slug == "gravity-sag" and place == ("tool",) and _moment(machine):
        moment = ARCSEC * _moment(machine)
        return [Term("TF", f"{label}:c", moment, "zenith distance + TF sin z", "tube that droops")]
    if slug == "axis-flexure" and settings.get("fork") and machine.gravity:
        lean = float(abs(machine.gravity[0]) / np.linalg.norm(machine.gravity))
        return [Term("FO", f"{label}:c", ARCSEC * lean, "dd = FO cos h", "fork that bends")]
    if slug == "axis-flexure":
        formula = "dh = -DAF (cos phi cos h + sin phi tan d)"
        return [Term("DAF", f"{label}:c", -ARCSEC, formula, "declination axis that droops")]
    if slug == "air-refraction":
        return [Term("TX", f"{label}:share", ZENITH_AIR, "zenith distance + TX tan z", "refraction of air")]
    if slug == "encoder-eccentricity" and settings.get("order", 1.0) == 1.0:
        return [
            Term(name, f"{label}:{c}", sign * ARCSEC, formula, "eccentric encoder")
            for name, axis, c, sign, formula in _DISC[kind]
            if place == (axes[axis],)
        ]
    return []


def _moment(machine: Machine) -> float:
    """N m of the tube about its mount where it lies level; 0 where its centre is not along it."""
    on_tube = [mass for mass in machine.masses if mass.body == "tool" or mass.name == PAYLOAD]
    if machine.gravity is None or any(mass.com[1] or mass.com[2] for mass in on_tube):
        return 0.0
    size = float(np.linalg.norm(machine.gravity))
    return size * sum(mass.kg * mass.com[0] / 1000.0 for mass in on_tube)
