"""What an experiment may vary beside the joints: payload, temperatures, sides of approach, time, sessions, speeds.

A factor is a driver of the recording with the levels it may be set to. What explanations read and nobody offered
stays at its nominal value.

Explanations that an experiment is to tell apart: an effect at a place, the forms it may take, its size.

They are named on a command line as ``simulate --effect`` names them, or taken from the class of a finding in
``diagnosis.json``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.diagnosis.result import UNNAMED
from truepose.identification.identifiability.observability import Kind, Note
from truepose.models.effect_text import parse_effect
from truepose.models.effects.base import SERIES, PlacedEffect, effects
from truepose.models.effects.common import OF_ROWS
from truepose.models.effects.empirical import Empirical
from truepose.models.file.driver import (
    AIR,
    APPROACH,
    HELD,
    OF_THE_WAY,
    PAYLOAD,
    SESSION,
    STEP,
    TEMPERATURE,
    TIME,
    VELOCITY,
    Driver,
)
from truepose.models.load import resolve_place
from truepose.models.machine.kinematics import driver_default
from truepose.models.machine.machine import Machine
from truepose.wording import close_matches

# -- Explanations that an experiment is to tell apart: an effect at a place, the forms it may take, its size

EXPECTED = 0.01
"""Share of a coefficient's largest expected size that is taken where no amplitude is named: the middle, in the log, of the
amplitudes that a diagnosis takes to be equally likely (``evidence.AMPLITUDES`` up to 1)."""
Form = tuple[PlacedEffect, ...]
"""Effects that act together as one version of an explanation (the orders of a harmonic)."""

NO_NAMES = (Empirical.slug, *OF_ROWS)
"""Effects of findings that are no explanation: forms without a name, rows."""


@dataclass(frozen=True)
class Explanation:
    """What may be missing. ``forms``: its versions (settings), the first the one that is taken to be true.

    amplitude (k,): coefficients of the first form in units of their scale; None where nobody knows them.
    """

    slug: str
    place: tuple[str, ...]
    forms: tuple[Form, ...]
    amplitude: Array | None = None

    @property
    def name(self) -> str:
        """``slug@place+place``."""
        return f"{self.slug}@{'+'.join(self.place)}"

    @property
    def experiment(self) -> str:
        """What the catalogue says would separate it."""
        return effects.get(self.slug, "explanation").experiment

    def twin_of(self, other: Explanation) -> bool:
        """Whether both are the same function of the same joint by construction, whatever is measured."""
        pairs = ((self, other), (other, self))
        same = any(b.slug in part.twins for a, b in pairs for part in a.forms[0])
        return self.place == other.place and same


@dataclass(frozen=True)
class Class:
    """Explanations to be told apart; ``others`` are known to be there as well, whatever their size."""

    explanations: tuple[Explanation, ...]
    others: tuple[PlacedEffect, ...] = ()
    notes: tuple[Note, ...] = ()


class _Offered:
    """A recording as an experiment would leave it: two sessions, every driver, bodies that follow their thermometers."""

    n_sessions = 2

    def driver(self, name: str) -> Array | None:
        return None if name == "time" else np.array([0.0, 1.0])

    def inferred(self, name: str) -> bool:
        return False


def explanation(text: str, machine: Machine) -> Explanation:
    """``SLUG@PLACE[+PLACE][:name=value[unit],...]``; settings that are not named may be any that the effect knows.

    Raises InputError for an unknown slug, place or name.
    """
    placed = parse_effect(text, machine, option="--discriminate")
    rest = text.partition(":")[2].replace(" ", "")
    named = any(rest.startswith(f"{name}=") or f",{name}=" in rest for name in placed.settings_map)
    forms: list[Form] = [(placed,)]
    if not named:
        known = _forms(machine, placed.effect.slug, placed.place)
        forms += [form for form in known if form[0].label != placed.label]
    scales = [c.scale for c in placed.coefficients]
    amplitude = np.asarray(placed.amplitudes, dtype=float) / scales if any(placed.amplitudes) else None
    return Explanation(placed.effect.slug, placed.place, tuple(forms), amplitude)


def class_of(
    found: Iterable[Mapping[str, Any]],
    machine: Machine,
    texts: Sequence[str] = (),
    source: str = "diagnosis.json",
) -> Class:
    """The class of a finding in ``diagnosis.json``, which ``source`` names, with the finding's fitted value.

    Without ``texts`` the first finding that has equivalents is taken; with them, the finding that is among them,
    against the others. Raises InputError where there is nothing to tell apart.
    """
    findings = [f for f in found if f["effect"] in effects and f["effect"] not in NO_NAMES]
    wanted = [explanation(text, machine) for text in texts]
    names = {e.name for e in wanted}
    fitted = [_fitted(machine, f, f"{source}: findings[{k}]") for k, f in enumerate(findings)]
    chosen = [
        k for k, f in enumerate(findings) if (fitted[k].name in names if texts else _named_equivalents(f))
    ]
    if not chosen:
        what = f"with the name of {' or '.join(texts)}" if texts else "with equivalents"
        raise InputError(f"{source}: found no finding {what}, expected one to tell from its equivalents")
    true = fitted[chosen[0]]
    rivals = [e for e in wanted if e.name != true.name] or [
        _equivalent(machine, e, true) for e in _named_equivalents(findings[chosen[0]])
    ]
    others = tuple(part for k, e in enumerate(fitted) if k != chosen[0] for part in e.forms[0])
    notes = [Note("own class", fitted[k].name) for k in chosen[1:]]
    if len(rivals) < len(findings[chosen[0]].get("equivalents", ())) and not wanted:
        notes.append(Note("nameless", true.name))
    return Class((true, *rivals), others, tuple(notes))


def _named_equivalents(finding: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Rivals of a finding that have a name, and that a recording of this machine can speak of."""
    return [e for e in finding.get("equivalents", ()) if e["effect"] != UNNAMED and e.get("tested", True)]


