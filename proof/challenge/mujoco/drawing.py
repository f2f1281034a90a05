"""The drawing of an arm: rows, masses, mounts and instrument, as parameters by name and as a machine file. mm, rad.

Rows and masses are the package's. Stand, tool, instrument and tolerances are stated here: an MJCF has none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from challenge.mujoco.chain import FIELDS, fitted, transforms
from challenge.mujoco.mjcf import Build, reach
from challenge.mujoco.packages import read
from challenge.simulator.ported import Drawn
from challenge.simulator.rigid import frame, roll_pitch_yaw

Array = NDArray[np.float64]
AXES = ("x", "y", "z", "rx", "ry", "rz")
MM = 1e-3
GRAVITY = 9.80665
LENGTH, ANGLE = 0.2, float(np.radians(0.03))
STAND = (1900.0, 520.0, -280.0, 0.0, 0.0, float(np.radians(-118.0)))
TOOL = frame(np.eye(3), np.array([42.0, 17.0, 118.0]))
"""Where the tool's frame stands on the tip of the package's arm: off its last axis."""
TOLERANCES = {"base": (4.0, float(np.radians(0.8))), "tool": (0.8, float(np.radians(0.4)))}
TARGETS = {"P1": (70.0, 0.0, 0.0), "P2": (-35.0, 65.0, 15.0), "P3": (-30.0, -55.0, 40.0)}
POINTS = 0.01
GRIPPER, PAYLOAD = (1.1, (-20.0, 0.0, -55.0)), (4.0, -8.0, 40.0)
WIDEST = float(np.radians(160.0))


@dataclass(frozen=True)
class Instrument:
    """What reads the tool: ``position`` of its origin, three ``targets`` or the ``pose``; sigmas mm and rad."""

    kind: str
    sigma: float = 0.03
    turn: float = 5e-5

    @property
    def targets(self) -> Mapping[str, tuple[float, float, float]]:
        """Points in the tool's frame."""
        return TARGETS if self.kind == "targets" else {}

    @property
    def sigmas(self) -> Array:
        """(n_columns,) of one reading."""
        if self.kind == "pose":
            return np.array([self.sigma] * 3 + [self.turn] * 3)
        return np.full(3 * max(len(self.targets), 1), self.sigma)


@dataclass(frozen=True)
class Drawing:
    """An arm of a package as drawn, on its stand, with tool and instrument.

    parameters: by the tool's own names. ranges (n, 2) rad. masses: kg and centre (3,) mm in the frame of the body.
    gravity (3,) m/s^2 in frame 0. gears (n,): ratios.
    """

    parameters: Mapping[str, Drawn]
    ranges: Array
    masses: Mapping[str, tuple[float, Array]]
    gravity: Array
    gears: tuple[int, ...]
    instrument: Instrument

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the readings."""
        return tuple(f"q{k + 1}" for k in range(len(self.ranges)))

    def rows(self, values: Mapping[str, float]) -> Array:
        """(n, 5) m and rad from parameters by name (nominal where missing)."""
        table = [[self.value(values, f"{j}.{f}") for f in FIELDS] for j in self.joints]
        return np.asarray(np.array(table) * np.array([1.0, 1.0, MM, 1.0, MM]), dtype=np.float64)

    def mount(self, values: Mapping[str, float], name: str) -> Array:
        """(4, 4) mm of ``base`` or ``tool``."""
        x, y, z, *turns = (self.value(values, f"{name}.{a}") for a in AXES)
        placed: Array = frame(roll_pitch_yaw(*turns), np.array([x, y, z]))
        return placed

    def value(self, values: Mapping[str, float], name: str) -> float:
        """One parameter."""
        return values.get(name, self.parameters[name].nominal)

    def build(self, values: Mapping[str, float]) -> Build:
        """The arm with these constants, m."""
        tool = self.mount(values, "tool")
        tool[:3, 3] *= MM
        masses = {body: (kg, centre * MM) for body, (kg, centre) in self.masses.items()}
        return Build(self.rows(values), tool, masses, self.gravity)

    def strengths(self) -> tuple[Array, float]:
        """(n,) N m that gravity exerts on a joint of an outstretched arm, about; and on the tool's mount."""
        rows = self.rows({})
        lengths = [float(np.linalg.norm(reach(rows, k))) for k in range(len(rows) - 1)]
        tool = float(np.linalg.norm(self.mount({}, "tool")[:3, 3])) * MM
        held = self.masses["tool"][0] + 1.0
        beyond = np.cumsum([held, *(self.masses[f"link{k + 1}"][0] for k in reversed(range(len(rows))))])[1:][
            ::-1
        ]
        far = np.cumsum([tool, *reversed(lengths)])[::-1]
        return np.asarray(GRAVITY * 0.35 * beyond * far), GRAVITY * held * tool


