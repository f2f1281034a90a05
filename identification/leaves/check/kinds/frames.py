"""Base and tool: forgotten, exchanged, or said to be known while they are far off."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification.fit.align import transform
from truepose.identification.leaves.check.pair import SELDOM, USUAL, Pair, Scene, Slip
from truepose.identification.leaves.check.rig import Rig
from truepose.models.file.sections import FramesSection
from truepose.models.machine.machine import FRAMES
from truepose.models.units import convert

# -- Base and tool: forgotten, exchanged, or said to be known while they are far off


def frames_swapped(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """The base where the tool is said to be, and the other way round."""
    base, tool = rig.at["base"], rig.at["tool"]
    if np.allclose(scene.p[base], scene.p[tool]):
        return

    def change(scene: Scene) -> Scene:
        p = scene.p.copy()
        p[base], p[tool] = scene.p[tool], scene.p[base]
        return replace(scene, p=p, exchanged=not scene.exchanged)

    says = "frames.base and frames.tool exchanged"
    fix = "exchange xyz, rpy and tolerance of frames.base and frames.tool"
    yield Slip("frames-swapped", ("frames.base", "frames.tool"), says, fix, change, _mend_swap)


def _mend_swap(pair: Pair) -> Pair:
    """Each under the other's name, as exactly known as it was; what they are in stays."""
    out = pair
    for one, other in (FRAMES, FRAMES[::-1]):
        own, found = pair.get(("frames", one)) or {}, pair.get(("frames", other)) or {}
        parent = {"in": own["in"]} if "in" in own else {}
        out = out.with_field(("frames", one), {**parent, **{k: v for k, v in found.items() if k != "in"}})
    return out


def frame_unknown(rig: Rig, frame: str, found: Array) -> Slip:
    """A frame that is somewhere else than the file says: where readings put it, constants (np,) ``found``."""
    frames = rig.machine.file.frames if rig.machine.file else FramesSection()
    present = frames.is_stated(frame)
    moved = found[rig.at[frame]] - rig.scene.p[rig.at[frame]]
    here, there = (rig.frames_of(p)[FRAMES.index(frame)][:3, :3] for p in (rig.scene.p, found))
    angle = float(np.arccos(np.clip((np.trace(here.T @ there) - 1) / 2, -1, 1)))
    away = f"{np.linalg.norm(moved[:3]):.4g} mm and {np.degrees(angle):.3g} deg"

    def mend(pair: Pair) -> Pair:
        units, at, own = rig.machine.units, found[rig.at[frame]], ("frames", frame)
        parent = pair.get((*own, "in")) or ("world" if frame == "base" else "flange")
        xyz = [float(f"{convert(v, 'mm', units.length):.6g}") for v in at[:3]]
        rpy = [float(f"{convert(v, 'rad', units.angle):.6g}") for v in at[3:]]
        unknown = {"xyz": float("inf"), "rpy": float("inf")}
        return pair.with_field(own, {"in": parent, "xyz": xyz, "rpy": rpy, "tolerance": unknown})

    says = (
        f"frames.{frame} stands {away} from where the file says"
        if present
        else f"frames.{frame} is left out, which says that it is exactly the identity, and stands {away} away"
    )
    fix = f"{'state' if present else 'add'} frames.{frame} with 'tolerance: {{xyz: .inf, rpy: .inf}}' if nobody measured it"
    return Slip(f"{frame}-missing", (f"frames.{frame}",), says, fix, lambda scene: scene, mend)


# -- A table of Denavit and Hartenberg's constants typed in under another convention, in other columns, or with rows exchanged

_FIELDS = ("alpha", "d", "theta", "r")
_OWN, _SHEETS = {"a": "d", "d": "r"}, {"a": "a", "d": "d"}
"""In which fields a and d of a data sheet stand: in the program's own convention, and in those of data sheets."""
_MEANT = {
    "standard": "a standard table (a and alpha behind the joint)",
    "modified": "a modified table (Craig's: a and alpha before the joint)",
}
_MOST_JOINTS = 9


@dataclass(frozen=True)
class _Table:
    """The rows as typed (n,): mm and rad; behind: whether a and alpha come after the joint's motion, as in a standard table."""

    a: Array
    alpha: Array
    d: Array
    theta: Array
    behind: bool


