"""What an examination says at three levels, and what it is worth to the tool, apart for what the catalogue holds and what not.

    python -m challenge.studies.levels_by_stratum DRAWN DIR

DRAWN holds the cases and their keys, DIR the results of one sitting (``python -m challenge --drawn DRAWN -o DIR``).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from challenge.level_figures import level_figures
from challenge.schedule import OUTSIDE
from challenge.score import Score, read_score
from truepose.models.file.sections import NO_WORSE

PARTS: Mapping[str, Callable[[Score], bool]] = {
    "inside the library": lambda score: score.solution.stratum != OUTSIDE,
    "real-like": lambda score: score.solution.stratum == "real-like",
    "outside the library": lambda score: score.solution.stratum == OUTSIDE,
}


def main(drawn: str, folder: str) -> None:
    """One block of lines for each part."""
    cases = sorted(path.name for path in (Path(folder) / "results").iterdir())
    scores = [read_score(Path(drawn), Path(folder), case) for case in cases]
    for name, belongs in PARTS.items():
        own = [score for score in scores if belongs(score)]
        sys.stdout.write(f"{name}: {len(own)} cases\n")
        for figure in level_figures(own):
            if figure.value is not None:
                sys.stdout.write(f"  {figure.name}: {figure.value:.2f} ({figure.hits} of {figure.n})\n")
        ratios = np.array([s.pose_ratio for s in own if s.pose_ratio is not None])
        worse = sorted(float(ratio) for ratio in ratios[ratios > NO_WORSE].round(2))
        if len(ratios):
            told = f"median {np.median(ratios):.2f}, above {NO_WORSE}: {len(worse)} of {len(ratios)} {worse}"
            sys.stdout.write(f"  tool on fresh poses, improved over plain: {told}\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
