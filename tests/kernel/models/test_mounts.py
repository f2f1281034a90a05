"""Telescope mounts against the terms of pointing models, each written down as spherical trigonometry has it.

A term is what is added to the encoders' reading for where the telescope points (P. T. Wallace's signs); h hour angle,
d declination, A azimuth from the north by the east, E altitude.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from support.simulated import machine_from
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.machine.machine import Machine
from truepose.models.machine.mount_terms import ARCSEC, terms_of

Array = NDArray[np.float64]
PHI = np.radians(39.0)
SMALL = 1e-6
"""rad: what is left of second order is a few millionths of a term."""
RNG = np.random.default_rng(11)
FILE = """schema: truepose/machine/1
name: mount
mechanism: {{type: mount, kind: {kind}, latitude: 39}}
frames:
  base: {{in: world, tolerance: {{rpy: [1, 1, 0]}}}}
  tool: {{in: flange, tolerance: {{rpy: [0, 0, 1]}}}}
sensor: {{type: direction, sigma: {{angle: 1 arcsec}}}}
tolerances: {{angle: 1}}
effects:
  - {{effect: gravity-sag, place: [tool], parameters: {{}}}}
  - {{effect: air-refraction, place: [sensor], temperature: 0, pressure: 0, parameters: {{}}}}
  - {{effect: encoder-eccentricity, place: [{first}], parameters: {{}}}}
  - {{effect: encoder-eccentricity, place: [{second}], parameters: {{}}}}
"""
OF_FORKS = """  - {effect: axis-flexure, place: [ha], fork: 1, parameters: {}}
  - {effect: axis-flexure, place: [ha], shaft: 1, parameters: {}}
