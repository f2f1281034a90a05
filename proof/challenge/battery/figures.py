"""The battery's figures: of what simulated cases are scored by, of real recordings, and of every diagnosis."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from challenge.battery.claims import replicated, sure
from challenge.battery.parts import MUJOCO, RECORDED, STRATA
from challenge.battery.results import Results
from challenge.figures import Figure, counted, median, quantile, share
from challenge.headline import WORSE, headline
from challenge.schedule import NULL, OUTSIDE
from challenge.score import Score

AGREEING = 0.05
"""Disagreement of chains up to which probabilities are known well enough."""
COMMON = (
    "law, said with 0.9 or more, right",
    "place and driver, said with 0.9 or more, right",
    "place, said with 0.9 or more, right",
    "effects above 5 limits whose place and driver are said with 0.9 or more",
    "all cases: confident wrong name",
    "tool pose on fresh poses, improved over plain, median",
    "tool pose on fresh poses, improved over plain, cases above 1.02",
    "held-out predictions: rms of error over .std",
    "held-out predictions: inside 1.96 .std",
    "place: expected calibration error",
    "place and driver: expected calibration error",
    "law: expected calibration error",
    "names: expected calibration error",
)
RICH = (
    "real-like: names said with 0.9 or more, the very truth",
    "real-like: the same, or as good as the truth",
    "real-like: effects above 5 limits, named",
)
STRANGE = (
    "out of library: confident wrong name",
    "out of library: unknown, or as good a name first",
    "out of library, lenient: unknown or honest",
    "out of library: held-out error over the best empirical model's, median",
    "out of library: a wrong law with 0.9 or more",
)
OF_PART = {**dict.fromkeys(STRATA, COMMON), MUJOCO: (*COMMON, *RICH, *STRANGE)}
OF_PART |= {"real-like": (*COMMON, *RICH), "outside": (*COMMON, *STRANGE)}
"""Figures of the examination that matter for a part."""


def figures(part: str, found: Results) -> tuple[Figure, ...]:
    """All of one part, the same whatever was found."""
    own = _real(found) if part == RECORDED else _simulated(part, found.scores)
    return (*own, *_runs(found))


def _simulated(part: str, scores: Sequence[Score]) -> list[Figure]:
    known = {figure.name: figure for figure in headline(scores)}
    inside = [s for s in scores if s.solution.stratum not in (NULL, OUTSIDE)]
    return [share("first name right", inside, lambda s: s.first), *(known[name] for name in OF_PART[part])]


def _real(found: Results) -> list[Figure]:
    out = []
    for what in ("readings", "tool"):
        pairs = [m[what] for m in found.measures.values() if m[what] is not None]
        ratios = [applied / plain for plain, applied in pairs]
        name = f"{what} on rows that were not fitted, applied over plain"
        out += [
            median(f"{name}, median", ratios),
            quantile(f"{name}, worst", ratios, 1.0),
            share(f"{name}, cases above {WORSE:g}", ratios, lambda ratio: ratio > WORSE),
        ]
    for what, law in (("names", True), ("places with their driver", False)):
        said = sum(len(sure(document, law=law)) for document in found.diagnoses.values())
        kept = replicated(found.diagnoses, law=law)
        out += [
            _number(f"{what} said with 0.9 or more", said),
            share(f"{what} said so in a half and not with 0.5 in the whole", kept, lambda stands: not stands),
        ]
    verdicts = Counter(document["verdict"] for document in found.diagnoses.values())
    total = len(found.diagnoses)
    return [
        *out,
        *(counted(f"verdict {v}", verdicts[v], total) for v in ("missing-physics", "unknown", "adequate")),
    ]


def _runs(found: Results) -> list[Figure]:
    apart = [float(document["disagreement"]) for document in found.diagnoses.values()]
    spent = [float(run["cpu"]) for run in found.runs.values() if "cpu" in run]
    return [
        median("disagreement of the chains, median", apart),
        quantile("disagreement of the chains, worst", apart, 1.0),
        share(f"disagreement of the chains, {AGREEING} or less", apart, lambda by: by <= AGREEING),
        median("processor seconds of a case, median", spent),
        quantile("processor seconds of a case, worst", spent, 1.0),
        share("failures", found.runs.values(), lambda run: bool(run["message"])),
    ]


def _number(name: str, value: int) -> Figure:
    """A plain count."""
    return Figure(name, value, value, float(value), None, None, share=False)


__all__ = ["figures"]
