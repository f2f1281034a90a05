"""Base and tool: forgotten, exchanged, or said to be known while they are far off."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from truepose.identification.check.pair import Pair
from truepose.identification.check.rig import Rig, Scene
from truepose.identification.check.slip import Slip
from truepose.models.machine import FRAMES
from truepose.models.machine_file import FrameSpec
from truepose.models.units import convert
from truepose.wording import joined

Array = NDArray[np.float64]


def frames_swapped(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """The base where the tool is said to be, and the other way round."""
    base, tool = rig.at["base"], rig.at["tool"]
    if np.allclose(scene.p[base], scene.p[tool]):
        return

    def change(scene: Scene) -> Scene:
        p = scene.p.copy()
        p[base], p[tool] = scene.p[tool], scene.p[base]
        return Scene(scene.rows, p, scene.size, scene.lost)

    yield Slip(
        "frames-swapped",
        ("frames.base", "frames.tool"),
        "frames.base and frames.tool exchanged",
        "exchange xyz and rpy of frames.base and frames.tool",
        change,
        _mend_swap,
    )


def _mend_swap(pair: Pair) -> Pair:
    out = pair
    for one, other in (FRAMES, FRAMES[::-1]):
        for part in ("xyz", "rpy"):
            value = pair.get(("frames", other, part))
            out = out.with_field(("frames", one, part), value if value is not None else [0.0, 0.0, 0.0])
    return out


def frame_unknown(rig: Rig, frames: Sequence[str], found: Array) -> Slip:
    """Frames that are somewhere else than the file says: where readings put them, constants (np,) ``found``."""
    file = rig.machine.file
    specs = {"base": file.frames.base, "tool": file.frames.tool} if file else {}
    says = []
    for frame in frames:
        spec = specs.get(frame)
        moved = found[rig.at[frame]] - rig.scene.p[rig.at[frame]]
        away = f"{np.linalg.norm(moved[:3]):.4g} mm and {np.degrees(_angle(rig, frame, found)):.3g} deg"
        if spec is None or not spec.present:
            says.append(
                f"frames.{frame} is left out, which says that it is exactly the identity, and stands {away} away"
            )
        else:
            says.append(f"frames.{frame} stands {away} from where the file says")
    kind = f"{frames[0]}-missing"
    words = (
        "; add " if any(s is None or not s.present for s in (specs.get(f) for f in frames)) else "; state "
    )
    fix = joined(
        f"frames.{f} with 'tolerance: {{xyz: .inf, rpy: .inf}}' if nobody measured it" for f in frames
    )
    return Slip(
        kind,
        tuple(f"frames.{frame}" for frame in frames),
        "; ".join(says),
        f"{words[2:]}{fix}",
        lambda scene: scene,
        partial(_mend_unknown, rig, frames, found),
    )


def _angle(rig: Rig, frame: str, found: Array) -> float:
    here, there = (rig.frames_of(p)[FRAMES.index(frame)][:3, :3] for p in (rig.scene.p, found))
    return float(np.arccos(np.clip((np.trace(here.T @ there) - 1) / 2, -1, 1)))


def _mend_unknown(rig: Rig, frames: Sequence[str], found: Array, pair: Pair) -> Pair:
    units = rig.machine.units
    for frame in frames:
        at = found[rig.at[frame]]
        spec = FrameSpec("world" if frame == "base" else "flange")
        pair = pair.with_field(("frames", frame, "in"), pair.get(("frames", frame, "in")) or spec.in_)
        pair = pair.with_field(
            ("frames", frame, "xyz"), [float(f"{convert(v, 'mm', units.length):.6g}") for v in at[:3]]
        )
        pair = pair.with_field(
            ("frames", frame, "rpy"), [float(f"{convert(v, 'rad', units.angle):.6g}") for v in at[3:]]
        )
        pair = pair.with_field(("frames", frame, "tolerance"), {"xyz": float("inf"), "rpy": float("inf")})
    return pair


__all__ = ["frame_unknown", "frames_swapped"]
