"""The shift of a bent flexure's centre, as beam theory gives it (Gayral and Daney 2012, INRIA RR-8096, section 4.3).

A flexure of length l, bent by an angle d in pure bending, turns its tip like a ball joint in its middle, but
leads it along a circle of radius (1 - beta) l, beta = 1/4, where a ball joint's would be l/2. Seen from the
middle the rod so gains

    gain(z.z0) = l/2 ((2 beta - 1) z.z0 + sqrt(3 - 4 beta + ((1 - 2 beta) z.z0)^2)) - l/2  =  l d^2/12 + ...

where z is the rod's direction and z0 that of the straight flexure, cos d = z.z0 (eqs. 15 to 17, less the half
length that is there anyhow).
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from truepose.models.machine.mechanism import Flexures

SHAPE = 0.25
"""beta of a flexure of constant section: its tip runs on a circle of 3/4 of its length (eq. 13)."""


def gain(length: ca.SX, shape: ca.SX, cosine: ca.SX) -> ca.SX:
    """What a flexure bent by acos(``cosine``) adds to its rod, mm; ``shape`` is beta, 1/2 a ball joint's circle."""
    turned = (1 - 2 * shape) * cosine
    return length / 2 * (ca.sqrt(3 - 4 * shape + turned**2) - turned - 1)


def gains(
    flexures: Flexures, span: ca.SX, frame_a: ca.SX, frame_b: ca.SX, values: Mapping[str, ca.SX]
) -> ca.SX:
    """What both flexures of a rod along ``span`` (3,) between two bodies' frames (4, 4) add to its length, mm."""
    along = span / ca.norm_2(span)
    length, shape = values[flexures.length], values[flexures.shape]
    ends = ((frame_a, flexures.axis_a), (frame_b, flexures.axis_b))
    cosines = [ca.dot(along, frame[:3, :3] @ ca.DM(axis)) for frame, axis in ends]
    return sum((gain(length, shape, cosine) for cosine in cosines), ca.SX(0))