"""
AXES = {"equatorial": ("ha", "dec"), "alt-az": ("az", "alt")}


def _down(h: Array, d: Array, amount: Array) -> tuple[Array, Array]:
    """Change of hour angle and declination of what sinks by ``amount`` times the sine of the zenith distance."""
    dh = amount * np.cos(PHI) * np.sin(h) / np.cos(d)
    return dh, amount * (np.cos(PHI) * np.cos(h) * np.sin(d) - np.sin(PHI) * np.cos(d))


def _cos_z(h: Array, d: Array) -> Array:
    return np.asarray(np.sin(PHI) * np.sin(d) + np.cos(PHI) * np.cos(d) * np.cos(h))


Law = Callable[[Array, Array], tuple[Array | float, Array | float]]
EQUATORIAL: dict[str, Law] = {
    "IH": lambda h, d: (1.0, 0.0),
    "ID": lambda h, d: (0.0, 1.0),
    "CH": lambda h, d: (1 / np.cos(d), 0.0),
    "NP": lambda h, d: (np.tan(d), 0.0),
    "MA": lambda h, d: (-np.cos(h) * np.tan(d), np.sin(h)),
    "ME": lambda h, d: (np.sin(h) * np.tan(d), np.cos(h)),
    "TF": lambda h, d: _down(h, d, np.ones_like(h)),
    "FO": lambda h, d: (0.0, np.cos(h)),
    "DAF": lambda h, d: (-(np.cos(PHI) * np.cos(h) + np.sin(PHI) * np.tan(d)), 0.0),
    "HCES": lambda h, d: (np.sin(h), 0.0),
    "HCEC": lambda h, d: (np.cos(h), 0.0),
    "DCES": lambda h, d: (0.0, np.sin(d)),
    "DCEC": lambda h, d: (0.0, np.cos(d)),
    "TX": lambda h, d: _down(h, d, 1 / _cos_z(h, d)),
}
ALT_AZ: dict[str, Law] = {
    "IA": lambda a, e: (-1.0, 0.0),
    "IE": lambda a, e: (0.0, 1.0),
    "CA": lambda a, e: (-1 / np.cos(e), 0.0),
    "NPAE": lambda a, e: (-np.tan(e), 0.0),
    "AN": lambda a, e: (-np.sin(a) * np.tan(e), -np.cos(a)),
    "AW": lambda a, e: (-np.cos(a) * np.tan(e), np.sin(a)),
    "TF": lambda a, e: (0.0, -np.cos(e)),
    "ACES": lambda a, e: (-np.sin(a), 0.0),
    "ACEC": lambda a, e: (np.cos(a), 0.0),
    "ECES": lambda a, e: (0.0, np.sin(e)),
    "ECEC": lambda a, e: (0.0, np.cos(e)),
    "TX": lambda a, e: (0.0, -1 / np.tan(e)),
}


def _machine(folder: Path, kind: str) -> Machine:
    first, second = AXES[kind]
    text = FILE.format(kind=kind, first=first, second=second)
    return machine_from(folder, text + (OF_FORKS if kind == "equatorial" else ""), "mount")


def _angles(kind: str) -> Array:
    """(n, 2) stars above 30 deg, away from the pole and the zenith, where the formulas are no first order."""
    out: list[tuple[float, float]] = []
    while len(out) < 60:
        a, e = RNG.uniform(-np.pi, np.pi), RNG.uniform(-0.3, 1.2)
        up = _cos_z(np.array(a), np.array(e)) if kind == "equatorial" else np.sin(e)
        if 0.5 < up < 0.97:
            out.append((a, e))
    return np.array(out)


def _seen(machine: Machine, q: Array, changes: dict[str, float]) -> Array:
    names = machine.mechanism.readings
    table = dict(zip(names, np.degrees(q).T, strict=True)) | {
        "azimuth": 0 * q[:, 0],
        "elevation": 0 * q[:, 0],
    }
    predictor = Predictor(machine, load_recording(machine, table), machine.effects)
    p = predictor.model.p_home.copy()
    for name, value in changes.items():
        p[predictor.model.names.index(name)] = value
    x, _ = predictor.assemble(p)
    return predictor.columns(p, x)[1]


@pytest.mark.parametrize(
    ("kind", "term"), [*(("equatorial", t) for t in EQUATORIAL), *(("alt-az", t) for t in ALT_AZ)]
)
def test_a_small_constant_is_the_pointing_term_of_its_name(tmp_path: Path, kind: str, term: str) -> None:
    machine, q = _machine(tmp_path, kind), _angles(kind)
    known = {t.name: t for t in terms_of(machine, machine.effects)}[term]
    # refraction is no tangent: Bennett's is 58 arcsec cot E within 2 % from 30 deg on, and 57.8 arcsec stands for it
    size, allowed = (known.factor / ARCSEC, 0.02) if term == "TX" else (SMALL, 2e-5)
    moved = _seen(machine, q, {known.ours: size / known.factor * ARCSEC}) - _seen(machine, q, {})
    law = (EQUATORIAL if kind == "equatorial" else ALT_AZ)[term](q[:, 0], q[:, 1])
    expected = size * np.column_stack(np.broadcast_arrays(*law, q[:, 0])[:2])
    moved[:, 0] = np.angle(np.exp(1j * moved[:, 0]))
    np.testing.assert_allclose(moved, expected, atol=allowed * np.abs(expected).max())


def test_both_sides_of_the_pier_see_the_same_sky(tmp_path: Path) -> None:
    machine = _machine(tmp_path, "equatorial")
    q = _angles("equatorial")
    turned = np.column_stack([q[:, 0] + np.pi, np.pi - q[:, 1]])
    np.testing.assert_allclose(_seen(machine, turned, {}), _seen(machine, q, {}), atol=1e-12)
    # collimation changes sides: the same tube looks to the other side of the same star
    one, other = (_seen(machine, s, {"tool.rz": SMALL}) - _seen(machine, s, {}) for s in (q, turned))
    np.testing.assert_allclose(one[:, 0], -other[:, 0], atol=1e-10)


@pytest.mark.parametrize("lean", [0.0, 0.3, -2.0])
def test_play_is_closed_by_the_side_that_is_heavy(tmp_path: Path, lean: float) -> None:
    play = f"  - {{effect: backlash, place: [alt], lean: {lean}, parameters: {{b: {{value: 2.0e-6, unit: rad}}}}}}\n"
    machine = machine_from(tmp_path, FILE.format(kind="alt-az", first="az", second="alt") + play)
    alt = np.radians(np.array([-60.0, 10.0, 45.0, 130.0, 170.0]))
    q = np.column_stack([np.zeros(5), alt])
    moved = np.sin(_seen(machine, q, {})[:, 1]) - np.sin(alt)
    # the load's centre stands at alt + lean; the tube sinks where it is in front, and tips back where it is behind
    # near the balance friction blurs it: 2 % of the half play are left 14 deg from there
    side = -np.sign(np.cos(alt + lean))
    np.testing.assert_allclose(moved, 1e-6 * side * np.cos(alt), atol=3e-8)


def test_an_equatorial_mount_needs_its_latitude_for_weight(tmp_path: Path) -> None:
    text = FILE.partition("effects:")[0].format(kind="equatorial").replace(", latitude: 39", "")
    machine = machine_from(tmp_path, text, "mount")
    assert machine.gravity is None
    assert not machine.masses
