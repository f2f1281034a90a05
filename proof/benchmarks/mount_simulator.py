"""The bundled mount: a simulated German equatorial, by the spherical trigonometry of pointing models and no chain of frames.

Run in `proof/`, `python -m benchmarks.mount_simulator OUTDIR` writes recording.csv and truth.json. It imports numpy only.
Terms and signs are P. T. Wallace's (TPOINT): what is added to the encoders' reading for where the telescope points.
"""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SEED = 20240321
LATITUDE, LOWEST, STARS, HELD_OUT = 42.5, 20.0, 140, 28
"""Degrees of the place and of the lowest star; stars, and how many of them are kept for validation."""
SIGMA = 3.0
"""arcsec across the line of sight: seeing, and the centroid of a plate."""
ARCSEC = np.pi / 180.0 / 3600.0
TERMS = {
    "IH": 1340.0,
    "ID": -610.0,
    "CH": 215.0,
    "NP": -85.0,
    "MA": 190.0,
    "ME": -340.0,
    "TF": 75.0,
    "HCES": 42.0,
    "HCEC": -31.0,
}
"""arcsec. Refraction is left in the stars' places as well."""


def pointed(h: Array, d: Array, weather: tuple[Array, Array]) -> Array:
    """(n, 3) where a mount whose encoders say ``h`` and ``d`` (rad; beyond the pole: the other side of the pier) points at.

    In the frame of the equator: x on the meridian, y to the east, z at the pole. ``weather``: degC and hPa.
    """
    t = {name: value * ARCSEC for name, value in TERMS.items()}
    cos_z, east_of = _above(h, d)
    dh = t["IH"] + t["HCES"] * np.sin(h) + t["HCEC"] * np.cos(h)
    dh += t["CH"] / np.cos(d) + (t["NP"] - t["MA"] * np.cos(h) + t["ME"] * np.sin(h)) * np.tan(d)
    dd = t["ID"] + t["MA"] * np.sin(h) + t["ME"] * np.cos(h)
    lower = t["TF"] + _refraction(cos_z, *weather)
    dh, dd = dh + lower * east_of[0], dd + lower * east_of[1]
    h, d = h + dh, d + dd
    return np.column_stack([np.cos(d) * np.cos(h), -np.cos(d) * np.sin(h), np.sin(d)])


def _above(h: Array, d: Array) -> tuple[Array, tuple[Array, Array]]:
    """Cosine of the zenith distance; changes of hour angle and declination for one of it, times its sine."""
    c, s = np.cos(np.radians(LATITUDE)), np.sin(np.radians(LATITUDE))
    cos_z = s * np.sin(d) + c * np.cos(d) * np.cos(h)
    return cos_z, (c * np.sin(h) / np.cos(d), c * np.cos(h) * np.sin(d) - s * np.cos(d))


def _refraction(cos_z: Array, celsius: Array, hectopascal: Array) -> Array:
    """Refraction over the sine of the zenith distance, rad: 60.3 arcsec tan z - 0.067 arcsec tan^3 z at 10 degC, 1010 hPa."""
    sin_z = np.sqrt(1.0 - cos_z**2)
    tan = sin_z / cos_z
    arc = (60.3 * tan - 0.067 * tan**3) * (hectopascal / 1010.0) * 283.0 / (273.15 + celsius)
    return np.asarray(arc * ARCSEC / sin_z)


def _stars(rng: np.random.Generator) -> tuple[Array, Array]:
    """Encoders (rad) at stars that are spread over the sky, west of the meridian from beyond the pole."""
    out: list[tuple[float, float]] = []
    while len(out) < STARS:
        x = rng.standard_normal(3)
        x /= np.linalg.norm(x)
        h, d = float(np.arctan2(-x[1], x[0])), float(np.arcsin(x[2]))
        up = _above(np.array(h), np.array(d))[0]
        if up > np.sin(np.radians(LOWEST)) and abs(d) < np.radians(80.0):
            out.append((h + np.pi, np.pi - d) if h < 0 else (h, d))
    out.sort()
    h, d = np.array(out).T
    return h, d


def write(folder: Path) -> None:
    """Both files."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(SEED)
    h, d = _stars(rng)
    time = 60.0 * np.arange(1, STARS + 1)
    warm = 9.0 - 3.0 * time / time[-1]
    pressure = np.full(STARS, 985.0)
    seen = pointed(h, d, (warm, pressure)) + SIGMA * ARCSEC * rng.standard_normal((STARS, 3))
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    role = np.full(STARS, "calibration", dtype=object)
    role[rng.choice(STARS, HELD_OUT, replace=False)] = "validation"
    columns = {
        "role": role,
        "ha": [f"{v:.5f}" for v in np.degrees(h)],
        "dec": [f"{v:.5f}" for v in np.degrees(d)],
        "star.ha": [f"{v:.5f}" for v in np.degrees(np.arctan2(-seen[:, 1], seen[:, 0]))],
        "star.dec": [f"{v:.5f}" for v in np.degrees(np.arcsin(seen[:, 2]))],
        "temperature.air": [f"{v:.1f}" for v in warm],
        "pressure": [f"{v:.0f}" for v in pressure],
    }
    with (folder / "recording.csv").open("w", newline="", encoding="utf-8") as file:
        file.write("# Simulated German equatorial mount\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    (folder / "truth.json").write_text(json.dumps(_truth(), indent=2) + "\n", encoding="utf-8")


def _truth() -> dict[str, object]:
    def rad(value: float) -> dict[str, object]:
        return {"value": value * ARCSEC, "unit": "rad"}

    # the machine file's tube is 10 kg half a metre out
    sag = {"value": TERMS["TF"] * ARCSEC / (10.0 * 9.80665 * 0.5), "unit": "rad/(N*m)"}
    disc = {"a": rad(TERMS["HCES"]), "b": rad(TERMS["HCEC"])}
    ours = {"ha.offset": "IH", "dec.offset": "ID", "dec.tilt": "NP"}
    turned = {"tool.rz": "CH", "base.rx": "MA", "base.ry": "ME"}
    values = {name: TERMS[term] for name, term in ours.items()}
    values |= {name: -TERMS[term] for name, term in turned.items()}
    return {
        "schema": "mount-simulator/truth/1",
        "seed": SEED,
        "noise": {"sigma": SIGMA * ARCSEC, "unit": "rad"},
        "effects": [
            {"effect": "gravity-sag", "place": ["tool"], "parameters": {"c": sag}},
            {
                "effect": "air-refraction",
                "place": ["sensor"],
                "parameters": {"share": {"value": 1.0, "unit": "1"}},
            },
            {"effect": "encoder-eccentricity", "place": ["ha"], "parameters": disc},
        ],
        "parameters": {name: {**rad(value), "nominal": 0.0} for name, value in values.items()},
    }


if __name__ == "__main__":
    write(Path(sys.argv[1]))
