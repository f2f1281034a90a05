"""ssik's `Manipulator.solve`: all branches of a general 6R arm, a pose a call; metres.

python ssik_branches.py IN.npz OUT.npz. IN: placements (7, 4, 4), targets (n, 4, 4), refine (0 or 1: its option for
candidates that just fail its check). OUT: seconds of processor time a pose, and rows of a count and up to 16 times
six joints. The tool is folded into the targets: behind a turned tool frame ssik 8.2 meets the PUMA's poses only to
0.1 mm. The first run of an arm derives its elimination (two minutes), which ssik keeps on disk.
"""

import sys
import time
from importlib import import_module

import numpy as np

MOST = 16


def main(given: str, taken: str) -> None:
    inputs = np.load(given)
    ssik = import_module("ssik")
    *before, tool = inputs["placements"]
    arm = ssik.Manipulator.from_transforms([*before, np.eye(4)])
    arm.prepare()
    options = {"respect_limits": False, "allow_refinement": bool(inputs["refine"])}
    targets = list(inputs["targets"] @ np.linalg.inv(tool))
    arm.solve(targets[0], **options)
    start = time.process_time()
    found = [arm.solve(target, **options) for target in targets]
    seconds = (time.process_time() - start) / len(targets)
    output = np.zeros((len(found), 1 + 6 * MOST))
    for row, solutions in zip(output, found, strict=True):
        row[0] = len(solutions)
        row[1 : 1 + 6 * len(solutions)] = np.ravel([solution.q for solution in solutions])
    np.savez(taken, seconds=[seconds], output=output)


if __name__ == "__main__":
    main(*sys.argv[1:])
