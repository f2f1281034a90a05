"""What the studies share: their output, an rms, which rows are held out."""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
FILES = ("configurations", "grid")
HELD_OUT = (3, 6, 9)
"""Goals modulo ten whose rows are held out."""


def say(text: str) -> None:
    """One line, at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def rms(values: Array) -> float:
    """Root mean square of numbers, or of the norms of rows (n, k)."""
    squares = values**2 if values.ndim == 1 else (values**2).sum(axis=1)
    return float(np.sqrt(np.mean(squares)))
