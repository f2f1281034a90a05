"""The bundled demo: machine.yaml, recording.csv and truth.json of the telescope, the same bytes each time."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from challenge.simulator.telescope_ring.machine import (
    FLEXURE_LENGTH,
    TRAVEL,
    Machine,
    draw_machine,
    nominal_machine,
)
from challenge.simulator.telescope_ring.ring import Ring
from challenge.simulator.telescope_ring.rotations import Array
from challenge.simulator.telescope_ring.simulation import Sensor, Simulation, TargetsSensor, simulate
from challenge.simulator.telescope_ring.statics import Flexure, rigid_poses

SEED = 20121009  # of the true machine; the sensor's noise takes the next one
SECONDS_PER_POSE = 180
FRAME_LINES = """frames:
  base:
    in: world
    xyz: [0, 0, 0]
    rpy: [0, 0, 0]
    tolerance: {xyz: 5, rpy: 1}
  tool:
    in: flange
    xyz: [0, 0, %g]
    rpy: [0, 0, 0]
    tolerance: {xyz: 1, rpy: 0.5}
"""


def paper_poses() -> tuple[tuple[str, ...], Array]:
    """Roles (46) and travels (46, 6) in mm of Tables 3 and 4 of RR-8096."""
    with (Path(__file__).parent / "poses.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    travel = np.array([[float(row[f"rho{i}"]) for i in range(1, 7)] for row in rows])
    return tuple(row["role"] for row in rows), TRAVEL * travel


def demo() -> tuple[Machine, tuple[str, ...], Simulation]:
    """The true machine, the rows' roles and the simulated recording of the demo."""
    machine = draw_machine(SEED)
    roles, rho = paper_poses()
    return machine, roles, simulate(machine, rho, seed=SEED + 1)


def fit_coefficients(rho: Array, db_z: Array) -> tuple[Array, Array]:
    """K (6, 6) of eq. 2, db_z = K rho, by least squares for each leg, and its residuals (n, 6), mm."""
    K = np.linalg.lstsq(rho, db_z, rcond=None)[0].T
    return np.asarray(K), np.asarray(db_z - rho @ K.T)


def _numbers(values: Sequence[float] | Array) -> str:
    return "[" + ", ".join(f"{float(v):.10g}" for v in values) + "]"


def machine_text(sensor: Sensor | None = None) -> str:
    """The machine file of the telescope as drawn, with the targets unless another sensor is given."""
    nominal = nominal_machine()
    home = rigid_poses(nominal, np.zeros((1, 6))).position[0, 2]
    lines = [
        "# yaml-language-server: $schema=https://truepose.dev/schema/machine-1.json",
        "schema: truepose/machine/1",
        "name: telescope",
        "units: {length: mm, angle: deg}",
    ]
    lines += ["mechanism:", "  type: 6-pus", "  legs:"]
    for i in range(1, 7):
        a, b = (nominal.vector(f"leg{i}", (f"{p}.x", f"{p}.y", f"{p}.z")) for p in "ab")
        lines += [
            f"  - name: leg{i}",
            f"    joint: rho{i}",
            f"    a: {_numbers(a)}",
            "    u: [0, 0, 1]",
            f"    b: {_numbers(b)}",
            f"    length: {nominal.parameters[f'leg{i}.length']:g}",
            f"    range: [{-TRAVEL}, {TRAVEL}]",
            "    screw_pitch: 1.0",
        ]
    lines += [f"  flexure: {{length: {FLEXURE_LENGTH:g}}}", f"  home: [0, 0, {home:.4f}, 0, 0, 0]"]
    text = "\n".join(lines) + "\n" + FRAME_LINES % nominal.parameters["tool.z"]
    return text + (sensor or TargetsSensor()).machine_lines() + "tolerances: {length: 0.1, angle: 0.1}\n"


def recording_text(simulation: Simulation, roles: Sequence[str] | None = None, comment: str = "") -> str:
    """Recording: pose, time (s), role when given, rho1..rho6 (mm) and the sensor's columns, 7 decimals."""
    joints = [f"rho{i}" for i in range(1, 7)]
    head = ["pose", "time", *(["role"] if roles else []), *joints, *simulation.columns]
    lines = [f"# {comment}"] if comment else []
    lines.append(",".join(head))
    for n, (rho, reading) in enumerate(zip(simulation.rho, simulation.observations, strict=True)):
        row = [str(n + 1), str(SECONDS_PER_POSE * n), *([roles[n]] if roles else [])]
        row += [f"{v + 0.0:.7g}" for v in rho]
        lines.append(",".join(row + [f"{v:.7f}" for v in reading]))
    return "\n".join(lines) + "\n"


