"""Tables I to VII of the paper as numbers: um and deg, as printed.

H. Bettahar, O. Lehmann, C. Clevy, N. Courjal, P. Lutz, "6-DoF Full Robotic Calibration Based on 1-D
Interferometric Measurements for Micro and Nano-Scales Applications", IEEE T-ASE 19(1), 2022.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

JOINTS = ("q1", "q2", "q3", "q4", "q5", "q6")
PRISMATIC = (True, True, True, False, False, False)
ROW = ("beta", "alpha", "d", "theta", "r")
"""Constants of a joint in the order in which they act."""

NOMINAL: Mapping[str, Mapping[str, float]] = {
    "q1": {},
    "q2": {"alpha": -90.0, "theta": -90.0},
    "q3": {"alpha": -90.0, "theta": -90.0},
    "q4": {},
    "q5": {"alpha": -90.0, "theta": -90.0},
    "q6": {"alpha": -90.0},
}
"""Table I; what is not named is zero."""

_IDENTIFIED = {
    "q2.alpha": -90.13,
    "q2.theta": -89.22,
    "q3.alpha": -90.29,
    "q3.theta": -89.47,
    "q4.beta": -0.26,
    "q4.alpha": 0.25,
    "q4.d": -4.20,
    "q4.theta": -0.07,
    "q5.alpha": -89.45,
    "q5.d": -2.21,
    "q5.theta": -90.49,
    "q6.alpha": -90.57,
    "q6.theta": 0.14,
}
"""Table II."""

INTRINSIC = tuple(_IDENTIFIED)
EXTRINSIC = ("beta_et", "theta_et", "beta_wf", "theta_wf", "z_et", "x_wf", "y_wf", "z_wf")
BEAM_ZERO = 90.0
"""deg that beta_wf counts from: the paper's "angle between Y_f and Z_w" is zero when the light runs along -Y_w.
Without it equation (13) sends the light along Z_w, inside the mirror's plane."""


DRAWING: Mapping[str, float] = {**dict.fromkeys(EXTRINSIC, 0.0), "y_wf": 900.0}
"""Extrinsics before anything was measured: the fibre square to the mirror and 0.9 mm in front of the centre."""
NAMES: Mapping[str, str] = {
    "beta_et": "mirror.rx",
    "theta_et": "mirror.ry",
    "beta_wf": "beam.rx",
    "theta_wf": "beam.rz",
    "z_et": "mirror.z",
    "x_wf": "beam.x",
    "y_wf": "beam.y",
    "z_wf": "beam.z",
}
"""The machine file's names of the extrinsics."""


@dataclass(frozen=True)
class Tabled:
    """One column of Table III or IV with its table of intrinsics: um and deg; ``point`` is the printed wP_r."""

    day: float
    extrinsic: Mapping[str, float]
    intrinsic: Mapping[str, float]
    point: tuple[float, float, float]
    intrinsic_measured: bool = True


def _extrinsic(*values: float) -> Mapping[str, float]:
    return dict(zip(EXTRINSIC, values, strict=True))


def _between(one: Mapping[str, float], two: Mapping[str, float], share: float) -> Mapping[str, float]:
    return {name: round(one[name] + share * (two[name] - one[name]), 6) for name in one}


def between(one: Tabled, two: Tabled, share: float) -> Tabled:
    """What the tables would be at a ``share`` of the time from one to the other, if all moved evenly."""
    return Tabled(
        one.day + share * (two.day - one.day),
        _between(one.extrinsic, two.extrinsic, share),
        _between(one.intrinsic, two.intrinsic, share),
        one.point,
        intrinsic_measured=False,
    )


DAY_0 = Tabled(
    0,
    _extrinsic(0.768, -0.613, 0.721, -0.533, 1.61, 113.4, 916.1, 115.3),
    _IDENTIFIED,
    (155.5, -3.82, -109.78),
)
"""Tables II and III."""
DAY_1 = Tabled(
    1,
    _extrinsic(0.781, -0.615, 0.729, -0.561, 1.42, 112.9, 917.2, 115.7),
    {**_IDENTIFIED, "q4.beta": -0.29, "q6.theta": 0.16},
    (154.8, -3.75, -109.08),
)
"""Tables IV and V."""
DAY_2 = Tabled(
    2,
    _extrinsic(0.785, -0.619, 0.725, -0.565, 1.52, 112.3, 917.8, 116.4),
    {**_IDENTIFIED, "q4.beta": -0.30, "q6.theta": 0.17},
    (154.4, -3.61, -109.87),
)
"""Tables IV and VI."""
DAY_8 = Tabled(
    8,
    _extrinsic(0.811, -0.702, 0.763, -0.561, 2.3, 113.3, 918.8, 112.2),
    {**_IDENTIFIED, "q4.beta": -0.42, "q4.alpha": 0.29, "q5.alpha": -89.38, "q6.theta": 0.19},
    (148.7, -3.54, -107.53),
)
"""Tables IV and VII."""
DAY_7 = Tabled(
    7,
    _extrinsic(0.802, -0.710, 0.784, -0.591, 2.1, 112.4, 920.0, 113.1),
    _between(DAY_2.intrinsic, DAY_8.intrinsic, 5 / 6),
    (149.2, -3.4, -106.54),
    intrinsic_measured=False,
)
"""Table IV; the paper identified no intrinsic constants that day: these lie between Tables VI and VII, linear in
time."""
SEQUENCE = (DAY_0, DAY_1, DAY_2, DAY_7, DAY_8)


def parameter_values(intrinsic: Mapping[str, float], extrinsic: Mapping[str, float]) -> dict[str, float]:
    """Tables in um and deg as parameters of the machine file, mm and rad; only those that the paper identifies."""
    out = {}
    for name in INTRINSIC:
        joint, field_ = name.split(".")
        out[name] = _internal(field_ == "d", intrinsic.get(name, NOMINAL[joint].get(field_, 0.0)))
    for own, name in NAMES.items():
        zero = BEAM_ZERO if own == "beta_wf" else 0.0
        out[name] = _internal(own[1] == "_", extrinsic[own] + zero)
    return out


def _internal(is_length: bool, value: float) -> float:
    return value * 1e-3 if is_length else math.radians(value)
