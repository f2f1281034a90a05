"""Numbers in another unit than they are said to be in: readings, joints, the machine file's lengths and angles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from truepose.identification.leaves.check.pair import RARE, SELDOM, USUAL, Change, Field, Pair, Scene, Slip
from truepose.identification.leaves.check.rig import Rig
from truepose.models.units import UnitSystem, convert
from truepose.wording import joined, shortened

LENGTHS = {"mm": USUAL, "m": USUAL, "inch": USUAL, "um": SELDOM, "cm": SELDOM, "nm": RARE, "ft": RARE}
ANGLES = {"rad": USUAL, "deg": USUAL, "grad": SELDOM, "mrad": RARE, "turn": RARE}
"""Units that recordings and drawings come in, with the odds that one was taken for another."""
_ALONE = 0.1
"""Odds that one column alone is in another unit, beside those that all of a kind are."""
_DIMENSIONS = (("mm", "unit-length", LENGTHS), ("rad", "unit-angle", ANGLES))
_GROUPS = (("alpha",), ("theta",), ("alpha", "theta", "beta"), ("rx", "ry", "rz"))


def units(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Every other unit for the readings, the joints (all of a kind, and each alone), both, and the machine file's numbers."""
    yield from _recordings(rig)
    yield from _readings(rig)
    yield from _joints(rig)
    yield from file_lengths(rig, scene)
    yield from _file_angles(rig)


def _said(rig: Rig) -> dict[str, str]:
    """Return the unit that each column of joints and sensors is said to be in."""
    joints = {a.reading: rig.machine.column_unit(a.reading) for a in rig.machine.mechanism.actuators}
    seen = {n: rig.machine.units.written(u) for s in rig.machine.sensors for n, u in s.columns.items()}
    return {**joints, **seen, **rig.recording.said}


def _recordings(rig: Rig) -> Iterator[Slip]:
    """Yield other units for all lengths and all angles of a recording at once: everything in m and rad, say."""
    joints = {a.reading: a.reading_unit for a in rig.machine.mechanism.actuators}
    seen = {n: unit for s in rig.machine.sensors for n, unit in s.columns.items()}
    units = [*joints.items(), *seen.items()]
    alike = {inside: [n for n, unit in units if unit == inside] for inside, _, _ in _DIMENSIONS}
    others = [[(None, {}), *_otherwise(rig, alike[inside], known)] for inside, _, known in _DIMENSIONS]
    for (length, longer), (angle, wider) in product(*others):
        factors = {**longer, **wider}
        if not (factors.keys() & joints.keys() and factors.keys() & seen.keys()):
            continue
        named_units = {**dict.fromkeys(longer, length or ""), **dict.fromkeys(wider, angle or "")}
        named = [u for u, f in ((length, longer), (angle, wider)) if f and u]
        size, width = (max((f[n] for n in f if n in seen), default=1.0) for f in (longer, wider))
        yield Slip(
            "unit-length" if longer else "unit-angle",
            tuple(factors),
            f"the recording in {joined(named)}",
            f"write the units in the header: {shortened([f'{n} [{u}]' for n, u in named_units.items()], 12)}",
            partial(_scaled_both, factors, size, width),
            partial(_said_in, named_units),
            min((LENGTHS[length] if length else 1.0), (ANGLES[angle] if angle else 1.0)),
        )


def _scaled_both(factors: Mapping[str, float], size: float, width: float, scene: Scene) -> Scene:
    seen = {n: f for n, f in factors.items() if n in scene.rows.observations}
    return _scaled_joints(factors, _scaled_columns(seen, size, width, scene))


def _said_in(units: Mapping[str, str], pair: Pair) -> Pair:
    for name, unit in units.items():
        pair = pair.in_unit((name,), unit)
    return pair


def _others(known: Iterable[str], unit: str) -> list[tuple[str, float]]:
    """Other units, each with how many of ``unit`` it is."""
    pairs = [(other, convert(1.0, other, unit)) for other in known]
    return [(other, factor) for other, factor in pairs if abs(factor - 1.0) > 1e-9]


def _readings(rig: Rig) -> Iterator[Slip]:
    for inside, kind, known in _DIMENSIONS:
        names = tuple(n for s in rig.machine.sensors for n, unit in s.columns.items() if unit == inside)
        for unit, factors in _otherwise(rig, names, known):
            most = max(factors.values())
            sizes = (most, 1.0) if inside == "mm" else (1.0, most)
            change = partial(_scaled_columns, factors, *sizes)
            yield _in_unit(kind, factors, unit, f"readings in {unit}", change, known[unit])


