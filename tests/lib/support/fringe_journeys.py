"""Light of whole moves from ``benchmarks/fringe_signal.py``, which adds the light beam by beam. Lengths mm."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

signals, study = import_module("fringe_signal"), import_module("fringe_study")
FIBRE = (0.04, 0.9)
"""Reflectivities of a fibre's end and a mirror."""


def journey(seed: int, samples: float = 30.0, turning: bool = False, scan: float = 2e-5, **light: Any) -> Any:
    """A simulated journey over 19 to 38 fringes."""
    detector = signals.Detector(**{"noise": 0.005, **light})
    return study.journey(samples, detector, turning, scan)(np.random.default_rng(seed))
