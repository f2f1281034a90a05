"""Every (effect, place, settings) that a recording could speak of, with its prior; forms without a name among them.

These are the effect ``empirical`` wherever something was varied.

Forms without a name in the load that a joint or a mount carries, or in what a joint's drive was measured to hold.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array
from truepose.identification.learned_prior import FleetPrior
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prior import ELSEWHERE, TOGETHER
from truepose.identification.recording.load import tried
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures import untestable
from truepose.identification.signatures.untestable import Untestable, places_of, still_sources
from truepose.models.effects.base import PlacedEffect, Settings
from truepose.models.effects.common import drives_joint, sensor_at, sensor_names
from truepose.models.effects.empirical import (
    BOW,
    CURVE,
    FINE,
    LINE,
    LOAD,
    LOAD_CURVE,
    MOMENT,
    MOUNT_CURVE,
    OF_SIGHT,
    TURNS,
    Empirical,
)
from truepose.models.effects.polynomials import WIDTH, seen_over
from truepose.models.effects.sights import RANGE, XYZ, length_names, looks_from_afar, point_names
from truepose.models.file.driver import APPROACH, MEASURED_LOADS, ROW, Driver
from truepose.models.machine.machine import FRAMES, Machine
from truepose.models.machine.placed import EffectAtPlace

SAME = 1e-6
"""Share of a load (N, N m) below which its changes are rounding."""


def forms_of_load(machine: Machine, recording: Recording) -> dict[str, list[Settings]]:
    """Forms of each joint and mount whose load varies, by the loads (N, N m) at the drawing's geometry."""
    if not machine.loaded:
        return {}
    predictor = Predictor(machine, recording, ports=True)
    x, assembled = predictor.assemble(predictor.model.p_home)
    joints = {name: machine.mechanism.actuator(name).displacement for name in machine.mechanism.readings}
    moments = {mount: [f"{mount}.motion.{axis}" for axis in TURNS] for mount in FRAMES}
    ports = [*joints.values(), *(port for own in moments.values() for port in own)]
    loads = predictor.loads_at(ports, predictor.model.p_home, x)
    rows = assembled & ~recording.validation
    out: dict[str, list[Settings]] = {}
    for name, port in joints.items():
        own = _range(loads[port][rows])
        if own is not None:
            out[name] = _curves(LOAD, own)
    for mount, axes in moments.items():
        moment = np.array([loads[port][rows] for port in axes])
        each, size = _range(moment), _range(np.sqrt(np.sum(moment**2, axis=0)))
        if each is not None and size is not None:
            out[mount] = [
                seen_over({LOAD: each}, LOAD_CURVE),
                seen_over({MOMENT: size}, LOAD_CURVE),
            ]
    return out


def forms_of_held_load(
    machine: Machine, recording: Recording, seen: Collection[str]
) -> dict[str, list[Settings]]:
    """Forms of each joint in the torque or current of its own drive, where it was recorded and is not among those ``seen``."""
    rows, out = ~recording.validation, dict[str, list[Settings]]()
    for name, values in recording.drivers.items():
        driver, own = Driver.of(name), _range(values[rows])
        held = driver.kind in MEASURED_LOADS and driver.place in machine.mechanism.readings
        if held and name not in seen and own is not None:
            out.setdefault(driver.place, []).extend(_curves(name, own))
    return out


def _curves(source: str, seen: tuple[float, float]) -> list[Settings]:
    """Curves of one source that laws of it may have their like among."""
    return [seen_over({source: seen}, degree) for degree in (LINE, BOW, FINE)]


def _range(load: Array) -> tuple[float, float] | None:
    """Smallest and largest; None where nothing is carried, or always the same."""
    if not len(load) or np.ptp(load) <= SAME * max(float(np.max(np.abs(load))), SAME):
        return None
    return float(np.min(load)), float(np.max(load))


