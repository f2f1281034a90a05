"""Heat in a bar by finite volumes: a motor at one end warms it and a block beside it, air cools both.

Plain numpy, in SI units and degC. A thermometer sits on the block, none on the bar: what it reads leads the bar's mean, with
another size and from another start. No first-order lag is in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEP = 5.0
"""Seconds of a time step."""
CELLS = 16


@dataclass(frozen=True)
class Bar:
    """length (m), diffusivity (m^2/s); cooling (1/s): of a cell by the air; fed (K/s): how fast the motor at full duty warms
    the first cell; the same of the block with the thermometer, which touches the bar's first cell (touch, 1/s).
    """

    length: float
    diffusivity: float
    cooling: float
    fed: float
    block_cooling: float
    block_fed: float
    touch: float

    @classmethod
    def drawn(cls, rng: np.random.Generator, length: float) -> Bar:
        """A bar of steel or aluminium whose mean warms up by 8 to 16 K at full duty."""
        diffusivity = float(rng.choice([1.2e-5, 6.0e-5]))
        cooling = 1.0 / rng.uniform(1200.0, 4000.0)
        fed = CELLS * cooling * rng.uniform(8.0, 16.0)
        block_cooling = 1.0 / rng.uniform(300.0, 1500.0)
        return cls(
            length, diffusivity, cooling, fed, block_cooling, block_cooling * rng.uniform(6.0, 20.0), 2e-4
        )

    def history(self, duty: Array, air: Array, start: float) -> tuple[Array, Array]:
        """Mean of the bar and the block (n,), by steps of ``STEP``, from ``start`` on: degC."""
        exchange = self.diffusivity / (self.length / CELLS) ** 2
        parts = int(np.ceil(STEP * 2.5 * exchange)) or 1  # explicit steps stay stable
        h = STEP / parts
        bar, block = np.full(CELLS, start), start
        means, blocks = np.empty(len(duty)), np.empty(len(duty))
        for k in range(len(duty)):
            for _ in range(parts):
                flow = np.diff(bar) * exchange
                change = np.concatenate([flow, [0.0]]) - np.concatenate([[0.0], flow])
                change -= self.cooling * (bar - air[k])
                change[0] += self.fed * duty[k] - self.touch * (bar[0] - block)
                own = self.block_fed * duty[k] - self.block_cooling * (block - air[k])
                block += h * (own + self.touch * (bar[0] - block))
                bar = bar + h * change
            means[k], blocks[k] = bar.mean(), block
        return means, blocks


def duty_of(rng: np.random.Generator, seconds: float) -> Array:
    """Duty cycles (0 to 1) of 20 to 60 minutes each, by steps of ``STEP``."""
    out = list[float]()
    while len(out) * STEP < seconds:
        level = float(rng.choice([0.0, rng.uniform(0.3, 1.0)]))
        out += [level] * int(rng.uniform(1200.0, 3600.0) / STEP)
    return np.array(out[: int(seconds / STEP) + 1])


__all__ = ["STEP", "Bar", "duty_of"]