def _joints(rig: Rig) -> Iterator[Slip]:
    for inside, kind, known in _DIMENSIONS:
        like = [a.reading for a in rig.machine.mechanism.actuators if a.reading_unit == inside]
        sets = [tuple(like), *((name,) for name in like)] if len(like) > 1 else [tuple(like)]
        for chosen in sets:
            odds = _ALONE if len(chosen) < len(like) else 1.0
            for unit, factors in _otherwise(rig, chosen, known):
                says = f"{joined(tuple(factors)) if len(factors) < 4 else 'joints'} in {unit}"
                change = partial(_scaled_joints, factors)
                yield _in_unit(kind, factors, unit, says, change, odds * known[unit])


def _otherwise(
    rig: Rig, names: Sequence[str], known: Iterable[str]
) -> Iterator[tuple[str, dict[str, float]]]:
    """Every unit that columns may be in, and by how much those that are said to be in another one then grow."""
    said = _said(rig)
    for unit in known:
        factors = {name: convert(1.0, unit, said[name]) for name in names}
        factors = {name: factor for name, factor in factors.items() if abs(factor - 1.0) > 1e-9}
        if factors:
            yield unit, factors


def _in_unit(
    kind: str, factors: Mapping[str, float], unit: str, says: str, change: Change, odds: float
) -> Slip:
    fix = f"write the unit in the header: {shortened([f'{n} [{unit}]' for n in factors], 3)}"
    return Slip(
        kind, tuple(factors), says, fix, change, lambda pair: pair.in_unit(tuple(factors), unit), odds
    )


def _scaled_columns(factors: Mapping[str, float], size: float, width: float, scene: Scene) -> Scene:
    columns = {n: f * scene.rows.observations[n] for n, f in factors.items()}
    return scene.with_columns(columns, size, width)


def _scaled_joints(factors: Mapping[str, float], scene: Scene) -> Scene:
    return scene.with_joints(scene.rows.q * [factors.get(name, 1.0) for name in scene.rows.joints])


