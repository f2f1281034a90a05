"""How well the odds of "only alike" fit names that were said of simulated machines: their likelihood over a grid.

    python -m benchmarks.prior_numbers DRAWN RESULTS

DRAWN and RESULTS are folders of ``truepose challenge --draw`` and ``--drawn`` with development seeds, never those of the
examination. Each name carries how probable the thing itself is beside what is only like it; from that follows the Bayes
factor between both, and from it what the name would be said with at other prior odds (``diagnosis.prior.ONLY_ALIKE``
where nothing nameless is said to be there, ``PART_OF_IT`` beside it).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truepose.identification.diagnosis import prior
from truepose.identification.diagnosis.result import UNNAMED

GRID = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0, 4.0)
LEAST = 0.02
"""A share below this is not told: half of it is taken."""
CERTAIN = 1e-3
"""No probability counts as nearer to 0 or 1."""
ROWS = "outliers"


@dataclass(frozen=True)
class Said:
    """A name: whether it is true, its probability if nothing were only alike, its Bayes factor; whether beside a rest."""

    right: bool
    own: float
    factor: float
    beside: bool


def said(drawn: Path, results: Path) -> Iterator[Said]:
    """Every name of every diagnosis."""
    for file in sorted(results.glob("results/*/diagnosis.json")):
        found = json.loads(file.read_text(encoding="utf-8"))
        answer = json.loads((drawn / "answers" / f"{file.parent.name}.json").read_text(encoding="utf-8"))
        true = {(t["effect"], frozenset(t["place"])) for t in answer["truths"]}
        beside = bool(found.get("remainder"))
        odds = prior.PART_OF_IT if beside else prior.ONLY_ALIKE
        for one in (f for f in found["findings"] if f["effect"] != ROWS):
            alike = sum(e["probability"] for e in one["equivalents"] if e["effect"] == UNNAMED)
            held = one["probability"] / (one["probability"] + max(alike, LEAST / 2))
            right = (one["effect"], frozenset(one["place"])) in true
            yield Said(right, min(one["probability"] / held, 1.0), (1.0 / held - 1.0) / odds, beside)


def log_likelihood(names: list[Said], odds: float) -> float:
    """Of names that were right or wrong, at prior odds of "only alike"."""
    p = np.array([n.own / (1.0 + odds * n.factor) for n in names])
    p = np.clip(p, CERTAIN, 1.0 - CERTAIN)
    return float(np.sum(np.where([n.right for n in names], np.log(p), np.log1p(-p))))


def main(drawn: Path, results: Path) -> None:
    """Print both tables."""
    every = list(said(drawn, results))
    for beside, words in ((False, "nothing nameless beside it"), (True, "beside something nameless")):
        names = [n for n in every if n.beside is beside]
        if not names:
            continue
        right = sum(n.right for n in names)
        sys.stdout.write(f"{words}: {right} of {len(names)} names right\n")
        for odds in GRID:
            sys.stdout.write(f"  odds {odds:4.2f}: log likelihood {log_likelihood(names, odds):7.1f}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
