"""How often a part that heats up beside another's thermometer, and a joint whose torque is measured, are named.

    python -m benchmarks.drivers [MACHINES] [JOBS]

Prints what was said of each machine, and three shares for each of the two cases.
"""

from __future__ import annotations

import sys

import numpy as np
from drivers.study import Judged, heated, soft
from joblib import Parallel, delayed


def say(line: str) -> None:
    """One line, at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main(machines: int = 12, jobs: int = 1) -> None:
    """Both cases, printed."""
    for title, one in (
        ("heated beside another's thermometer", heated),
        ("torques measured, payload untold", soft),
    ):
        say(f"# {title}")
        judged: list[Judged] = []
        for j in Parallel(n_jobs=jobs, return_as="generator")(delayed(one)(seed) for seed in range(machines)):
            judged.append(j)
            say(f"{j.seed}: {j.put}: {'place, ' if j.place else ''}{'law' if j.law else ''} | {j.said}")
        errors = np.array([e for j in judged for e in j.errors])
        say(
            f"place and driver {np.mean([j.place for j in judged]):.2f}, law {np.mean([j.law for j in judged]):.2f}"
        )
        if len(errors):
            say(
                f"coefficients within 2 sigma: {np.mean(np.abs(errors) < 2):.2f} of {len(errors)}: {errors.round(1)}"
            )


if __name__ == "__main__":
    main(*(int(text) for text in sys.argv[1:]))