def file_lengths(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Lengths of the mechanism alone, or of the whole file, in another unit."""
    written, file = rig.machine.units, rig.machine.file
    own = {p.name for p in rig.machine.mechanism.parameters}
    every = np.flatnonzero(rig.lengths).tolist()
    drawn = [k for k in every if rig.names[k] in own]
    if file is not None and file.mechanism.get("type") == "urdf":
        yield from _description_lengths(drawn)
        return
    for unit, factor in _others(LENGTHS, written.length):
        for places, whole in ((drawn, False), (every, True)):
            where = ("units.length",) if whole else ("mechanism",)
            yield Slip(
                "unit-length",
                where,
                f"the {'machine file' if whole else 'mechanism'}'s lengths in {unit}",
                f"state 'units: {{length: {unit}}}' in the machine file, and the unit in the headers of the recording"
                if whole
                else f"write the lengths of 'mechanism' in {written.length}",
                partial(_redrawn, places, factor, whole),
                partial(_file_in, rig.machine.units, unit, rig)
                if whole
                else partial(_mend_lengths, rig, factor),
                LENGTHS[unit],
            )


def _description_lengths(places: Sequence[int]) -> Iterator[Slip]:
    """Lengths of a URDF, which has them in metres, in another unit."""
    for unit, factor in _others(LENGTHS, "m"):
        yield Slip(
            "unit-length",
            ("mechanism.file",),
            f"the URDF's lengths in {unit}",
            "write the lengths of the URDF in m",
            partial(_redrawn, places, factor, False),
            partial(_redescribed, factor),
            LENGTHS[unit],
        )


def _redescribed(factor: float, pair: Pair) -> Pair:
    return replace(pair, described=factor * pair.described)


def _scaled_constants(places: Sequence[int], factor: float, scene: Scene) -> Scene:
    p = scene.p.copy()
    p[places] *= factor
    return replace(scene, p=p)


def _redrawn(places: Sequence[int], factor: float, whole: bool, scene: Scene) -> Scene:
    """Lengths of the mechanism times ``factor``; those of its tolerances and sigmas too where the ``whole`` file was in
    another unit; of tolerances where the machine would be smaller: no drawing a thousand times smaller has the same ones."""
    out = _scaled_constants(places, factor, scene)
    stated = (factor if whole else min(factor, 1.0)) * scene.stated
    coarse = (factor if whole else 1.0) * scene.coarse
    return replace(out, drawn=factor * scene.drawn, stated=stated, coarse=coarse)


def _file_in(written: UnitSystem, unit: str, rig: Rig, pair: Pair) -> Pair:
    """The file said to be in another unit; columns of the recording say that they are in the one assumed so far."""
    long = [a.reading for a in rig.machine.mechanism.actuators if a.reading_unit == "mm"]
    long += [n for s in rig.machine.sensors for n, inside in s.columns.items() if inside == "mm"]
    bare = pair.each(
        lambda s: s.in_unit([n for n in long if n in s.units and s.units[n] is None], written.length)
    )
    return bare.with_field(("units", "length"), unit)


def _mend_lengths(rig: Rig, factor: float, pair: Pair) -> Pair:
    fields = _table_fields(rig, ("a", "d"))
    grow = {name for name, grows in zip(rig.names, rig.lengths, strict=True) if grows}
    fields = fields or [p.field for p in rig.machine.mechanism.parameters if p.name in grow]
    listed = isinstance(pair.get(("mechanism", "home")), list)
    home: list[Field] = [("mechanism", "home", k) for k in range(3)] if listed else []
    return _scaled_fields(pair, [*fields, *home, *_strokes(rig, pair)], factor)


def _strokes(rig: Rig, pair: Pair) -> list[Field]:
    """Screw pitches, and ranges of slides: lengths of a mechanism that are no constants of its model."""
    slides = {a.reading for a in rig.machine.mechanism.actuators if a.reading_unit == "mm"}
    places: list[Field] = [("mechanism", "limb_range"), ("mechanism", "screw_pitch")]
    for group in ("joints", "legs"):
        for k, row in enumerate(pair.get(("mechanism", group)) or []):
            places.append(("mechanism", group, k, "screw_pitch"))
            if {row.get("name"), row.get("joint")} & slides:
                places.append(("mechanism", group, k, "range"))
    ends = [(*place, end) for place in places for end in (0, 1) if isinstance(pair.get(place), list)]
    return [*(place for place in places if not isinstance(pair.get(place), list)), *ends]


def _table_fields(rig: Rig, keys: Sequence[str]) -> list[Field]:
    """Fields of the rows of a standard or modified table, whose constants the program holds in another form."""
    section = rig.machine.file.mechanism if rig.machine.file else {}
    if section.get("convention", "khalil") == "khalil":
        return []
    return [("mechanism", "joints", k, key) for k in range(len(section["joints"])) for key in keys]


def _scaled_fields(pair: Pair, fields: Sequence[Field], factor: float) -> Pair:
    for field in fields:
        value = pair.get(field)
        if field and isinstance(value, (int, float)) and value:
            pair = pair.with_field(field, float(f"{value * factor:.12g}"))
    return pair


def _all_angles(rig: Rig) -> Iterator[Slip]:
    """Yield the whole file, and the columns that name no unit, with their angles in another unit than ``units`` says."""
    written, said = rig.machine.units.angle, rig.recording.said
    turning = {a.reading for a in rig.machine.mechanism.actuators if a.reading_unit == "rad"}
    columns = turning | {n for s in rig.machine.sensors for n, unit in s.columns.items() if unit == "rad"}
    alike = [name for name in columns if said.get(name, written) == written]
    if not turning & set(alike):
        return
    for unit, factor in _others(("rad", "deg"), written):
        yield Slip(
            "unit-angle",
            ("units.angle",),
            f"all angles in {unit}, where the machine file says {written}",
            f"state 'units: {{angle: {unit}}}' in the machine file",
            partial(_turned, rig, dict.fromkeys(alike, factor), factor),
            partial(Pair.with_field, field=("units", "angle"), value=unit),
        )


def _turned(rig: Rig, factors: Mapping[str, float], factor: float, scene: Scene) -> Scene:
    p = scene.p.copy()
    p[rig.angles] *= factor
    width = factor if factors.keys() & scene.rows.observations.keys() else 1.0
    return replace(_scaled_both(factors, 1.0, width, replace(scene, p=p)), turned=factor * scene.turned)


def _file_angles(rig: Rig) -> Iterator[Slip]:
    yield from _all_angles(rig)
    written = rig.machine.units.angle
    own = {p.name: p for p in rig.machine.mechanism.parameters if p.unit == "rad"}
    for ends in _GROUPS:
        places = [k for k, n in enumerate(rig.names) if n in own and n.rpartition(".")[2] in ends]
        if not np.any(rig.scene.p[places]):
            continue
        for unit, factor in _others(("rad", "deg"), written):
            fields = _table_fields(rig, ends) or [own[rig.names[k]].field for k in places]
            there = {rig.names[k].rpartition(".")[2] for k in places}
            yield Slip(
                "unit-angle",
                tuple(f"mechanism.{end}" for end in ends if end in there),
                f"{joined(ends)} of the mechanism in {unit}",
                f"write {joined(ends)} in {written} (or state 'units: {{angle: {unit}}}' for the whole file)",
                partial(_scaled_constants, places, factor),
                partial(_scaled_fields, fields=fields, factor=factor),
            )
