"""How much a file may hold, and how large its numbers may be: beyond is a slip, or meant to do harm.

What lies within these limits is read in seconds, and its squares and products are numbers a processor has.
`docs/reference/refused.md` lists them.
"""

from __future__ import annotations

from typing import Final

LARGEST: Final = 1e12
"""Of any number in mm, rad, kg, N ... of a machine file or a recording, by size. A thousand million metres."""
SMALLEST: Final = 1e-12
"""Of a standard deviation, a tolerance that is not 0, a gear ratio or a pitch: fractions of an atom's size, and 1e-12 rad."""
LATEST: Final = 1e20
"""Of plain numbers, and of columns that are neither joints nor readings: nanoseconds since 1970 are 1.8e18."""
ENTRIES: Final = 500_000
"""Values in a YAML document, as the signs between them tell."""
LEAST_GRAVITY: Final = 1e-6
"""m/s^2: less bends nothing, and says not which way is down."""
PARTS: Final = 300
"""Joints, bodies, legs ... of one mechanism: more would be equations for hours."""
NAMED: Final = 20_000
"""Targets, masses, effects, tolerances ... of one machine file."""
ROWS: Final = 2_000_000
"""Of one file of a recording."""
POSES: Final = 10_000
"""That are planned or drawn at once."""


def within(value: float, largest: float = LARGEST) -> bool:
    """Whether a number is finite and not larger than a file may state."""
    return -largest <= value <= largest


def positive(value: float) -> bool:
    """Whether a number that must be positive is one that can be divided by."""
    return SMALLEST <= value <= LARGEST
