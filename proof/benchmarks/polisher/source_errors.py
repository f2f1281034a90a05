"""Every source error of the paper as a parameter of a graph: joints of one degree of freedom, 150 errors.

Universal joints are two revolutes, spherical ones three. Link j of limb i has six errors between joints j and j + 1,
less the one about (along) joint j's own axis, which its displacement makes up for; link 0 has all six (appendix A).
Limb and link numbers are the paper's. Its axes (z along the joint, x along the common normal to the next one) are
named by the graph's, which span the same errors.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

from . import workspace as ws

LIMBS, MIDDLE = (1, 2, 3), 4
_SYMBOL = {"offset": "xi", "x": "x", "y": "y", "z": "z", "rx": "alpha", "ry": "beta", "rz": "gamma"}
_FRAME = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class SourceError:
    """One error of link (encoder: of joint) j in limb i and the graph's parameter for it."""

    link: int
    limb: int
    parameter: str

    @property
    def component(self) -> str:
        """``offset`` of an encoder, else ``x y z rx ry rz``."""
        return self.parameter.rsplit(".", 1)[1]

    @property
    def turns(self) -> bool:
        """Whether it is an angle."""
        return self.component.startswith("r") or (self.component == "offset" and self.limb == MIDDLE)

    @property
    def name(self) -> str:
        """Numbered as in the paper: ``xi_3,1``, ``x_0,1``, ``alpha_3,4``."""
        return f"{_SYMBOL[self.component]}_{self.link},{self.limb}"


def source_errors(ball: str = "xyz") -> tuple[SourceError, ...]:
    """All of them: the six encoders first, then limbs 1 to 4, link by link; ``ball`` orders the spherical axes."""
    encoders = [SourceError(3, k, f"q{k}.offset") for k in LIMBS]
    encoders += [SourceError(j, MIDDLE, f"q{j}.offset") for j in (4, 5, 6)]
    limbs = [error for k in (*LIMBS, MIDDLE) for error in _of_limb(k, ball)]
    return (*encoders, *limbs)


def frames(limb: int) -> tuple[str, ...]:
    """The graph's frame in which the error of each link of a limb stands: that of the next joint."""
    if limb == MIDDLE:
        return "up1", "up2", "up3", "plate", "q5", "q6", "tool"
    return f"u{limb}a", f"u{limb}b", f"q{limb}", f"s{limb}a", f"s{limb}b", f"s{limb}c", f"mount{limb}"


def _of_limb(limb: int, ball: str) -> Iterator[SourceError]:
    """Errors of the links of one limb, less what each joint makes up for."""
    behind = ("rz", "ry", "rx") if limb == MIDDLE else tuple(f"r{axis}" for axis in ball)
    for link, (frame, own) in enumerate(zip(frames(limb), ("", "rx", "ry", "z", *behind), strict=True)):
        yield from (SourceError(link, limb, f"{frame}.{c}") for c in _FRAME if c != own)


def source_error_machine(length: float = 0.05, angle: float = 0.02, ball: str = "xyz") -> Machine:
    """The machine of all source errors with tolerances in mm and deg; everything else in it is exactly known."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "source-errors.yaml"
        path.write_text(yaml.safe_dump(_document(length, angle, ball), sort_keys=False), encoding="utf-8")
        return load_machine(path)


def _document(length: float, angle: float, ball: str) -> dict[str, Any]:
    joints = [*_middle(), *(joint for k in LIMBS for joint in _limb(k, ball)), *_wrist()]
    bodies = list(dict.fromkeys(joint[end] for joint in joints for end in ("parent", "child")))
    tolerances: dict[str, Any] = {"length": 0.0, "angle": 0.0}
    for error in source_errors(ball):
        encoder = error.component == "offset"
        if error.turns:
            tolerances[error.parameter] = ws.ENCODER_DEG if encoder else angle
        else:
            tolerances[error.parameter] = ws.ENCODER_MM if encoder else length
    tool = [0.0, 0.0, ws.WRIST_OFFSET + ws.HEAD]
    base = {"in": "world", "xyz": ws.base_origin().tolist(), "rpy": [0.0, 180.0 - math.degrees(ws.BETA), 0.0]}
    return {
        "schema": "truepose/machine/1",
        "name": "polisher",
        "units": {"length": "mm", "angle": "deg"},
        "mechanism": {"type": "graph", "bodies": bodies, "joints": joints, "home": {"up3": 860.0}},
        "frames": {"base": base, "tool": {"in": "flange", "xyz": tool}},
        "sensor": {
            "type": "targets",
            "points": {name: list(point) for name, point in ws.POINTS.items()},
            "sigma": {"xyz": ws.SIGMA},
        },
        "tolerances": tolerances,
    }


def _middle() -> list[dict[str, Any]]:
    return [
        _joint("up1", "revolute", "base", "up_cross", "x"),
        _joint("up2", "revolute", "up_cross", "up_tube", "y"),
        _joint("up3", "prismatic", "up_tube", "up_rod", "z"),
        _joint("plate", "fixed", "up_rod", "platform"),
    ]


def _limb(k: int, ball: str) -> list[dict[str, Any]]:
    azimuth = [0.0, 0.0, 120.0 * (k - 1)]
    lower, upper = (
        (radius * ws.azimuths()[k - 1]).tolist() for radius in (ws.BASE_RADIUS, ws.PLATFORM_RADIUS)
    )
    bodies = (f"rod{k}", f"s{k}_1", f"s{k}_2", f"ball{k}")
    turns = [
        _joint(f"s{k}{letter}", "revolute", bodies[n], bodies[n + 1], axis)
        for n, (letter, axis) in enumerate(zip("abc", ball, strict=True))
    ]
    return [
        {**_joint(f"u{k}a", "revolute", "base", f"cross{k}", "x"), "xyz": lower, "rpy": azimuth},
        _joint(f"u{k}b", "revolute", f"cross{k}", f"tube{k}", "y"),
        {
            **_joint(f"q{k}", "prismatic", f"tube{k}", f"rod{k}", "z"),
            "actuated": True,
            "range": list(ws.LIMB_RANGE),
        },
        *turns[:2],
        {**_joint(f"mount{k}", "fixed", "platform", f"ball{k}"), "xyz": upper, "rpy": azimuth},
        turns[2],
    ]


def _wrist() -> list[dict[str, Any]]:
    bodies = ("platform", "wrist4", "wrist5", "flange")
    out = [
        {
            **_joint(f"q{4 + n}", "revolute", bodies[n], bodies[n + 1], axis),
            "actuated": True,
            "range": [-90.0, 90.0],
        }
        for n, axis in enumerate("zyx")
    ]
    out[0]["xyz"] = [0.0, 0.0, ws.PLATFORM_OFFSET]
    return out


def _joint(name: str, kind: str, parent: str, child: str, axis: str = "z") -> dict[str, Any]:
    direction = [1 if axis == other else 0 for other in "xyz"]
    return {"name": name, "kind": kind, "parent": parent, "child": child, "axis": direction}
