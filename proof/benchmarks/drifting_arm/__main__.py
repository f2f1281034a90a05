"""How often ``drift`` sees a movement, and how often it sees one that is not there.

    python -m benchmarks.drifting_arm [SEQUENCES] [JOBS]

Arms drawn from their tolerances, four sessions of thirty poses. In the first lot nothing moves. In the second one
constant, drawn at random, moves once, after the second session, by a size stated in units of the 1-sigma ``hidden``
that ``drift`` gives for it. In the third, frames are set up anew and several parts move. Prints tables and writes
docs/figures/drift_detection.svg.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from drifting_arm.study import Several, moving, several, still
from joblib import Parallel, delayed

from figures import Series, write_chart

SIZES = (1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0)
FIGURE = Path(__file__).parents[3] / "docs" / "figures" / "drift_detection.svg"


def say(line: str) -> None:
    """One line, at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main(sequences: int = 100, jobs: int = 2) -> None:
    """Both lots, printed."""
    calm = Parallel(n_jobs=jobs)(delayed(still)(seed) for seed in range(sequences))
    ps = np.array([p for _, values, _ in calm for p in values])
    alarms = sum(count > 0 for count, _, _ in calm)
    dropped = sum(not all(holds) for _, _, holds in calm)
    say(f"nothing moves: {alarms} of {sequences} sequences with a movement")
    say(f"an older calibration given up: {dropped} of {sequences}")
    shares = ", ".join(f"{np.mean(ps < level):.3f} below {level}" for level in (0.01, 0.05, 0.5))
    say(f"p values of older calibrations: {shares}")
    each = max(2 * sequences // 5, 1)
    rates, names = [], []
    say("size | found | named itself | others | rms error of size, stds")
    for size in SIZES:
        outcomes = Parallel(n_jobs=jobs)(delayed(moving)(1000 + seed, size) for seed in range(each))
        rates.append(sum(o.found for o in outcomes) / each)
        names.append(sum(o.named for o in outcomes) / each)
        others = sum(o.others > 0 for o in outcomes)
        errors = np.array([o.error for o in outcomes if np.isfinite(o.error)])
        rms = float(np.sqrt(np.mean(errors**2))) if len(errors) else np.nan
        say(f"{size:g} | {rates[-1]:.2f} | {names[-1]:.2f} | {others} of {each} | {rms:.2f}")
    curves = [Series("found", SIZES, rates, "both"), Series("named itself", SIZES, names, "both")]
    many = Parallel(n_jobs=jobs)(delayed(several)(5000 + seed) for seed in range(max(3 * sequences // 5, 1)))
    moved, named, wrong, far_off = (sum(getattr(m, key) for m in many) for key in Several.__annotations__)
    say(f"many move: {named} of {moved} named, {wrong} others, {far_off} sizes off by more than 4 stds")
    title, label = "One constant moves once in four sessions", "size of the movement, in sigmas that hide it"
    write_chart(FIGURE, title, label, "share of sequences", curves)


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:]))
