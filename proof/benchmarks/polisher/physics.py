"""What the rigid robot leaves out: ball screws that warm up along their length, and a wrist gear that winds up.

Heat diffuses along each screw from where the nut rubs and from the bearing, by finite volumes; what grows is the part
between bearing and nut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import workspace as ws
from .motions import Array

AMBIENT = 20.0
GRAVITY = 9.80665
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class Screw:
    """A steel ball screw: mm, s, degC.

    Friction drives the stretch that the nut runs on towards ``warming`` above the room, with time constant
    ``rise``; elsewhere heat only spreads, and is lost at the rate 1 / ``loss``.
    """

    warming: float
    rise: float = 900.0
    expansion: float = 11.7e-6
    diffusivity: float = 13.0
    loss: float = 6000.0
    length: float = 1250.0
    rubbed: tuple[float, float] = (50.0, 1200.0)
    cells: int = 50

    def growth(self, time: Array, active: Array) -> tuple[Array, Array]:
        """Growth (n,) mm of the part of length ``active`` (n,) next to the bearing, and the nut's thermometer (n,) degC.

        ``time`` (n,) s must not decrease; the screw is cold at 0.
        """
        width = self.length / self.cells
        step = 0.4 * width**2 / self.diffusivity
        edge = np.arange(self.cells) * width
        rubbed = (edge >= self.rubbed[0]) & (edge < self.rubbed[1])
        above, now = np.zeros(self.cells), 0.0
        growth, thermometer = np.zeros(len(time)), np.zeros(len(time))
        for k, end in enumerate(time):
            while now < end:
                dt = min(step, float(end) - now)
                spread = np.diff(above, prepend=above[0], append=above[-1])
                heat = np.where(rubbed, (self.warming - above) / self.rise, -above / self.loss)
                above = above + dt * (self.diffusivity / width**2 * np.diff(spread) + heat)
                now += dt
            share = np.clip((active[k] - edge) / width, 0.0, 1.0)
            growth[k] = self.expansion * width * np.sum(above * share)
            thermometer[k] = AMBIENT + np.interp(active[k], edge + width / 2, above)
        return growth, thermometer


@dataclass(frozen=True)
class Head:
    """Polishing head and the tool it carries: kg, centres of mass in the tool frame, mm; q5's gear, N m/rad."""

    kg: float = 22.0
    com: tuple[float, float, float] = (0.0, 12.0, -40.0)
    payload_com: tuple[float, float, float] = (0.0, 0.0, 150.0)
    stiffness: float = 1.1e5

    def torsion_q5(self, tools: Array, payload: Array, q6: Array) -> Array:
        """(n,) rad that the gear winds up under the weight behind it; tools (n, 4, 4), q6 (n,) rad."""
        return self.torque_q5(tools, payload, q6) / self.stiffness

    def torque_q5(self, tools: Array, payload: Array, q6: Array) -> Array:
        """(n,) N m that weight exerts about q5's axis, the wrist's y before q6 turns."""
        turn = tools[:, :3, :3]
        axis = np.cos(q6)[:, None] * turn[:, :, 1] - np.sin(q6)[:, None] * turn[:, :, 2]
        out = np.zeros(len(tools))
        for kg, com in ((np.full(len(tools), self.kg), self.com), (payload, self.payload_com)):
            arm = turn @ (np.array(com) + np.array([0.0, 0.0, ws.WRIST_OFFSET + ws.HEAD]))
            out += kg * GRAVITY * np.einsum("ni,ni->n", axis, np.cross(arm, DOWN)) / 1000.0
        return out
