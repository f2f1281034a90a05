"""The telescope as drawn and as built: nominal parameters, tolerances, and draws of true machines.

Parameters are named as in a machine file (`leg1.a.x`, `base.rx`, ...), in mm and rad. Lower joint centre
`a + (rho + offset) u` in the base frame, upper one `b` in the platform frame; `u.x` and `u.y` are parameters
and `u.z` follows. World (sensor) frame <- base <- platform <- tool.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from .ring import LEG_ANGLES
from .rotations import Array, rpy_matrix, transform

BASE_ANGLES = (-12.0, 12.0, 108.0, 132.0, 228.0, 252.0)  # deg, legs 1..6
BASE_RADIUS, PLATFORM_RADIUS, LEG_LENGTH, FLEXURE_LENGTH, TRAVEL = 400.0, 250.0, 500.0, 30.0, 1.3  # mm
TOOL_Z = 120.0  # mm
TOLERANCES = {"leg": (0.1, np.radians(0.1)), "base": (5.0, np.radians(1.0)), "tool": (1.0, np.radians(0.5))}
FRAME_KEYS = ("x", "y", "z", "rx", "ry", "rz")
LEG_KEYS = ("a.x", "a.y", "a.z", "b.x", "b.y", "b.z", "u.x", "u.y", "length", "offset")
DECIMALS = 9  # of every drawn parameter, mm and rad: what a truth file says is what was simulated


def _targets() -> dict[str, tuple[float, float, float]]:
    """Twelve points on the hub body in the tool frame (mm): two circles at two heights."""
    points: dict[str, tuple[float, float, float]] = {}
    for first, start, radius, height in ((1, 0.0, 175.0, -85.0), (7, 25.0, 105.0, -10.0)):
        for k in range(6):
            t = np.radians(start + 60 * k)
            x, y = np.round(radius * np.cos(t), 3) + 0.0, np.round(radius * np.sin(t), 3) + 0.0
            points[f"P{first + k}"] = (float(x), float(y), height)
    return points


TARGETS: Mapping[str, tuple[float, float, float]] = MappingProxyType(_targets())


@dataclass(frozen=True)
class Machine:
    """One telescope: every geometric parameter by name, mm and rad."""

    parameters: Mapping[str, float]

    def vector(self, name: str, keys: tuple[str, ...]) -> Array:
        """(k,) values of `name.key` for each of k keys."""
        return np.array([self.parameters[f"{name}.{key}"] for key in keys])

    def legs(self, keys: tuple[str, ...]) -> Array:
        """(6, k) values of k parameters of the legs."""
        return np.array([self.vector(f"leg{i}", keys) for i in range(1, 7)])

    @property
    def directions(self) -> Array:
        """(6, 3) unit vectors of the actuators, base frame."""
        u = self.legs(("u.x", "u.y"))
        return np.column_stack([u, np.sqrt(1 - np.sum(u**2, axis=1))])

    def lower_centres(self, travel: Array) -> Array:
        """(..., 6, 3) joint centres a + (travel + offset) u in the base frame; travel (..., 6) in mm."""
        shift = travel + self.legs(("offset",))[:, 0]
        return np.asarray(self.legs(("a.x", "a.y", "a.z")) + shift[..., None] * self.directions)

    @property
    def upper_centres(self) -> Array:
        """(6, 3) joint centres b in the platform frame, undeformed, mm."""
        return self.legs(("b.x", "b.y", "b.z"))

    @property
    def lengths(self) -> Array:
        """(6,) distances between the joint centres, mm."""
        return self.legs(("length",))[:, 0]

    def frame(self, name: str) -> Array:
        """(4, 4) transform of `base` (world <- base) or `tool` (platform <- tool)."""
        v = self.vector(name, FRAME_KEYS)
        return transform(rpy_matrix(v[3:]), v[:3])


def _circle(radius: float, angles: tuple[float, ...]) -> Array:
    """(n, 2) points on a circle, rounded to the machine file's 4 decimals, mm."""
    t = np.radians(angles)
    return np.round(radius * np.stack([np.cos(t), np.sin(t)], axis=1), 4)


def nominal_machine() -> Machine:
    """The telescope as drawn (the numbers of machine.yaml)."""
    values: dict[str, float] = {}
    a, b = _circle(BASE_RADIUS, BASE_ANGLES), _circle(PLATFORM_RADIUS, LEG_ANGLES)
    for i in range(6):
        leg = (*a[i], 0.0, *b[i], 0.0, 0.0, 0.0, LEG_LENGTH, 0.0)
        values |= {f"leg{i + 1}.{key}": float(v) for key, v in zip(LEG_KEYS, leg, strict=True)}
    values |= {f"base.{key}": 0.0 for key in FRAME_KEYS}
    values |= {f"tool.{key}": TOOL_Z if key == "z" else 0.0 for key in FRAME_KEYS}
    return Machine(MappingProxyType(values))


def tolerance(name: str) -> float:
    """1-sigma tolerance of a parameter, mm or rad."""
    length, angle = TOLERANCES["leg" if name.startswith("leg") else name.split(".", maxsplit=1)[0]]
    last = name.rsplit(".", 1)[-1]
    return angle if ".u." in name or last in {"rx", "ry", "rz"} else length


def draw_machine(seed: int, scale: float = 1.0) -> Machine:
    """A telescope as built: each parameter nominal + N(0, scale * tolerance), in the order of the names."""
    rng = np.random.default_rng(seed)
    nominal = nominal_machine().parameters
    return Machine(
        MappingProxyType(
            {
                name: round(value + scale * tolerance(name) * float(rng.standard_normal()), DECIMALS)
                for name, value in nominal.items()
            }
        )
    )