def drawn(arm: str, instrument: Instrument, gears: tuple[int, ...]) -> Drawing:
    """The drawing of a package's arm. Raises InputError where it is not installed."""
    package = read(arm)
    chain = fitted(package)
    parameters: dict[str, Drawn] = {}
    for k, row in enumerate(chain.rows, start=1):
        for name, value in zip(FIELDS, row, strict=True):
            length = name in "dr"
            parameters[f"q{k}.{name}"] = Drawn(
                float(value) / MM if length else float(value), LENGTH if length else ANGLE
            )
    tip = chain.flange_tip.copy()
    tip[:3, 3] /= MM
    tool = tip @ TOOL
    yaw, pitch, roll = Rotation.from_matrix(tool[:3, :3]).as_euler("ZYX")
    for mount, values in (("base", STAND), ("tool", (*tool[:3, 3], roll, pitch, yaw))):
        for k, (axis, value) in enumerate(zip(AXES, values, strict=True)):
            parameters[f"{mount}.{axis}"] = Drawn(float(value), TOLERANCES[mount][k // 3])
    for target, point in instrument.targets.items():
        parameters |= {f"{target}.{a}": Drawn(v, POINTS) for a, v in zip("xyz", point, strict=True)}
    into = np.linalg.inv(chain.frames) @ np.linalg.inv(chain.base)
    centres = np.einsum("nij,nj->ni", into, np.append(package.centres[1:], np.ones((len(into), 1)), axis=1))
    masses = {
        f"link{k + 1}": (float(m), c[:3] / MM)
        for k, (m, c) in enumerate(zip(package.masses[1:], centres, strict=True))
    }
    masses |= {"tool": (GRIPPER[0], np.array(GRIPPER[1])), "payload": (0.0, np.array(PAYLOAD))}
    return Drawing(parameters, _ranges(package.ranges), masses, GRAVITY * chain.down, gears, instrument)


def _ranges(stated: Array) -> Array:
    """What a program would use: whole turns and more are cut."""
    limited = np.isfinite(stated).all(axis=1)
    low, high = (np.where(limited, stated[:, k], end) for k, end in enumerate((-WIDEST, WIDEST)))
    middle, half = (low + high) / 2, np.minimum((high - low) / 2, WIDEST)
    ends: Array = np.radians(np.degrees(np.column_stack([middle - half, middle + half])).round(1))
    return ends


def heights(drawing: Drawing, q: Array) -> tuple[float, float]:
    """Lowest of the links' origins above the stand, and the tool's distance from the first axis, mm."""
    poses = np.eye(4)[None]
    for step in transforms(drawing.rows({}), q):
        poses = np.concatenate([poses, (poses[-1] @ step)[None]])
    end = poses[-1] @ drawing.build({}).tool
    points = np.vstack([poses[2:, :3, 3], end[:3, 3]]) / MM
    up = -drawing.gravity / GRAVITY
    return float((points @ up).min()), float(np.linalg.norm(points[-1] - up * (points[-1] @ up)))


def document(drawing: Drawing, name: str, sigma_factor: float, tolerance_factor: float) -> dict[str, Any]:
    """The machine file as data, mm and deg; factors misstate sigma and all tolerances."""
    nominal = {key: d.nominal for key, d in drawing.parameters.items()}
    instrument = drawing.instrument
    sigma = {"xyz": instrument.sigma * sigma_factor}
    if instrument.kind == "pose":
        sigma["rot"] = float(np.degrees(instrument.turn)) * sigma_factor
    sensor: dict[str, Any] = {"type": instrument.kind, "sigma": sigma}
    if instrument.targets:
        sensor |= {"points": {k: list(v) for k, v in instrument.targets.items()}}
        sensor["tolerance"] = {"points": POINTS * tolerance_factor}
    joints = []
    for k, joint in enumerate(drawing.joints):
        row = {f: _file(nominal[f"{joint}.{f}"], f not in "dr") for f in FIELDS}
        limits = np.degrees(drawing.ranges[k]).round(6).tolist()
        joints.append(
            {"name": joint, "kind": "revolute", **row, "range": limits, "gear_ratio": drawing.gears[k]}
        )
    masses = {}
    for body, (kg, centre) in drawing.masses.items():
        inside = "tool" if body in ("tool", "payload") else body
        masses["gripper" if body == "tool" else body] = {"kg": kg, "com": centre.tolist(), "in": inside}
    angle = float(np.degrees(ANGLE)) * tolerance_factor
    return {
        "schema": "truepose/machine/1",
        "name": name.replace("-", "_"),
        "units": {"length": "mm", "angle": "deg"},
        "gravity": drawing.gravity.tolist(),
        "mechanism": {"type": "serial", "joints": joints},
        "frames": {m: _frame(drawing, nominal, m, tolerance_factor) for m in TOLERANCES},
        "sensor": sensor,
        "tolerances": {"length": LENGTH * tolerance_factor, "angle": angle},
        "masses": masses,
    }


def _frame(drawing: Drawing, nominal: Mapping[str, float], mount: str, factor: float) -> dict[str, Any]:
    length, angle = TOLERANCES[mount]
    values = [_file(nominal[f"{mount}.{a}"], "r" in a) for a in AXES]
    tolerance = {"xyz": length * factor, "rpy": float(np.degrees(angle)) * factor}
    inside = "world" if mount == "base" else "flange"
    return {"in": inside, "xyz": values[:3], "rpy": values[3:], "tolerance": tolerance}


def _file(value: float, is_angle: bool) -> float:
    return float(np.degrees(value)) if is_angle else float(value)


__all__ = ["Drawing", "Instrument", "document", "drawn", "heights"]
