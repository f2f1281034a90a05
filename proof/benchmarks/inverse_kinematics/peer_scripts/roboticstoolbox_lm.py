"""roboticstoolbox's `ETS.ik_LM`, its C++ core: a pose a call from near and from random guesses; metres.

python roboticstoolbox_lm.py IN.npz OUT.npz. IN: placements (7, 4, 4), targets (n, 4, 4), guesses (n, 6), ranges (6, 2),
limited (whether solutions must be in them), method, k, repeats. OUT: seconds of processor time a pose, one a repeat,
and rows of success and joints.
"""

import sys
import time
from importlib import import_module

import numpy as np

TOLERANCE = 1e-19
"""Of E, half the square of the error: 4e-10 m and rad."""


def main(given: str, taken: str) -> None:
    inputs = np.load(given)
    rtb = import_module("roboticstoolbox")
    *before, tool = (rtb.ET.SE3(placement.copy()) for placement in inputs["placements"])
    turns = [rtb.ET.Rz(jindex=k, qlim=span) for k, span in enumerate(inputs["ranges"])]
    chain = rtb.ETS([part for pair in zip(before, turns, strict=True) for part in pair] + [tool])
    options = {
        "method": str(inputs["method"]),
        "k": float(inputs["k"]),
        "joint_limits": bool(inputs["limited"]),
        "tol": TOLERANCE,
    }
    rows = list(zip(inputs["targets"], inputs["guesses"], strict=True))
    seconds = []
    for _ in range(int(inputs["repeats"])):
        start = time.process_time()
        solutions = [chain.ik_LM(target, q0=guess, **options) for target, guess in rows]
        seconds.append((time.process_time() - start) / len(rows))
    output = np.array([[float(s.success), *s.q] for s in solutions])
    np.savez(taken, seconds=seconds, output=output)


if __name__ == "__main__":
    main(*sys.argv[1:])
