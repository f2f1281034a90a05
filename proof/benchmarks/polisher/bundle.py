"""The demo's recording and truth: one true robot, one warm-up, one noise, the same bytes each time."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from . import workspace as ws
from .motions import Array, adjoint, exp, inverse, shift
from .physics import Head, Screw
from .robot import LIMBS, MIDDLE, Robot

SEED = 20190215
LENGTH, ANGLE, BALL = 0.05, np.radians(0.02), 0.005
"""1-sigma of centres (mm) and axes (rad) as built, and of the three axes inside a spherical joint (mm)."""
OFFSETS = np.array([ws.ENCODER_MM] * 3 + [np.radians(ws.ENCODER_DEG)] * 3)
SCREWS = (Screw(warming=3.0), Screw(warming=9.0), Screw(warming=4.0))
SECONDS = 45.0
TILT = np.radians(14.0)
HEAVY = 9.0
"""Payload of the second polishing tool, kg."""


def true_robot(rng: np.random.Generator) -> Robot:
    """A robot drawn from the tolerances."""
    errors = {}
    for limb in (*LIMBS, MIDDLE):
        for link in range(7):
            length = BALL if limb != MIDDLE and link in (4, 5) else LENGTH
            angle = ANGLE * length / LENGTH
            errors[link, limb] = rng.normal(size=6) * np.array([length] * 3 + [angle] * 3)
    return Robot(errors, OFFSETS * rng.normal(size=6))


@dataclass(frozen=True)
class Plan:
    """Commanded joints (n, 6), payload (n,) kg, role (n,) and time (n,) s of every row."""

    q: Array
    payload: Array
    role: tuple[str, ...]
    time: Array


def plan(rng: np.random.Generator) -> Plan:
    """Layers by pure translation, tilted poses with two tools between them; the middle layer is for validation."""
    parts = [
        (*_layer("lower"), 0.0, "calibration"),
        (*_tilted(24, rng), 0.0, "calibration"),
        (*_layer("upper"), 0.0, "calibration"),
        (*_tilted(24, rng), HEAVY, "calibration"),
        (*_layer("middle"), 0.0, "validation"),
        (*_tilted(12, rng), HEAVY, "validation"),
    ]
    q = np.concatenate([np.round(ws.joints(ws.tool_poses(at, turns)), 8) for at, turns, _, _ in parts])
    payload = np.concatenate([np.full(len(at), kg) for at, _, kg, _ in parts])
    role = tuple(role for at, _, _, role in parts for _ in at)
    return Plan(q, payload, role, SECONDS * np.arange(1.0, len(q) + 1))


def _layer(name: str) -> tuple[Array, Array]:
    at = ws.nodes(5, name)
    return at, np.broadcast_to(np.eye(3), (len(at), 3, 3))


def _tilted(count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Positions (n, 3) all over the workspace and turns (n, 3, 3) about its x and y axes."""
    at = rng.uniform(-0.5, 0.5, (count, 3)) * [0.7 * ws.WIDTH, 0.7 * ws.WIDTH, ws.HEIGHT]
    twist = np.zeros((count, 6))
    twist[:, 3:5] = TILT * rng.uniform(-1, 1, (count, 2))
    return at + np.array([0.0, 0.0, ws.HEIGHT / 2]), exp(twist)[:, :3, :3]


@dataclass(frozen=True)
class Simulation:
    """Noise-free tool poses (n, 4, 4), readings (n, 9) mm, thermometers (n, 3) degC, and what moved the joints (n, 6)."""

    poses: Array
    observations: Array
    temperature: Array
    added: Array


def simulate(robot: Robot, rows: Plan, rng: np.random.Generator) -> Simulation:
    """The recording of a robot that warms up and whose wrist gear winds up."""
    rigid = robot.tool_poses(rows.q)
    added, temperature = np.zeros((len(rows.q), 6)), np.zeros((len(rows.q), 3))
    for k, screw in enumerate(SCREWS):
        added[:, k], temperature[:, k] = screw.growth(rows.time, rows.q[:, k])
    added[:, 4] = Head().torsion_q5(rigid, rows.payload, rows.q[:, 5])
    poses = robot.tool_poses(rows.q, added)
    return Simulation(poses, targets(poses) + ws.SIGMA * rng.normal(size=(len(poses), 9)), temperature, added)


def targets(poses: Array) -> Array:
    """(n, 9) the three targets in the workpiece frame, mm."""
    points = np.array(list(ws.POINTS.values()))
    out: Array = np.einsum("nij,kj->nki", poses[:, :3, :3], points) + poses[:, None, :3, 3]
    return out.reshape(len(poses), 9)


def recording_text(rows: Plan, simulation: Simulation) -> str:
    """CSV with joints in mm and deg."""
    targets_ = [f"{name}.{axis}" for name in ws.POINTS for axis in "xyz"]
    heat = [f"temperature.leg{k}" for k in LIMBS]
    head = ["pose", "time", "role", "payload", *heat, *(f"q{k}" for k in range(1, 7)), *targets_]
    lines = ["# Simulated polishing robot, warming up", ",".join(head)]
    joints = np.column_stack([rows.q[:, :3], np.degrees(rows.q[:, 3:])])
    for k, role in enumerate(rows.role):
        row = [str(k + 1), f"{rows.time[k]:g}", role, f"{rows.payload[k]:g}"]
        row += [f"{t:.2f}" for t in simulation.temperature[k]]
        row += [f"{v + 0.0:.10g}" for v in joints[k]]
        lines.append(",".join(row + [f"{v:.6f}" for v in simulation.observations[k]]))
    return "\n".join(lines) + "\n"