@dataclass(frozen=True)
class Catalogue:
    """Candidates with the logarithm of their prior probability given that one effect is present.

    ``stated`` are those that the machine file has already: part of every model, and no finding. ``learned``: what
    a fleet of machines says otherwise of the prior. ``untested``: those that an assumption alone makes candidates.
    """

    candidates: tuple[PlacedEffect, ...]
    log_prior: tuple[float, ...]
    untestable: tuple[Untestable, ...]
    stated: tuple[int, ...] = ()
    learned: FleetPrior | None = None
    untested: frozenset[int] = frozenset()

    def with_more(self, added: Sequence[PlacedEffect], beside: Sequence[int]) -> Catalogue:
        """With further candidates at the end, which share the prior of those ``beside`` (their indices)."""
        log_prior = list(self.log_prior)
        total = float(np.logaddexp.reduce([log_prior[i] for i in beside]))
        share = total - float(np.log(len(added) + len(beside)))
        for i in beside:
            log_prior[i] = share
        log_prior += [share] * len(added)
        return replace(self, candidates=(*self.candidates, *added), log_prior=tuple(log_prior))

    def cause(self, index: int) -> EffectAtPlace:
        """What a candidate blames, at whatever settings."""
        return self.candidates[index].at_place

    def has_law(self, index: int) -> bool:
        """Whether a candidate is an effect of the catalogue."""
        return self.candidates[index].effect.slug != Empirical.slug

    def named(self, index: int) -> bool:
        """Whether a candidate may be said by its name: it has a law that the recording could test."""
        return self.has_law(index) and index not in self.untested


def catalogue(machine: Machine, recording: Recording, stated: Machine | None = None) -> Catalogue:
    """All candidates; every slug is equally likely, and its places share (parts alone before several at once).

    ``stated``: the machine without what ``machine`` assumes. What is a candidate by an assumption alone was not tested.
    """
    found = _catalogue(machine, recording)
    if stated is None or stated is machine:
        return found
    known = _catalogue(stated, recording)
    labels = {c.label for c in known.candidates}
    untested = frozenset(k for k, c in enumerate(found.candidates) if c.label not in labels)
    return replace(found, untestable=known.untestable, untested=untested)


def _catalogue(machine: Machine, recording: Recording) -> Catalogue:
    found, missing, seen = list[PlacedEffect](), list[Untestable](), ranges(machine, recording)
    still = still_sources(machine, recording)
    rows, known = ~recording.validation, {*still, *recording.joints}
    smooth = {name: v[rows] for name, v in _bending(machine, recording).items() if name not in known}
    for effect in untestable.every_effect():
        places, reasons = places_of(effect, machine), list[str]()
        asked = untestable.of_such_machines(effect.slug, machine)
        if not places and asked and effect.needs_load and not machine.loaded:
            missing.append(Untestable(effect.slug, untestable.unloaded(machine)))
        for place in places:
            variants = effect.settings(machine, place, recording)
            others = effect.elsewhere(machine, place, smooth)
            if not variants and not others:
                one = "the recording holds one session only"
                reasons.append(effect.unvaried or (one if recording.n_sessions < 2 else "nothing to vary"))
            for settings in (*variants, *others):
                placed = PlacedEffect.at(effect, machine, place, effect.within(place, settings, seen))
                reason = untestable.why_untestable(placed, recording, still)
                if reason is None:
                    found.append(placed)
                elif not others:  # what another place's column stands in for can be tested
                    reasons.append(f"{'+'.join(place)}: {reason}" if len(places) > 1 else reason)
        if reasons:
            kinds = list(dict.fromkeys(reasons))
            more = f"; and {len(kinds) - 4} more" if len(kinds) > 4 else ""
            missing.append(Untestable(effect.slug, "; ".join(kinds[:4]) + more))
    missing += [Untestable(one.effects[0], one.why) for one in untestable.missing_length(machine)]
    found += empirical_forms(machine, recording)
    known, labels = {e.label for e in found}, {e.label for e in machine.effects}
    found += [placed for placed in machine.effects if placed.label not in known]
    stated = tuple(k for k, e in enumerate(found) if e.label in labels)
    return Catalogue(tuple(found), _log_prior(machine, found), tuple(missing), stated)


def _columns(placed: PlacedEffect) -> list[str]:
    """Columns that it reads, with memory or without."""
    return [Driver.of(name).now.name for name in placed.drivers]


