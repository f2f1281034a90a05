"""Leg ends of the telescope's hexapod, as rows of a machine file."""

from __future__ import annotations

from collections.abc import Callable, Sequence

Ends = Sequence[tuple[tuple[float, float, float], tuple[float, float, float]]]

ENDS: Ends = (
    ((391.3, -83.2, 0.0), (173.6, -179.9, 0.0)),
    ((391.3, 83.2, 0.0), (173.6, 179.9, 0.0)),
    ((-123.6, 380.5, 0.0), (69.0, 240.3, 0.0)),
    ((-267.7, 297.3, 0.0), (-242.6, 60.4, 0.0)),
    ((-267.7, -297.3, 0.0), (-242.6, -60.4, 0.0)),
    ((-123.6, -380.5, 0.0), (69.0, -240.3, 0.0)),
)
"""Lower and upper end of each leg at home, mm in the base and in the platform."""
UNEVEN: Ends = (
    ((391.3, -83.2, 2.0), (173.6, -179.9, 1.0)),
    ((391.3, 83.2, -1.0), (173.6, 179.9, -3.0)),
    ((-123.6, 380.5, 0.0), (69.0, 240.3, 0.5)),
    ((-267.7, 297.3, 3.0), (-242.6, 60.4, 2.0)),
    ((-267.7, -297.3, -2.0), (-242.6, -60.4, -1.0)),
    ((-123.6, -380.5, 1.0), (69.0, -240.3, 0.0)),
)
"""The same off their planes, so that no symmetry hides a wrong sign."""


def leg_rows(fields: str | Callable[[int], str], ends: Ends = ENDS, joint: str = "rho") -> str:
    """The list under ``legs:``; ``fields``: what stands beside name, joint and ends, of all or by number from 1."""
    told = fields if callable(fields) else lambda k: str(fields)
    return "".join(
        f"    - {{name: leg{k}, joint: {joint}{k}, a: {list(a)}, b: {list(b)}, {told(k)}}}\n"
        for k, (a, b) in enumerate(ends, 1)
    )


FLEXURED = f"""
mechanism:
  type: 6-pus
  home: [0, 0, 440, 0, 0, 0]
  flexure: {{length: 30}}
  legs:
{leg_rows("length: 500, range: [-1.3, 1.3]")}"""
"""The mechanism with flexures for joints, as in a machine file."""