def conventions(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Yield the rows of a serial chain as those of another convention, or with a and d typed in each other's place."""
    stated = _stated(rig)
    if stated is None:
        return
    own = stated == "khalil"
    for convention, words in _MEANT.items():
        for swapped in (False, True):
            behind = convention == "standard"
            if behind == (stated == "standard") and not swapped:
                continue
            straight = _OWN if own else _SHEETS
            fields = {"a": straight["d"], "d": straight["a"]} if swapped else straight
            typed = f", a typed as {fields['a']} and d typed as {fields['d']}" if own or swapped else ""
            yield Slip(
                "dh-convention",
                ("mechanism.convention" if not own else "mechanism.joints",),
                f"the joints' rows are those of {words}{typed}",
                f"state 'convention: {convention}'" + (" with fields a, alpha, d, theta" if typed else ""),
                partial(_retold, rig, stated, behind, swapped),
                partial(_mend, convention, fields),
                SELDOM if swapped and not own else USUAL,
            )


def exchanged_rows(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """Yield the table with two of its rows in each other's place."""
    stated = _stated(rig)
    if stated is None or (n := len(_rows(rig))) > _MOST_JOINTS:
        return
    for i, j in combinations(range(n), 2):
        order = np.arange(n)
        order[[i, j]] = j, i
        names = [_rows(rig)[k] for k in (i, j)]
        yield Slip(
            "permutation",
            ("mechanism.joints",),
            f"the constants of {names[0]} and {names[1]} stand in each other's row",
            f"exchange the constants of {names[0]} and {names[1]} in 'joints'",
            partial(_reordered, rig, stated, order),
            partial(_mend_rows, i, j),
            SELDOM,
        )


def _stated(rig: Rig) -> str | None:
    """Return the convention of a serial machine file; None of other machines."""
    file = rig.machine.file
    if file is None or file.mechanism.get("type") != "serial":
        return None
    return str(file.mechanism.get("convention") or "khalil")


def _places(rig: Rig, field: str) -> list[int]:
    return [rig.names.index(f"{name}.{field}") for name in _rows(rig)]


def _rows(rig: Rig) -> list[str]:
    """Return the names of the table's rows, those that are fixed among them."""
    file = rig.machine.file
    return [] if file is None else [str(row["name"]) for row in file.mechanism["joints"]]


def _typed(rig: Rig, stated: str, p: Array) -> _Table:
    """Return the rows as they were typed, from constants p (np,)."""
    alpha, a, theta, d = (p[_places(rig, field)] for field in _FIELDS)
    if stated != "standard":
        return _Table(a, alpha, d, theta, False)
    last = [p[rig.names.index(name)] if name in rig.names else 0.0 for name in ("flange.d", "flange.alpha")]
    return _Table(np.append(a[1:], last[0]), np.append(alpha[1:], last[1]), d, theta, True)


def _with_table(rig: Rig, table: _Table, scene: Scene) -> Scene:
    """Return a scene with the constants of a table; what stands behind its last joint is the flange's, or the tool's."""
    p, a, alpha = scene.p.copy(), table.a, table.alpha
    last = np.zeros(2)
    if table.behind:
        last = np.array([a[-1], alpha[-1]])
        a, alpha = np.append(0.0, a[:-1]), np.append(0.0, alpha[:-1])
    for field, values in zip(_FIELDS, (alpha, a, table.theta, table.d), strict=True):
        p[_places(rig, field)] = values
    if "flange.d" in rig.names:
        p[[rig.names.index(name) for name in ("flange.d", "flange.alpha")]] = last
    elif last.any():
        base, tool = rig.frames_of(p)
        p = rig.with_frames(p, (base, transform(np.array([last[0], 0.0, 0.0, last[1], 0.0, 0.0])) @ tool))
    return replace(scene, p=p)


def _retold(rig: Rig, stated: str, behind: bool, swapped: bool, scene: Scene) -> Scene:
    table = _typed(rig, stated, scene.p)
    a, d = (table.d, table.a) if swapped else (table.a, table.d)
    return _with_table(rig, replace(table, a=a, d=d, behind=behind), scene)


def _reordered(rig: Rig, stated: str, order: Index, scene: Scene) -> Scene:
    t = _typed(rig, stated, scene.p)
    table = _Table(t.a[order], t.alpha[order], t.d[order], t.theta[order], t.behind)
    return _with_table(rig, table, scene)


def _mend(convention: str, fields: Mapping[str, str], pair: Pair) -> Pair:
    rows: Sequence[Mapping[str, Any]] = pair.get(("mechanism", "joints")) or ()
    called = {fields["a"]: "a", fields["d"]: "d"}
    mended = [{called.get(key, key): value for key, value in row.items() if key != "beta"} for row in rows]
    return pair.with_field(("mechanism", "joints"), mended).with_field(
        ("mechanism", "convention"), convention
    )


def _mend_rows(i: int, j: int, pair: Pair) -> Pair:
    rows: list[Mapping[str, Any]] = list(pair.get(("mechanism", "joints")) or ())
    constants = ("a", "d", "r", "alpha", "beta", "theta")
    mine = [{k: v for k, v in row.items() if k in constants} for row in rows]
    rest = [{k: v for k, v in row.items() if k not in constants} for row in rows]
    mine[i], mine[j] = mine[j], mine[i]
    return pair.with_field(("mechanism", "joints"), [{**r, **m} for r, m in zip(rest, mine, strict=True)])