def _bending(machine: Machine, recording: Recording) -> dict[str, Array]:
    """Joints and drivers (n,) that any part may err by.

    What a joint's drive holds drives that joint alone, unless the file says what else it ``drives``. Columns of measured forces
    are loads: alone they drive nothing, unless the file's ``drivers`` name them.
    """
    loads = {*machine.force_columns} - {*machine.drivers}
    smooth = recording.columns(smooth=True)
    columns = {name: values for name, values in smooth.items() if name not in loads}
    for driver in machine.declared_drivers:
        values = recording.driver(driver.name) if driver.everywhere else None
        if values is not None:
            columns[driver.name] = values
    return columns


def _log_prior(machine: Machine, found: list[PlacedEffect]) -> tuple[float, ...]:
    """Slugs share by how common they are, places within a slug as ``_place_shares`` says, settings by their weight.

    An effect that is rare at a place counts for less there, and for no more elsewhere. So does what reads a column that is
    tried: by the number of those, so that one of many found by chance has the evidence of one.
    """
    slugs = {e.effect.slug: e.effect.commonness for e in found}
    shares = {slug: _place_shares({e.place for e in found if e.effect.slug == slug}) for slug in slugs}
    return tuple(
        float(np.log(weight * share * e.effect.likely(machine, e.place)))
        for e, weight in zip(found, _weights(machine, found), strict=True)
        for share in (slugs[e.effect.slug] / sum(slugs.values()) * shares[e.effect.slug][e.place],)
    )


def _weights(machine: Machine, found: Sequence[PlacedEffect]) -> Array:
    """(c,) share of each candidate at its place, by its settings.

    What reads another place's column has ``ELSEWHERE`` of it, all together, and at most all where there is nothing else. Tried
    columns weigh as much as one driver that was declared, all together, also where there is no other.
    """
    weight = np.array([e.effect.weight(e.settings_map) for e in found])
    columns = set(tried(machine))
    is_tried = np.array([bool(columns.intersection(_columns(e))) for e in found], dtype=bool)
    borrowed = np.array([e.borrows for e in found], dtype=bool)
    priced = np.where(is_tried, weight / max(len(columns), 1), weight)
    at: dict[EffectAtPlace, list[int]] = {}
    for k, e in enumerate(found):
        at.setdefault(e.at_place, []).append(k)
    for each in at.values():
        own, other = ([k for k in each if borrowed[k] == b] for b in (False, True))
        for group, share in ((own, 1.0 - ELSEWHERE), (other, ELSEWHERE)):
            if group:
                plain = priced if not is_tried[group].all() else weight
                whole = plain[group].sum()
                priced[group] *= (share if own and other else min(1.0, whole) if other else 1.0) / whole
    return priced


def _place_shares(places: Collection[tuple[str, ...]]) -> dict[tuple[str, ...], float]:
    """Equal, but one part alone is likelier than several at once where both are places."""
    fewest = min(len(place) for place in places)
    simple = [place for place in places if len(place) == fewest]
    joined = [place for place in places if len(place) > fewest]
    beside = TOGETHER if joined else 0.0
    alone = dict.fromkeys(simple, (1.0 - beside) / len(simple))
    return alone | dict.fromkeys(joined, beside / max(len(joined), 1))


def empirical_forms(machine: Machine, recording: Recording) -> tuple[PlacedEffect, ...]:
    """Every form of one source over the ranges that the calibration rows saw, all coefficients 0.

    Each joint and each mount as a curve in each source (joints, payload, time, thermometers), a joint as a line, too, and by
    all six motions of what it drives; each joint in its own reading with the side that it arrived from. Each joint and mount
    as a curve in the load that it carries, where the file states weights, each joint in what its drive was measured to hold.
    Each sensor in what it reads itself. Forms of several sources: ``proposed_products``.
    """
    seen, loads = _varied(machine, recording), forms_of_load(machine, recording)
    held = forms_of_held_load(machine, recording, seen)
    effect, out = Empirical(), list[PlacedEffect]()
    for (name,) in effect.places(machine):
        forms = list[Settings]()
        if name in sensor_names(machine):
            forms += [{WIDTH: _reach(machine, recording)}] if point_names(sensor_at(machine, name)) else []
            forms += forms_of_sight(machine, recording, name)
        elif name in FRAMES:
            forms += [seen_over({source: seen[source]}, MOUNT_CURVE) for source in seen]
        else:
            for way in ways_of(machine, name):
                forms += [
                    seen_over({source: seen[source]}, degree, spatial=way)
                    for source in seen
                    for degree in degrees(name, source, spatial=way)
                ]
            arrived = arrivals(recording, name)
            if arrived and name in seen:  # by itself it would be play
                forms.append(seen_over({name: seen[name], **arrived}, BOW))
        forms += loads.get(name, []) + held.get(name, [])
        out += [PlacedEffect.at(effect, machine, (name,), settings) for settings in forms]
    return tuple(out)


