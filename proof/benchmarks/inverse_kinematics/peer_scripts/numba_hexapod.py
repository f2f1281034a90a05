"""The closed-form inverse of a 6-PUS in numba, one thread: readings from positions and roll, pitch, yaw; mm, rad.

python numba_hexapod.py IN.npz OUT.npz. IN: legs (6, 11) of a, u, b, length and offset, poses (n, 6), repeats. OUT:
seconds of processor time a pose, one a repeat, and readings (n, 6).
"""

import sys
import time
from importlib import import_module
from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def closed_form(legs: Array, poses: Array, out: Array) -> None:
    """Readings ``out`` (n, 6); compiled by numba."""
    for i in range(poses.shape[0]):
        x, y, z = poses[i, 0], poses[i, 1], poses[i, 2]
        cr, sr = cos(poses[i, 3]), sin(poses[i, 3])
        cp, sp = cos(poses[i, 4]), sin(poses[i, 4])
        cy, sy = cos(poses[i, 5]), sin(poses[i, 5])
        r00, r01, r02 = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
        r10, r11, r12 = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
        r20, r21, r22 = -sp, cp * sr, cp * cr
        for k in range(6):
            bx, by, bz = legs[k, 6], legs[k, 7], legs[k, 8]
            wx = r00 * bx + r01 * by + r02 * bz + x - legs[k, 0]
            wy = r10 * bx + r11 * by + r12 * bz + y - legs[k, 1]
            wz = r20 * bx + r21 * by + r22 * bz + z - legs[k, 2]
            along = wx * legs[k, 3] + wy * legs[k, 4] + wz * legs[k, 5]
            across = wx * wx + wy * wy + wz * wz - along * along
            out[i, k] = along - sqrt(legs[k, 9] * legs[k, 9] - across) - legs[k, 10]


def main(given: str, taken: str) -> None:
    inputs = np.load(given)
    legs, poses = np.ascontiguousarray(inputs["legs"]), np.ascontiguousarray(inputs["poses"])
    out = np.empty((len(poses), 6))
    inverse = import_module("numba").njit(fastmath=True, parallel=False, boundscheck=False)(closed_form)
    inverse(legs, poses, out)
    seconds = []
    for _ in range(int(inputs["repeats"])):
        start = time.process_time()
        inverse(legs, poses, out)
        seconds.append((time.process_time() - start) / len(poses))
    np.savez(taken, seconds=seconds, output=out)


if __name__ == "__main__":
    main(*sys.argv[1:])
