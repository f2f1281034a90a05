"""How well the odds of rivals without a name fit names that were said of simulated machines: their likelihood over grids.

    python -m benchmarks.prior_numbers DRAWN [DRAWN ...]

DRAWN are folders of ``truepose challenge --draw`` with development seeds, never those of the examination; each case is
diagnosed. A name has a probability from the search, and two rivals: what is only like it (``ONLY_ALIKE`` where nothing
nameless is said to be there, ``PART_OF_IT`` beside it), and what a form without a name leaves of the thing it stands
for (``LEFT_OF_IT``, ``LEFT_SHARE``). All are in ``diagnosis.prior``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np
from joblib import Parallel, delayed

from truepose import diagnose, load_machine, load_recording
from truepose.identification.diagnosis import naming, prior
from truepose.identification.diagnosis.likeness import forms_hold, left_over
from truepose.identification.diagnosis.naming import Named
from truepose.identification.diagnosis.search import Found

ALIKE = (0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1.0)
PART = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)
LEFT = (0.0, 1.0, 2.0, 3.0, 4.0)
SHARES = (0.2, 0.3, 0.5, 0.7, 1.0, 1.5)
CERTAIN = 1e-3
"""No probability counts as nearer to 0 or 1."""
JOBS = 2


@dataclass(frozen=True)
class Odds:
    """The four numbers that are judged."""

    alike: float = prior.ONLY_ALIKE
    part: float = prior.PART_OF_IT
    left: float = prior.LEFT_OF_IT
    share: float = prior.LEFT_SHARE


@dataclass(frozen=True)
class Said:
    """A name: whether it is true; its probability from the search, the Bayes factor of what is only like it; how probable
    something nameless is, what the name (with its family) and the largest nameless thing are worth in nats."""

    right: bool
    own: float
    factor: float
    nameless: float
    worth: float
    of_nameless: float

    def probability(self, odds: Odds) -> float:
        """What the name would be said with."""
        alike = ((1.0 - self.nameless) * odds.alike + self.nameless * odds.part) * self.factor
        nats = odds.share * self.of_nameless
        left = self.nameless * odds.left * float(np.exp(-self.worth / nats)) if nats > 0.0 else 0.0
        return self.own / (1.0 + alike + left)


def said(case: Path, key: Path) -> list[Said]:
    """Every name that the diagnosis of a case weighed against its rivals, said or not."""
    answer = json.loads(key.read_text(encoding="utf-8"))
    true = {(t["effect"], frozenset(t["place"])) for t in answer["truths"]}
    held, left, names = list[float](), list[tuple[float, float, float]](), list[Named]()

    def with_forms(found: Found, nameless: float, some: Sequence[Sequence[int]]) -> list[float]:
        left.clear()
        names.clear()
        held[:] = forms_hold(found, nameless, some)
        return held

    def with_left(nameless: float, gain: float, of_nameless: float) -> float:
        left.append((nameless, max(gain, 0.0), of_nameless))
        return left_over(nameless, gain, of_nameless)

    def kept(one: Named, *given: float) -> Named:
        names.append(one)
        return beside(one, *given)

    beside = naming._beside_alike
    with (
        patch.object(naming, "forms_hold", with_forms),
        patch.object(naming, "left_over", with_left),
        patch.object(naming, "_beside_alike", kept),
    ):
        machine = load_machine(case / "machine.yaml")
        diagnose(machine, load_recording(machine, [case / "recording.csv"]))
    return [
        Said(
            (one.cause.effect, frozenset(one.cause.place)) in true,
            one.probability,
            _factor(h, rest[0]),
            *rest,
        )
        for one, h, rest in zip(names, held, left, strict=True)
    ]


def _factor(held: float, nameless: float) -> float:
    """The Bayes factor of what is only like a name that is the thing itself with a probability ``held``."""
    return (1.0 / held - 1.0) / ((1.0 - nameless) * prior.ONLY_ALIKE + nameless * prior.PART_OF_IT)


def log_likelihood(names: Sequence[Said], odds: Odds) -> float:
    """Of names that were right or wrong, at other odds."""
    p = np.clip([n.probability(odds) for n in names], CERTAIN, 1.0 - CERTAIN)
    return float(np.sum(np.where([n.right for n in names], np.log(p), np.log1p(-p))))


def _tables(names: Sequence[Said]) -> Iterator[str]:
    yield f"{sum(n.right for n in names)} of {len(names)} names right; at present {log_likelihood(names, Odds()):.1f}"
    for alike in ALIKE:
        told = (f"{log_likelihood(names, Odds(alike=alike, part=part)):8.1f}" for part in PART)
        yield f"only alike {alike:4.2f}, part of it {PART}: {''.join(told)}"
    for left in LEFT:
        told = (f"{log_likelihood(names, Odds(left=left, share=share)):8.1f}" for share in SHARES)
        yield f"left over {left:4.2f}, shares {SHARES}: {''.join(told)}"


def main(folders: Sequence[Path]) -> None:
    """Diagnose all, print both tables."""
    cases = [
        (case, case.parents[1] / "answers" / f"{case.name}.json")
        for d in folders
        for case in sorted(d.glob("cases/*"))
    ]
    found = Parallel(n_jobs=JOBS, batch_size=1)(delayed(said)(*each) for each in cases)
    for line in _tables([name for names in found for name in names]):
        sys.stdout.write(f"{line}\n")


if __name__ == "__main__":
    main([Path(folder) for folder in sys.argv[1:]])
