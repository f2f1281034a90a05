"""The paper's tables as constants of the nanopositioner's geometry (``challenge.simulator.cavity``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from challenge.simulator import cavity as simulator
from challenge.simulator.cavity import (
    cavity,
    end_effector,
    lengths,
    light,
    mirror_pose,
    normals,
    reflection,
)
from challenge.simulator.motions import rotation, shift

from .tables import BEAM_ZERO, JOINTS, NOMINAL, Tabled

Array = NDArray[np.float64]
MM = 1e-3
"""mm in a um."""


@dataclass(frozen=True)
class Constants(simulator.Constants):
    """Everything the paper identifies, from its tables; mm, rad."""

    @classmethod
    def of(cls, intrinsic: Mapping[str, float], extrinsic: Mapping[str, float]) -> Constants:
        """From tables in um and deg; what ``intrinsic`` does not name is that of Table I."""
        rows = np.zeros((6, 5))
        for k, joint in enumerate(JOINTS):
            for j, name in enumerate(("beta", "alpha", "d", "theta", "r")):
                value = intrinsic.get(f"{joint}.{name}", NOMINAL[joint].get(name, 0.0))
                rows[k, j] = value * MM if name in "dr" else np.radians(value)
        e = extrinsic
        beam = [e["x_wf"] * MM, e["y_wf"] * MM, e["z_wf"] * MM]
        beam += [np.radians(e["beta_wf"] + BEAM_ZERO), np.radians(e["theta_wf"])]
        mirror = [e["z_et"] * MM, np.radians(e["beta_et"]), np.radians(e["theta_et"])]
        return cls(rows, np.array(beam), np.array(mirror))

    @classmethod
    def tabled(cls, table: Tabled) -> Constants:
        """From one day's tables."""
        return cls.of(table.intrinsic, table.extrinsic)


__all__ = [
    "MM",
    "Constants",
    "cavity",
    "end_effector",
    "lengths",
    "light",
    "mirror_pose",
    "normals",
    "reflection",
    "rotation",
    "shift",
]