def demo() -> tuple[Robot, Plan, Simulation]:
    """The robot, the plan and the recording of the demo."""
    rng = np.random.default_rng(SEED)
    robot = true_robot(rng)
    rows = plan(rng)
    return robot, rows, simulate(robot, rows, rng)


def truth(robot: Robot, rows: Plan, simulation: Simulation) -> dict[str, Any]:
    """What the recording hides: errors of links by the paper's numbers, encoders, effects, and what they moved."""
    alpha = SCREWS[0].expansion
    units = ["mm"] * 3 + ["rad"] * 3
    return {
        "schema": "polisher-simulator/truth/1",
        "seed": SEED,
        "noise": {"sigma": ws.SIGMA, "unit": "mm"},
        "effects": [
            {
                "effect": "thermal-expansion",
                "place": [f"leg{k}" for k in LIMBS],
                "parameters": {"alpha": {"value": alpha, "unit": "1/K"}},
            },
            {
                "effect": "joint-compliance",
                "place": ["q5"],
                "parameters": {"c": {"value": 1.0 / Head().stiffness, "unit": "rad/(N*m)"}},
            },
        ],
        "parameters": {
            name: {"value": _rounded(nominal + error, 9), "nominal": nominal, "unit": unit}
            for name, nominal, error, unit in parameters(robot)
        },
        "link_errors": {
            "convention": "twist [v; w] of link j in limb i, in the frame of joint j + 1 (limb 4: middle limb, then wrist)",
            "units": units,
            "value": {f"{j},{i}": _rounded(twist, 9) for (j, i), twist in robot.errors.items()},
        },
        "added": {
            "columns": [f"q{k}" for k in range(1, 7)],
            "units": units,
            "value": _rounded(simulation.added, 9),
        },
        "roles": list(rows.role),
        "world_T_tool": {
            "unit": "mm",
            "axes": ["pose", "row", "column"],
            "value": _rounded(simulation.poses[:, :3], 9),
        },
    }


def parameters(robot: Robot) -> Iterator[tuple[str, float, float, str]]:
    """Name in the machine file's graph, nominal value, error, unit: to first order, joints inside the balls left out.

    The graph's platform is what the middle limb's slide carries: what the paper has between both (link 3) stands in
    the frames that are mounted on it.
    """
    azimuth = [(k - 1) * 2 * np.pi / 3 for k in LIMBS]
    lower, upper = (radius * ws.azimuths() for radius in (ws.BASE_RADIUS, ws.PLATFORM_RADIUS))
    plate = robot.errors[3, MIDDLE]
    frames = {f"up{j + 1}": (np.zeros(3), 0.0, robot.errors[j, MIDDLE]) for j in range(3)}
    for k in LIMBS:
        mount = shift(upper[k - 1], azimuth[k - 1])
        carried = adjoint(inverse(mount)[None])[0] @ plate
        names = (f"u{k}a", f"u{k}b", f"q{k}", f"s{k}")
        frames |= {name: (np.zeros(3), 0.0, robot.errors[j, k]) for j, name in enumerate(names)}
        frames[f"u{k}a"] = (lower[k - 1], azimuth[k - 1], robot.errors[0, k])
        frames[f"mount{k}"] = (
            upper[k - 1],
            0.0,
            adjoint(shift(np.zeros(3), azimuth[k - 1])[None])[0] @ (carried - robot.errors[6, k]),
        )
    offset, tool = np.array([0, 0, ws.PLATFORM_OFFSET]), np.array([0, 0, ws.WRIST_OFFSET + ws.HEAD])
    frames["q4"] = (offset, 0.0, adjoint(inverse(shift(offset))[None])[0] @ plate)
    frames |= {name: (np.zeros(3), 0.0, robot.errors[j, MIDDLE]) for name, j in (("q5", 4), ("q6", 5))}
    frames["tool"] = (tool, 0.0, robot.errors[6, MIDDLE])
    for name, (origin, yaw, twist) in frames.items():
        turned = adjoint(shift(np.zeros(3), yaw)[None])[0] @ twist
        values = [
            *zip("xyz", origin, turned[:3], strict=True),
            *zip(("rx", "ry", "rz"), (0.0, 0.0, yaw), twist[3:], strict=True),
        ]
        for axis, nominal, error in values:
            yield f"{name}.{axis}", float(nominal), float(error), "rad" if axis.startswith("r") else "mm"
    for k in range(6):
        yield f"q{k + 1}.offset", 0.0, float(robot.offsets[k]), "mm" if k < 3 else "rad"


def _rounded(values: Array | float, decimals: int) -> Any:
    return (np.round(values, decimals) + 0.0).tolist()


def write(directory: Path) -> list[Path]:
    """Recording and truth beside the machine file."""
    robot, rows, simulation = demo()
    texts = {
        "recording.csv": recording_text(rows, simulation),
        "truth.json": _json(truth(robot, rows, simulation)),
    }
    for name, text in texts.items():
        (directory / name).write_text(text, encoding="utf-8", newline="\n")
    return [directory / name for name in texts]


def _json(document: dict[str, Any]) -> str:
    """One line for each entry, so that differences are readable."""
    entries = [f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in document.items()]
    return "{\n" + ",\n".join(entries) + "\n}\n"
