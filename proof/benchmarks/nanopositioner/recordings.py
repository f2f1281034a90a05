"""The bundled recordings: one calibration, five days of drift, and the truth. The same bytes each time.

The interferometer is read many times along each continuous motion; a reading is the cavity's change since the
motion's start, with independent Gaussian noise. Where it starts a row refers to itself and reads 0.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .geometry import Constants, lengths
from .plan import Motions, paper_plan
from .tables import DAY_0, DRAWING, JOINTS, PRISMATIC, SEQUENCE, Tabled, parameter_values

Array = NDArray[np.float64]
WAVELENGTH = 1.56
"""um."""
SIGMA = 0.010
"""um; the repeatability that the paper's introduction gives such stages, "typically better than 10 nm". Every reading
contains it; the interferometer is finer."""
ROUNDED = round(WAVELENGTH / 4 / 8 / np.sqrt(12), 4)
"""um; standard deviation of readings rounded to the paper's 1/8 of half an oscillation, "approximately 50 nm"."""
SEED = 20201013
MAIN_POINTS, DRIFT_POINTS = 100, 20
"""Readings a motion."""
MOTION_SECONDS, PAUSE_SECONDS = 10.0, 20.0
DAY_SECONDS = 86_400


def readings(motions: Motions, points: int, constants: Constants, sigma: float, seed: int) -> Array:
    """(n, points + 1) change of the cavity since the start of each motion, um; the first of each is 0."""
    q = motions.sampled(points)
    length = lengths(constants, q.reshape(-1, 6)).reshape(q.shape[:2]) * 1e3
    noise = sigma * np.random.default_rng(seed).standard_normal(length.shape)
    noise[:, 0] = 0.0
    return np.asarray(length - length[:, :1] + noise)


def recording_text(
    motions: Motions,
    points: int,
    table: Tabled = DAY_0,
    *,
    sigma: float = SIGMA,
    seed: int = SEED,
    comment: str = "",
) -> str:
    """CSV of the motions read ``points`` times each: pose, from, time, joints and dL, units in the header."""
    q = motions.sampled(points)
    dl = readings(motions, points, Constants.tabled(table), sigma, seed)
    units = ["um" if prismatic else "deg" for prismatic in PRISMATIC]
    factor = np.where(PRISMATIC, 1e3, 180 / np.pi)
    head = [f"{joint} [{unit}]" for joint, unit in zip(JOINTS, units, strict=True)]
    lines = [f"# {comment}"] if comment else []
    lines.append(",".join(["pose", "from", "time", *head, "dL [um]"]))
    for k in range(len(q)):
        first = k * (points + 1)
        began = table.day * DAY_SECONDS + k * (MOTION_SECONDS + PAUSE_SECONDS)
        for j in range(points + 1):
            time = began + MOTION_SECONDS * j / points
            joints = [f"{v + 0.0:.9g}" for v in np.round(q[k, j] * factor, 9)]
            lines.append(",".join([str(first + j), str(first), f"{time:.1f}", *joints, f"{dl[k, j]:.4f}"]))
    return "\n".join(lines) + "\n"


def truth() -> dict[str, Any]:
    """What the recording hides, by the names of the machine file; mm and rad."""
    true, drawing = parameter_values(DAY_0.intrinsic, DAY_0.extrinsic), parameter_values({}, DRAWING)
    return {
        "schema": "nanopositioner-simulator/truth/1",
        "paper": "Tables II and III",
        "seed": {"noise": SEED},
        "effects": [],
        "noise": {"sigma": SIGMA * 1e-3, "unit": "mm"},
        "parameters": {
            name: {"value": round(value, 12), "nominal": round(drawing[name], 12), "unit": _unit(name)}
            for name, value in true.items()
        },
    }


def files() -> dict[str, str]:
    """Name and text of every bundled file but the machine file."""
    plan = paper_plan()
    out = {
        "recording.csv": recording_text(plan, MAIN_POINTS, comment="Simulated nanopositioner, 69 motions"),
        "truth.json": _json(truth()),
    }
    for k, table in enumerate(SEQUENCE):
        comment = f"Simulated nanopositioner, {table.day:g} days after the first calibration"
        out[f"drift_day{table.day:g}.csv"] = recording_text(
            plan, DRIFT_POINTS, table, seed=SEED + 1 + k, comment=comment
        )
    return out


def write(folder: Path) -> list[Path]:
    """Write the bundled files into ``folder``, made if it is missing; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, text in files().items():
        paths.append(folder / name)
        paths[-1].write_text(text, encoding="utf-8", newline="\n")
    return paths


def _unit(name: str) -> str:
    return "mm" if name.rsplit(".", 1)[-1] in {"d", "r", "x", "y", "z"} else "rad"


def _json(value: dict[str, Any]) -> str:
    """JSON with one line for each parameter, so that differences are readable."""
    inner = [f"    {json.dumps(name)}: {json.dumps(item)}" for name, item in value["parameters"].items()]
    head = [f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in value.items() if k != "parameters"]
    return "{\n" + ",\n".join(head) + ',\n  "parameters": {\n' + ",\n".join(inner) + "\n  }\n}\n"


__all__ = ["ROUNDED", "SIGMA", "files", "readings", "recording_text", "truth", "write"]
