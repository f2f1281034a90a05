"""Lengths and angles written in another unit than the file says."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np

from ..pairs import TURNS, Document, Pair
from .spoilt import Spoilt

FACTORS = {"m": 1e-3, "cm": 0.1, "inch": 1 / 25.4, "um": 1e3}
WHOLE = {"m": 1e-3, "inch": 1 / 25.4}
LENGTHS = (
    "a",
    "b",
    "d",
    "r",
    "length",
    "offset",
    "screw_pitch",
    "xyz",
    "com",
    "points",
    "centre",
    "ball",
    "distance",
    "z",
)
HYBRID = ("base_radius", "platform_radius", "platform_offset", "wrist_offset", "head", "tool", "limb_range")
ANGLES = ("alpha", "theta", "beta")
Option = Callable[[Pair, np.random.Generator], Spoilt | None]


def unit_length(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Readings, slides or the whole machine file in m, cm, inch or um."""
    return _first(pair, rng, (_readings, _slides, _machine))


def unit_angle(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Joints, twists of the table, or rotations in rad where deg are expected, or the reverse."""
    return _first(pair, rng, (_joints, _labelled, _table, _rotations, _stated))


def _first(pair: Pair, rng: np.random.Generator, options: tuple[Option, ...]) -> Spoilt | None:
    for k in rng.permutation(len(options)):
        made = options[int(k)](pair, rng)
        if made is not None:
            return made
    return None


def _readings(pair: Pair, rng: np.random.Generator) -> Spoilt:
    unit = str(rng.choice(list(FACTORS)))
    document, table = pair.draft()
    for name in pair.lengths:
        table[name] *= FACTORS[unit]
    return Spoilt(f"readings in {unit}", document, table, (*pair.lengths, "readings", "sensor", "recording"))


def _slides(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    sliding = [name for name, kind in pair.joints.items() if kind == "prismatic"]
    if not sliding:
        return None
    unit = str(rng.choice(list(FACTORS)))
    document, table = pair.draft()
    for name in sliding:
        table[name] *= FACTORS[unit]
    return Spoilt(f"slides in {unit}", document, table, (*sliding, "joints"))


def _machine(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Every length of the machine file; a URDF, which is in m, in mm."""
    document, table = pair.draft()
    where = (
        "machine",
        "mechanism",
        "units",
        "file",
        "frames",
        "base",
        "tool",
        "units.length",
        "machine.yaml",
        "joints",
    )
    if pair.form == "urdf":
        files = {name: _in_millimetres(text) for name, text in pair.files.items()}
        return Spoilt("urdf in mm", document, table, (*where, *pair.files), files=files)
    if set(document.get("tolerances", {})) - {"length", "angle"}:
        return None  # overrides of lengths and angles side by side
    unit = str(rng.choice(list(WHOLE)))
    sliding = {name for name, kind in pair.joints.items() if kind == "prismatic"}
    return Spoilt(f"machine in {unit}", scaled(document, WHOLE[unit], sliding), table, where)


def _in_millimetres(text: str) -> str:
    def larger(match: re.Match[str]) -> str:
        values = " ".join(f"{1e3 * float(v):.9g}" for v in match.group(1).split())
        return f"<origin xyz='{values}'"

    return re.sub(r"<origin xyz='([^']*)'", larger, text)


def scaled(document: Document, factor: float, slides: set[str]) -> Document:
    """The document with every length times ``factor``, tolerances and sigmas of lengths among them."""
    out = {
        key: _scaled(value, factor)
        for key, value in document.items()
        if key not in ("mechanism", "tolerances")
    }
    mechanism = _scaled(document["mechanism"], factor)
    for entry in (*mechanism.get("joints", ()), *mechanism.get("legs", ())):
        if "range" in entry and (entry.get("name") in slides or entry.get("joint") in slides):
            entry["range"] = [factor * v for v in entry["range"]]
    for name in HYBRID if mechanism["type"] == "3ups-up-3r" else ():
        if name in mechanism:
            mechanism[name] = _times(mechanism[name], factor)
    if "home" in mechanism and isinstance(mechanism["home"], list):
        mechanism["home"] = [v * (factor if k < 3 else 1.0) for k, v in enumerate(mechanism["home"])]
    tolerances = {k: v * factor if k == "length" else v for k, v in document.get("tolerances", {}).items()}
    order = {**out, "mechanism": mechanism, **({"tolerances": tolerances} if tolerances else {})}
    return {key: order[key] for key in document if key in order}


def _scaled(value: Any, factor: float, inside: str = "") -> Any:
    """A section with the lengths in it times ``factor``; masses, directions and angles stay."""
    if isinstance(value, dict):
        return {
            k: _times(v, factor) if _is_length(k, v, inside) else _scaled(v, factor, k)
            for k, v in value.items()
        }
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return [_scaled(v, factor, inside) for v in value]
    return value


def _is_length(key: str, value: Any, inside: str) -> bool:
    if key in ("points",) and isinstance(value, dict):
        return True
    if key.endswith(".xyz") or key in ("mirror.z",):
        return True
    return key in LENGTHS and not isinstance(value, str) and inside not in ("units",)


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, dict):
        return {k: _times(v, factor) for k, v in value.items()}
    if isinstance(value, list):
        return [_times(v, factor) for v in value]
    return float(value) * factor


def _turning(pair: Pair) -> list[str]:
    return [name for name, kind in pair.joints.items() if kind == "revolute"]


def _joints(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    turning = _turning(pair)
    if not turning:
        return None
    document, table = pair.draft()
    for name in turning:
        table[name] = np.radians(table[name])
    return Spoilt("joints in rad", document, table, (*turning, "joints"))


def _labelled(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Degrees under a header that says rad."""
    turning = _turning(pair)
    if not turning or rng.random() < 0.5:
        return None
    document, table = pair.draft()
    table = table.rename(columns={name: f"{name} [rad]" for name in turning})
    return Spoilt("joints in deg under [rad]", document, table, (*turning, "joints"))


def _table(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Fixed angles of a serial table, or turns of a graph, in rad."""
    if pair.form not in ("serial", "graph"):
        return None
    document, table = pair.draft()
    fields = ("alpha",) if rng.random() < 0.4 else ANGLES
    changed = set()
    for joint in document["mechanism"]["joints"]:
        for name in (*fields, "rpy"):
            if name in joint and np.any(joint[name]):
                joint[name] = np.radians(joint[name]).tolist()
                changed.add(name)
    if not changed:
        return None
    names = [j["name"] for j in document["mechanism"]["joints"]]
    where = (
        *changed,
        *names,
        *(f"{n}.{c}" for n in names for c in changed),
        "mechanism",
        "joints",
        "machine",
    )
    return Spoilt("table in rad", document, table, where)


def _rotations(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    if pair.sensor != "pose":
        return None
    document, table = pair.draft()
    for name in TURNS:
        table[name] = np.radians(table[name])
    return Spoilt("rotations in rad", document, table, (*TURNS, "readings", "sensor", "rotations"))


def _stated(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """``units: {angle: rad}`` above values in deg."""
    if not _turning(pair) or rng.random() < 0.7:
        return None
    document, table = pair.draft()
    document["units"] = {**document.get("units", {}), "angle": "rad"}
    where = ("units", "angle", "units.angle", "machine", "mechanism", *_turning(pair), "joints")
    return Spoilt("units say rad", document, table, where)
