"""What flexures at the ends of legs push back with, in proportion to what the actuators travel."""

from __future__ import annotations

import numpy as np

from truepose.arrays import Array
from truepose.models.effects.common import nominal_axis
from truepose.models.machine.machine import Machine

PARALLEL = 0.01
"""How far unit vectors that are the same at home may differ in a file's rounded numbers."""


def flexure_forces(machine: Machine) -> Array | None:
    """Return the legs' tensions (n, n), per mm of each actuator's travel, of flexures with a stiffness of 1 N mm/rad.

    To first order about home: rods of fixed lengths say where the platform moves, which bends every flexure by what its rod
    turns against the body that it is fixed to; tensions are those that hold it there, minus the derivative of the energy by
    the rods' lengths. None where the machine is no platform on six such rods that slides carry.
    """
    mechanism = machine.mechanism
    if mechanism.flexure_length is None or mechanism.loops == "elastic" or len(mechanism.limbs) != 6:
        return None
    nominal = machine.nominal_values  # of the drawing: a calibrated file has the same forces
    lengths = {rod.name: rod.length for rod in mechanism.rods}
    bent, closed, driven = np.zeros((12, 3, 12)), np.zeros((6, 6)), np.zeros(6)
    for k, limb in enumerate(mechanism.limbs):
        slide = mechanism.joint(mechanism.actuator(limb.reading).drives)
        ends = [mechanism.home_directions.get(f"{limb.name}.{end}") for end in "ab"]
        length = lengths.get(limb.name)
        if length is None or slide.kind != "prismatic" or None in ends or len(limb.platform_point) != 3:
            return None
        along = np.array(ends[1], dtype=float)
        if np.max(np.abs(along - np.array(ends[0], dtype=float))) > PARALLEL:
            return None  # the platform does not stand as its base does
        point = np.array([nominal[name] for name in limb.platform_point])
        # of the rod's ends against each other, by the platform's shift and turn and by the travel
        moved = np.hstack([np.eye(3), -_cross(point), np.zeros((3, 6))])
        moved[:, 6 + k] -= nominal_axis(machine, slide.axis)
        closed[k], driven[k] = along @ moved[:, :6], along @ moved[:, 6 + k]
        turned = (np.eye(3) - np.outer(along, along)) @ moved / nominal[length]
        bent[2 * k], bent[2 * k + 1] = turned, turned
        bent[2 * k + 1][:, 3:6] += _cross(along)  # the platform turns by w: n moves by -w x n in it
    stiff = np.einsum("eai,eaj->ij", bent, bent)
    per_length = np.linalg.inv(closed)  # of the platform's six motions, by the rods' lengths
    by_travel = -per_length * driven
    return np.asarray(-per_length.T @ (stiff[:6, :6] @ by_travel + stiff[:6, 6:]))


def _cross(vector: Array) -> Array:
    """Return the matrix (3, 3) of the cross product with a vector from the left."""
    return np.cross(vector, np.eye(3)).T