def _rounded(values: Array, decimals: int) -> Any:
    return (np.round(values, decimals) + 0.0).tolist()


def truth(machine: Machine, roles: Sequence[str], simulation: Simulation) -> dict[str, Any]:
    """What the recording hides: parameters, leg-end displacements, and K of eq. 2 fitted to them."""
    displacement = simulation.poses.leg_end_displacement
    fitted = np.array([role == "calibration" for role in roles])
    K, residual = fit_coefficients(simulation.rho[fitted], displacement[fitted, :, 2])
    held = displacement[~fitted, :, 2] - simulation.rho[~fitted] @ K.T
    flexure, ring = Flexure(), Ring()
    nominal = nominal_machine().parameters
    return {
        "schema": "telescope-simulator/truth/1",
        "seed": {"machine": SEED, "noise": SEED + 1},
        "effect": {"effect": "platform-deformation", "place": ["platform"]},
        "noise": {"sigma": TargetsSensor().sigma_xyz, "unit": "mm"},
        "flexure": {"length": flexure.length, "diameter": flexure.diameter, "unit": "mm"},
        "ring": {
            "radius": ring.radius,
            "hub_radius": ring.hub_radius,
            "ribbed": list(ring.ribbed),
            "open_strip": list(ring.open_strip),
            "pair_spoke": list(ring.pair_spoke),
            "flank_spoke": list(ring.flank_spoke),
            "unit": "mm",
        },
        "K": {"unit": "1", "convention": "db_z = K rho, platform frame, to the hub", "value": _rounded(K, 7)},
        "K_residual": {
            "unit": "um",
            "calibration_max": round(1e3 * float(np.max(np.abs(residual))), 4),
            "calibration_mean": round(1e3 * float(np.mean(np.abs(residual))), 4),
            "validation_max": round(1e3 * float(np.max(np.abs(held))), 4),
        },
        "leg_end_displacement_max": {
            "unit": "um",
            "norm": round(1e3 * float(np.max(np.linalg.norm(displacement, axis=-1))), 4),
            "xyz": _rounded(1e3 * np.max(np.abs(displacement), axis=(0, 1)), 4),
            "rms_z": round(1e3 * float(np.sqrt(np.mean(displacement[..., 2] ** 2))), 4),
        },
        "parameters": {
            name: {"value": value, "nominal": nominal[name], "unit": _unit(name)}
            for name, value in machine.parameters.items()
        },
        "leg_end_displacement": {
            "unit": "mm",
            "axes": ["pose", "leg", "xyz"],
            "value": _rounded(displacement, 8),
        },
        "world_T_tool": {
            "unit": "mm",
            "axes": ["pose", "row", "column"],
            "value": _poses(simulation.pose_world_tool),
        },
    }


def _poses(T: Array) -> Any:
    """First three rows of the transforms, 10 decimals."""
    return _rounded(T[:, :3], 10)


def _unit(name: str) -> str:
    if ".u." in name:
        return "1"
    return "rad" if name.rsplit(".", 1)[-1] in {"rx", "ry", "rz"} else "mm"


def _json(value: Any, depth: int = 0) -> str:
    """JSON with one line for each entry and each pose, so that differences are readable."""
    pad = "  " * (depth + 1)
    if isinstance(value, dict) and depth < 2 and len(json.dumps(value)) > 110:
        inner = [f"{pad}{json.dumps(key)}: {_json(item, depth + 1)}" for key, item in value.items()]
        return "{\n" + ",\n".join(inner) + "\n" + "  " * depth + "}"
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n" + ",\n".join(pad + json.dumps(item) for item in value) + "\n" + "  " * depth + "]"
    return json.dumps(value)


def files() -> dict[str, str]:
    """Name and content of the bundled files."""
    machine, roles, simulation = demo()
    comment = "Simulated telescope at the poses of Tables 3 and 4 of RR-8096"
    return {
        "machine.yaml": machine_text(),
        "recording.csv": recording_text(simulation, roles, comment),
        "truth.json": _json(truth(machine, roles, simulation)) + "\n",
    }


def write(folder: Path) -> list[Path]:
    """Write the bundled files into `folder`, made if it is missing; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, text in files().items():
        paths.append(folder / name)
        paths[-1].write_text(text, encoding="utf-8", newline="\n")
    return paths