def _fitted(machine: Machine, finding: Mapping[str, Any], where: str) -> Explanation:
    """A finding with its fitted amplitudes; terms of several settings act together."""
    effect = effects.get(finding["effect"], where)()
    place = tuple(finding["place"])
    known = [tuple(p) for p in effect.places(machine)]
    place = resolve_place(machine, place, known)
    several = finding.get("settings") or [{}]
    parts, amplitude = [], []
    for settings in several:
        placed = PlacedEffect.at(effect, machine, place, settings)
        tail = "".join(f"[{n}={v:g}]" for n, v in placed.settings) if len(several) > 1 else ""
        values = finding["parameters"]
        for c in placed.coefficients:
            stated = values.get(f"{c.name}{tail}")
            if stated is None or stated["unit"] != c.unit:
                raise InputError(f"{where}: found no value of {c.name}{tail} in {c.unit}, expected one")
            amplitude.append(float(stated["value"]) / c.scale)
        parts.append(placed)
    return Explanation(effect.slug, place, (tuple(parts),), np.array(amplitude))


def _equivalent(machine: Machine, other: Mapping[str, Any], true: Explanation) -> Explanation:
    """An equivalent: its settings are not known, nor its size. Where the finding has several terms, so may it."""
    slug, place = other["effect"], tuple(other["place"])
    forms = _forms(machine, slug, place)
    if len(true.forms[0]) > 1:
        asked = [part.settings for part in true.forms[0]]
        alike = tuple(form[0] for form in forms if form[0].settings in asked)
        forms = [alike, *forms] if len(alike) > 1 else forms
    return Explanation(slug, place, tuple(forms))


def _forms(machine: Machine, slug: str, place: tuple[str, ...]) -> list[Form]:
    """Every version of an effect at a place but long series, which say little about a mechanism."""
    effect = effects.get(slug, "explanation")()
    placed = [
        PlacedEffect.at(effect, machine, place, settings)
        for settings in effect.settings(machine, place, _Offered()) or ({},)
    ]
    short = [p for p in placed if len(p.coefficients) < SERIES] or placed
    return [(p,) for p in short]


# -- What an experiment may vary beside the joints: payload, temperatures, sides of approach, time, sessions, speeds

SIDES = (1.0, -1.0)
HOURS = (0.0, 0.5, 1.0, 1.5, 2.0)
SESSIONS = (1.0, 2.0)
MOST = 24
"""Settings of the factors that are tried at one pose; of more, some are drawn."""


@dataclass(frozen=True)
class Factor:
    """A driver that may be set. levels: internal units (kg, degC, s, hPa, mm/s or rad/s); session: its number.

    nominal: the level that it has where it is not varied.
    """

    driver: str
    levels: tuple[float, ...]
    nominal: float


Offer = Mapping[str, tuple[float, ...]]
"""What the user can vary: levels by driver, as ``payload``, ``temperature.leg1``, ``velocity.q2``."""


def read_offer(machine: Machine, payload: str = "", named: Sequence[str] = ()) -> Offer:
    """Read ``0,2.5,5`` kg and texts such as ``temperature.leg1=15,20,30``. Raises InputError for bad levels."""
    levels = {PAYLOAD: _numbers(payload, "--payload")} if payload else {}
    for text in named:
        driver, equals, values = text.partition("=")
        driver = driver.strip()
        _check_driver(machine, driver, text, bool(equals))
        levels[driver] = _numbers(values, text)
    return levels