def forms_of_sight(machine: Machine, recording: Recording, name: str) -> list[Settings]:
    """Curves of a sensor in what it reads itself: azimuth, elevation and range of points, or the length."""
    sensor, rows, seen = sensor_at(machine, name), ~recording.validation, dict[str, list[Array]]()
    read = {column: values[rows] for column, values in recording.observations.items()}
    if not {*sensor.columns} <= {*read}:
        return []
    for point in point_names(sensor) if looks_from_afar(machine, sensor) else ():
        x, y, z = (read[f"{point}{axis}"] for axis in XYZ)
        aside = np.hypot(x, y)
        values = (np.arctan2(y, x), np.arctan2(z, aside), np.hypot(aside, z))
        for source, own in zip(OF_SIGHT, values, strict=True):
            seen.setdefault(source, []).append(own)
    for column in length_names(sensor):
        seen.setdefault(f"seen.{RANGE}", []).append(read[column])
    ends = {source: (float(np.nanmin(own)), float(np.nanmax(own))) for source, own in seen.items()}
    reach = {WIDTH: _reach(machine, recording)} if point_names(sensor) else {}
    return [
        seen_over({source: own}, degree) | reach
        for source, own in ends.items()
        for degree in (BOW, CURVE)
        if own[0] < own[1]
    ]


def ways_of(machine: Machine, joint: str) -> tuple[bool, ...]:
    """Whether a joint's six motions may err: where it has them, beside its displacement alone."""
    return (False, True) if drives_joint(machine, machine.mechanism.actuator(joint)) else (False,)


def degrees(joint: str, source: str, *, spatial: bool) -> tuple[int, ...]:
    """Return the degrees of the forms of one source: six motions bend one way, and a joint's own reading makes corners, for
    laws do."""
    if spatial:
        return (BOW,)
    return (LINE, BOW, FINE if source == joint else CURVE)


def arrivals(recording: Recording, joint: str) -> dict[str, tuple[float, float]]:
    """The side that a joint arrived from as a source, where both were seen."""
    name = f"{APPROACH}.{joint}"
    values, rows = recording.driver(name), ~recording.validation
    if values is None or not np.ptp(values[rows]):
        return {}
    return {name: (float(np.min(values[rows])), float(np.max(values[rows])))}


def _varied(machine: Machine, recording: Recording) -> dict[str, tuple[float, float]]:
    """Ranges of all that was varied: joints, payload, time, thermometers by name, however the file has its columns."""
    still = still_sources(machine, recording)
    every = ranges(machine, recording).items()
    seen = {name: ends for name, ends in every if ends[1] > ends[0] and name not in still}
    own = sorted(seen.keys() - set(recording.joints), key=lambda name: (Driver.of(name).thermal, name))
    return {name: seen[name] for name in (*(n for n in recording.joints if n in seen), *own)}


def ranges(machine: Machine, recording: Recording) -> dict[str, tuple[float, float]]:
    """Lowest and highest value in the calibration rows of joints, smooth drivers and, without a clock, the order of rows."""
    rows = ~recording.validation
    columns = _bending(machine, recording)
    place = recording.driver(ROW)
    if place is not None:
        columns[ROW] = place
    return {name: (float(np.min(v[rows])), float(np.max(v[rows]))) for name, v in columns.items()}


def _reach(machine: Machine, recording: Recording) -> float:
    """The farthest coordinate of any point, mm."""
    points = [point for sensor in machine.sensors for point in point_names(sensor)]
    columns = [f"{point}{axis}" for point in points for axis in XYZ]
    read = [recording.observations[name] for name in columns if name in recording.observations]
    told = [values[np.isfinite(values)] for values in read]  # a lost reading is NaN
    return max((float(np.max(np.abs(values))) for values in told if len(values)), default=1.0) or 1.0
