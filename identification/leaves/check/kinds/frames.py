"""Base and tool: forgotten, exchanged, or said to be known while they are far off."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from truepose.identification.leaves.check.pair import Pair, Scene, Slip
from truepose.identification.leaves.check.rig import Rig
from truepose.models.file.machine_file import Frames
from truepose.models.machine.machine import FRAMES
from truepose.models.units import convert

Array = NDArray[np.float64]


def frames_swapped(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """The base where the tool is said to be, and the other way round."""
    base, tool = rig.at["base"], rig.at["tool"]
    if np.allclose(scene.p[base], scene.p[tool]):
        return

    def change(scene: Scene) -> Scene:
        p = scene.p.copy()
        p[base], p[tool] = scene.p[tool], scene.p[base]
        return replace(scene, p=p, exchanged=not scene.exchanged)

    yield Slip(
        "frames-swapped",
        ("frames.base", "frames.tool"),
        "frames.base and frames.tool exchanged",
        "exchange xyz, rpy and tolerance of frames.base and frames.tool",
        change,
        _mend_swap,
    )


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
    frames = rig.machine.file.frames if rig.machine.file else Frames()
    present = (frames.base if frame == "base" else frames.tool).present
    moved = found[rig.at[frame]] - rig.scene.p[rig.at[frame]]
    away = f"{np.linalg.norm(moved[:3]):.4g} mm and {np.degrees(_angle(rig, frame, found)):.3g} deg"
    return Slip(
        f"{frame}-missing",
        (f"frames.{frame}",),
        f"frames.{frame} stands {away} from where the file says"
        if present
        else f"frames.{frame} is left out, which says that it is exactly the identity, and stands {away} away",
        f"{'state' if present else 'add'} frames.{frame} with 'tolerance: {{xyz: .inf, rpy: .inf}}' if nobody measured it",
        lambda scene: scene,
        partial(_mend_unknown, rig, frame, found),
    )


def _angle(rig: Rig, frame: str, found: Array) -> float:
    here, there = (rig.frames_of(p)[FRAMES.index(frame)][:3, :3] for p in (rig.scene.p, found))
    return float(np.arccos(np.clip((np.trace(here.T @ there) - 1) / 2, -1, 1)))


def _mend_unknown(rig: Rig, frame: str, found: Array, pair: Pair) -> Pair:
    units, at, own = rig.machine.units, found[rig.at[frame]], ("frames", frame)
    parent = pair.get((*own, "in")) or ("world" if frame == "base" else "flange")
    xyz = [float(f"{convert(v, 'mm', units.length):.6g}") for v in at[:3]]
    rpy = [float(f"{convert(v, 'rad', units.angle):.6g}") for v in at[3:]]
    unknown = {"xyz": float("inf"), "rpy": float("inf")}
    return pair.with_field(own, {"in": parent, "xyz": xyz, "rpy": rpy, "tolerance": unknown})


__all__ = ["frame_unknown", "frames_swapped"]