def factors(machine: Machine, parts: Iterable[PlacedEffect], offer: Offer) -> tuple[Factor, ...]:
    """Every driver that the explanations read: offered, automatic (sides, time, sessions) or left at nominal.

    Levels that nobody reads are left out: they could not help.
    """
    out, parts = {}, tuple(parts)
    for driver in _read(machine, parts, offer):
        nominal = driver_default(machine, driver, parts)
        levels = offer.get(Driver.of(driver).served_by(offer))
        automatic = _automatic(driver, nominal)
        if levels is not None:
            # held still, it stays at the level closest to what the machine file means
            nominal = min(levels, key=lambda level: abs(level - nominal))
            out[driver] = Factor(driver, levels, nominal)
        elif automatic:
            out[driver] = Factor(driver, automatic, automatic[0])
        elif Driver.of(driver).kind in HELD:
            out[driver] = Factor(driver, (nominal,), nominal)
    return tuple(out.values())


def settings(varied: Sequence[Factor], rng: np.random.Generator) -> Array:
    """(s, f) settings of the factors to try at a pose: all, or the extreme ones and others at random."""
    combined = list(product(*(factor.levels for factor in varied)))
    every = np.array(combined, dtype=float).reshape(len(combined), len(varied))
    if len(every) <= MOST:
        return every
    still = [factor.nominal for factor in varied]
    nominal = np.flatnonzero(np.all(every == still, axis=1))
    ends = np.array([[min(f.levels), max(f.levels)] for f in varied]).T
    extreme = np.flatnonzero(np.all((every == ends[0]) | (every == ends[1]), axis=1))
    first = np.concatenate([nominal, rng.permutation(extreme)])[: MOST // 2]
    others = np.setdiff1d(np.arange(len(every)), first)
    return np.asarray(every[np.concatenate([first, rng.choice(others, MOST - len(first), replace=False)])])


def _read(machine: Machine, parts: Iterable[PlacedEffect], offer: Offer) -> list[str]:
    """Drivers that the explanations read, payload and measured forces where they ask for loads that they can change."""
    names: list[str] = []
    for part in parts:
        names += [_column(name) for name in part.drivers]
        if part.needs_load and machine.loaded:
            names += [PAYLOAD, *machine.force_columns]
    if AIR in offer:  # one thermometer, whatever it stands for
        names = [Driver.of(name).served_by(offer) for name in names]
    return list(dict.fromkeys(names))


def _column(name: str) -> str:
    """What has to be varied for a driver: the side of approach for what a joint's way leaves behind."""
    driver = Driver.of(name)
    if driver.kind in OF_THE_WAY:
        return Driver(APPROACH, driver.place).name
    return SESSION if driver.kind == SESSION else driver.now.name


def unplanned(parts: Iterable[PlacedEffect]) -> list[Note]:
    """What rows of an experiment do not vary although an explanation depends on it."""
    kinds = {part.effect.slug: {Driver.of(name).kind for name in part.drivers} for part in parts}
    missed: dict[Kind, set[str]] = {"strokes": {*OF_THE_WAY}, "creep": {"creep"}, "motions": {STEP}}
    return [Note(name, slug) for name, own in missed.items() for slug, read in kinds.items() if read & own]


def _automatic(driver: str, nominal: float) -> tuple[float, ...]:
    if Driver.of(driver).kind == APPROACH:
        return SIDES
    if driver == TIME:
        return tuple(nominal + 3600.0 * h for h in HOURS)
    return SESSIONS if driver == SESSION else ()


def _check_driver(machine: Machine, driver: str, text: str, complete: bool) -> None:
    velocities = [Driver(VELOCITY, joint).name for joint in machine.mechanism.readings]
    known = ["pressure", "humidity", *velocities, AIR]
    known += [Driver(TEMPERATURE, part).name for part in (*machine.mechanism.lengths, "tool")]
    known += machine.force_columns
    if not complete or (driver not in known and not Driver.of(driver).thermal):
        raise InputError(
            f"{text!r}: expected DRIVER=value,value,... such as temperature.leg1=15,20,30; "
            f"{close_matches(driver, known)}"
        )


def _numbers(text: str, where: str) -> tuple[float, ...]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if not values or not np.isfinite(values).all():
        raise InputError(f"{where}: found {text!r}, expected numbers with commas between, such as 0,2.5,5")
    if where == "--payload" and min(values) < 0.0:
        raise InputError(f"{where}: found {min(values):g} kg, expected masses that are not negative")
    return tuple(sorted(set(values)))
