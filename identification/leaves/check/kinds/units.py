"""Numbers in another unit than they are said to be in: readings, joints, the machine file's lengths and angles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from truepose.identification.leaves.check.pair import RARE, SELDOM, USUAL, Field, Pair, Scene, Slip
from truepose.identification.leaves.check.rig import Rig
from truepose.models.units import convert
from truepose.wording import joined, shortened

LENGTHS = {"mm": USUAL, "m": USUAL, "inch": USUAL, "um": SELDOM, "cm": SELDOM, "nm": RARE, "ft": RARE}
ANGLES = {"rad": USUAL, "deg": USUAL, "grad": SELDOM, "mrad": RARE, "turn": RARE}
"""Units that recordings and drawings come in, with the odds that one was taken for another."""
_ALONE = 0.1
"""Odds that one column alone is in another unit, beside those that all of a kind are."""
_DIMENSIONS = (("mm", LENGTHS), ("rad", ANGLES))
_GROUPS = (("alpha",), ("theta",), ("alpha", "theta", "beta"), ("rx", "ry", "rz"))


def units(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Every other unit for the readings, the joints (all of a kind, and each alone), both, and the machine file's numbers."""
    yield from _recorded(rig)
    yield from file_lengths(rig, scene)
    yield from _file_angles(rig)


def _said(rig: Rig) -> dict[str, str]:
    """Return the unit that each column of joints and sensors is said to be in."""
    joints = {a.reading: rig.machine.column_unit(a.reading) for a in rig.actuators}
    seen = {n: rig.machine.units.written(u) for s in rig.machine.sensors for n, u in s.columns.items()}
    return {**joints, **seen, **rig.recording.said}


def _recorded(rig: Rig) -> Iterator[Slip]:
    """Yield other units for columns of a recording: all of them at once, all readings, all joints, and each joint."""
    joints = {a.reading: a.reading_unit for a in rig.actuators}
    seen = {n: unit for s in rig.machine.sensors for n, unit in s.columns.items()}
    for length, angle in product((None, *LENGTHS), (None, *ANGLES)):
        units = _in(rig, {**joints, **seen}, {"mm": length, "rad": angle})
        named = [unit for unit in (length, angle) if unit is not None]
        if {*named} == {*units.values()} and units.keys() & joints.keys() and units.keys() & seen.keys():
            odds = min(LENGTHS.get(length or "", 1.0), ANGLES.get(angle or "", 1.0))
            yield _in_units(rig, units, f"the recording in {joined(named)}", odds, 12)
    for inside, known in _DIMENSIONS:
        for unit, odds in known.items():
            if units := _in(rig, seen, {inside: unit}):
                yield _in_units(rig, units, f"readings in {unit}", odds)
    for inside, known in _DIMENSIONS:
        like = [name for name, own in joints.items() if own == inside]
        for chosen in [like, *([name] for name in like if len(like) > 1)]:
            for unit, odds in known.items():
                if units := _in(rig, dict.fromkeys(chosen, inside), {inside: unit}):
                    says = f"{joined(tuple(units)) if len(units) < 4 else 'joints'} in {unit}"
                    yield _in_units(rig, units, says, odds if len(chosen) == len(like) else _ALONE * odds)


def _in(rig: Rig, columns: Mapping[str, str], units: Mapping[str, str | None]) -> dict[str, str]:
    """Return the columns that some unit, by what it is inside, makes other numbers of, with that unit."""
    said = _said(rig)
    meant = {
        name: unit
        for inside, unit in units.items()
        for name, own in columns.items()
        if own == inside and unit is not None
    }
    return {name: unit for name, unit in meant.items() if abs(convert(1.0, unit, said[name]) - 1.0) > 1e-9}


def _in_units(rig: Rig, units: Mapping[str, str], says: str, odds: float, shown: int = 3) -> Slip:
    """Return the slip that columns are in these units."""
    said = _said(rig)
    factors = {name: convert(1.0, unit, said[name]) for name, unit in units.items()}
    read = {n: inside for s in rig.machine.sensors for n, inside in s.columns.items() if n in factors}
    size, width = (
        max((factors[n] for n, inside in read.items() if inside == own), default=1.0) for own in ("mm", "rad")
    )
    kind = "unit-length" if set(units.values()) & set(LENGTHS) else "unit-angle"
    headers = shortened([f"{n} [{u}]" for n, u in units.items()], shown)
    fix = f"write the unit{'s' * (shown > 3)} in the header: {headers}"
    change = partial(_scaled_columns, factors, size, width)
    return Slip(kind, tuple(factors), says, fix, change, partial(Pair.in_unit, units=units), odds)


def _scaled_columns(factors: Mapping[str, float], size: float, width: float, scene: Scene) -> Scene:
    seen = {n: f * scene.rows.observations[n] for n, f in factors.items() if n in scene.rows.observations}
    out = scene.with_columns(seen, size, width)
    return out.with_joints(out.rows.q * [factors.get(name, 1.0) for name in out.rows.joints])


def _others(known: Iterable[str], unit: str) -> list[tuple[str, float]]:
    """Other units, each with how many of ``unit`` it is."""
    pairs = [(other, convert(1.0, other, unit)) for other in known]
    return [(other, factor) for other, factor in pairs if abs(factor - 1.0) > 1e-9]


def file_lengths(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Lengths of the mechanism alone, or of the whole file, in another unit; of a URDF, which has them in metres."""
    written, file = rig.machine.units, rig.machine.file
    own = {p.name for p in rig.machine.mechanism.parameters}
    every = np.flatnonzero(rig.lengths).tolist()
    drawn = [k for k in every if rig.names[k] in own]
    is_urdf = file is not None and file.mechanism.get("type") == "urdf"
    for unit, factor in _others(LENGTHS, "m" if is_urdf else written.length):
        drawing, whole = partial(_redrawn, drawn, factor, False), partial(_redrawn, every, factor, True)
        state = f"state 'units: {{length: {unit}}}' in the machine file, and the unit in the headers of the recording"
        mechanism = f"write the lengths of 'mechanism' in {written.length}"
        of_urdf = ("mechanism.file", "URDF", "write the lengths of the URDF in m", drawing, _redescribed)
        of_file = (
            ("mechanism", "mechanism", mechanism, drawing, partial(_mend_lengths, rig)),
            ("units.length", "machine file", state, whole, partial(_file_in, rig, unit)),
        )
        for where, whose, fix, change, mend in (of_urdf,) if is_urdf else of_file:
            says, mended = f"the {whose}'s lengths in {unit}", partial(mend, factor)
            yield Slip("unit-length", (where,), says, fix, change, mended, LENGTHS[unit])


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


def _file_in(rig: Rig, unit: str, _: float, pair: Pair) -> Pair:
    """The file said to be in another unit; columns of the recording say that they are in the one assumed so far."""
    long = [a.reading for a in rig.actuators if a.reading_unit == "mm"]
    long += [n for s in rig.machine.sensors for n, inside in s.columns.items() if inside == "mm"]
    bare = pair.each(
        lambda s: s.in_unit({n: rig.machine.units.length for n in long if s.units.get(n, "") is None})
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
    slides = {a.reading for a in rig.actuators if a.reading_unit == "mm"}
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
    turning = {a.reading for a in rig.actuators if a.reading_unit == "rad"}
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
    return replace(_scaled_columns(factors, 1.0, width, replace(scene, p=p)), turned=factor * scene.turned)


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
