"""A telescope's mount as a machine of two axes: stars are points at a metre, and what it reads is where they really were.

The file (TPOINT's text format) gives for each star its right ascension and declination (h m s, deg m s), the same as the
encoders say, and the local sidereal time. In the frame of the equator, x where the meridian cuts it and z at the pole, a star
at hour angle H and declination d stands at (cos d cos H, -cos d sin H, sin d). Refraction is left in.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from real_recordings.common import HELD_OUT, Array, say
from real_recordings.cuts import errors
from truepose.identification.diagnosis.engine import diagnose
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.recording.load import load_recording
from truepose.identification.report.level_words import driver_clauses
from truepose.models.load import load_machine

DISTANCE = 1000.0
"""mm"""
LATITUDE = np.radians(39.0 + 25.0 / 3600.0)
MACHINE = f"""
schema: truepose/machine/1
name: mount
units: {{length: mm, angle: deg}}
gravity: [{-9.80665 * np.cos(LATITUDE):.6f}, 0, {-9.80665 * np.sin(LATITUDE):.6f}]
mechanism:
  type: serial
  joints:
    - {{name: q1, kind: revolute}}
    - {{name: q2, kind: revolute, alpha: 90}}
frames:
  base: {{xyz: [0, 0, 0], tolerance: {{xyz: 0, rpy: 2}}}}
  tool: {{in: flange, xyz: [{DISTANCE:g}, 0, 0], tolerance: {{xyz: 20, rpy: 0}}}}
sensor: {{type: position, sigma: {{xyz: 0.05}}}}
tolerances: {{length: 0.0001, angle: 0.5}}
"""


def mount(data: Path, work: Path) -> None:
    """Plain calibration and what is applied, on every third, sixth and ninth of ten stars."""
    work.mkdir(parents=True, exist_ok=True)
    (work / "mount.yaml").write_text(MACHINE)
    stars(data / "telescope-mount" / "gem-28.dat").to_csv(work / "stars.csv", index=False)
    machine = load_machine(work / "mount.yaml")
    whole = load_recording(machine, [work / "stars.csv"])
    held = np.isin(np.arange(len(whole)) % 10, HELD_OUT)
    fitted, rest = whole.subset(~held), whole.subset(held)
    plain, found = calibrate(machine, fitted), diagnose(machine, fitted)
    both = [errors(fit, fitted, rest) for fit in (plain.fit, found.after)]
    for what, a, b in zip(("readings", "tool"), *both, strict=True):
        turned = [float(np.degrees(value / DISTANCE)) * 3600.0 for value in (a, b)]
        say(f"{what}: {turned[0]:.0f} -> {turned[1]:.0f} arcsec of {int(held.sum())} stars held out")
    say(
        f"{found.verdict}; "
        + "; ".join(f"{f.effect} {'+'.join(f.place)} {f.probability:.2f}" for f in found.findings)
    )
    say("; ".join(driver_clauses(found.findings)) or "nothing below its law")


def stars(path: Path) -> pd.DataFrame:
    """Encoders (deg) and directions (mm) of every star."""
    fields = [line.split() for line in path.read_text().splitlines() if line[:1] not in "!:"]
    rows = [line for line in fields if len(line) >= 14]
    ra, dec, ra_read, dec_read = (
        _angle(rows, first, hours) for first, hours in ((0, True), (3, False), (6, True), (9, False))
    )
    sidereal = _angle([[*line[12:14], "0"] for line in rows], 0, hours=True)
    hour = sidereal - ra
    turned = np.degrees(np.angle(np.exp(1j * (ra_read - sidereal))))
    point = DISTANCE * np.column_stack([np.cos(dec) * np.cos(hour), -np.cos(dec) * np.sin(hour), np.sin(dec)])
    columns = {"q1 [deg]": turned, "q2 [deg]": np.degrees(dec_read)}
    return pd.DataFrame(columns | dict(zip("xyz", point.T, strict=True)))


def _angle(rows: list[list[str]], first: int, hours: bool) -> Array:
    """Radians of three fields, h m s or deg m s with a sign."""
    text = [row[first : first + 3] for row in rows]
    size = np.array([[abs(float(part)) for part in parts] for parts in text]) @ [
        1.0,
        1.0 / 60.0,
        1.0 / 3600.0,
    ]
    sign = np.array([-1.0 if parts[0].startswith("-") else 1.0 for parts in text])
    return np.asarray(np.radians(sign * size * (15.0 if hours else 1.0)))
