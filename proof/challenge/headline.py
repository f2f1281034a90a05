"""What the examination is for: the figures with targets, strict ones first, lenient ones beside them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from challenge.calibration import error_of_cases, reliability
from challenge.figures import (
    Figure,
    at_least,
    at_most,
    between,
    bootstrapped,
    counted,
    median,
    quantile,
    share,
)
from challenge.level_figures import level_figures
from challenge.schedule import CONCEALED, NULL, OUTSIDE, REAL, TWO
from challenge.score import Score
from challenge.statements import SURE
from challenge.strata import CLEAR

ROUNDING = 0.999
"""Of a drawn size of three limits."""
WORSE = 1.02
"""Of plain calibration's error, from which on the improved model does harm."""


def headline(scores: Sequence[Score]) -> tuple[Figure, ...]:
    """Every figure that has a target, and what must stand beside it."""
    return (
        *_detection(scores),
        *_names(scores),
        *_real_like(scores),
        *level_figures(scores),
        *calibration(scores),
        *_outside(scores),
        *_predictions(scores),
        *_tool(scores),
        *_rows(scores),
        share("no diagnosis, or no prediction", scores, lambda s: bool(s.failure), at_most(0.0)),
    )


def clear(scores: Sequence[Score]) -> list[Score]:
    """Cases of one effect or two of the library, each of at least three limits."""
    return [
        s for s in scores if s.solution.stratum not in (NULL, OUTSIDE, REAL) and s.factor >= CLEAR * ROUNDING
    ]


def of_stratum(scores: Sequence[Score], stratum: str) -> list[Score]:
    """The cases of one stratum."""
    return [s for s in scores if s.solution.stratum == stratum]


def _detection(scores: Sequence[Score]) -> list[Figure]:
    hidden, own = [s for s in scores if s.solution.concealed], of_stratum(scores, CONCEALED)
    return [
        share("false alarms, null and decoys", of_stratum(scores, NULL), lambda s: s.detected, at_most(0.03)),
        share("concealed in any stratum: detected and named", hidden, lambda s: s.detected and s.named),
        share("concealed stratum: detected and named", own, lambda s: s.detected and s.named, at_least(0.9)),
        median("concealed: bias before over after, median", (s.bias_ratio for s in own), at_least(5.0)),
    ]


def _names(scores: Sequence[Score]) -> list[Figure]:
    some, pairs = clear(scores), of_stratum(scores, TWO)
    both = [s for s in pairs if s.factor >= CLEAR * ROUNDING]
    return [
        share("first name right, from 3 limits on", some, lambda s: s.first, at_least(0.92)),
        share("classes hold every true effect, from 3 limits on", some, lambda s: s.named, at_least(0.95)),
        share("two effects, both from 3 limits on: exact pair", both, lambda s: s.exact, at_least(0.8)),
        share("two effects of any size: exact pair", pairs, lambda s: s.exact),
        share("all cases: confident wrong name", scores, lambda s: s.confident_wrong, at_most(0.03)),
        share("all cases: certain of a class without truth", scores, lambda s: s.wrong_class),
    ]


def _real_like(scores: Sequence[Score]) -> list[Figure]:
    own = of_stratum(scores, REAL)
    sure = [x for s in own for x in s.statements if x.probability >= SURE]
    large = [pair for s in own for pair in s.large]
    told_apart = [(hit, truth) for hit, truth in large if truth.factor_beside > 5.0]
    return [
        share(
            "real-like: names said with 0.9 or more, the very truth", sure, lambda x: x.right, at_least(0.95)
        ),
        share("real-like: the same, or as good as the truth", sure, lambda x: x.fair),
        share("real-like: effects above 5 limits, named", large, lambda pair: pair[0], at_least(0.7)),
        share("real-like: effects above 5 limits beside the others, named", told_apart, lambda pair: pair[0]),
    ]


def calibration(scores: Sequence[Score]) -> list[Figure]:
    """Whether names mean what they say, in all cases and beside a remainder."""
    out = []
    for where, some in (("", scores), (" beside a remainder", [s for s in scores if s.remainder])):
        said = [s.statements for s in some if s.statements]
        bins = reliability([x for own in said for x in own])
        holding = sum(b.holds for b in bins)
        out.append(
            counted(
                f"names{where}: tenths whose interval holds what was said", holding, len(bins), at_least(1.0)
            )
        )
        name = f"names{where}: expected calibration error"
        out.append(bootstrapped(name, said, error_of_cases, at_most(0.04)))
    return out


def _outside(scores: Sequence[Score]) -> list[Figure]:
    own = of_stratum(scores, OUTSIDE)
    ratios = [s.empirical_ratio for s in own]
    return [
        share("out of library: confident wrong name", own, lambda s: s.confident_wrong, at_most(0.03)),
        share("out of library: unknown, or as good a name first", own, lambda s: bool(s.abstained)),
        share("out of library, lenient: unknown or honest", own, lambda s: bool(s.honest)),
        quantile(
            "out of library: held-out error over the best empirical model's, median",
            [math.inf if r is None else r for r in ratios],
            0.5,
            at_most(1.1),
        ),
    ]


def _predictions(scores: Sequence[Score]) -> list[Figure]:
    told = [s for s in scores if s.solution.truths and s.solution.oracle and s.solution.oracle.held_out]
    ratios = [math.inf if s.held_out_ratio is None else s.held_out_ratio for s in told]
    spread = [s for s in scores if s.predicted.n]
    n, inside = sum(s.predicted.n for s in spread), sum(s.predicted.inside for s in spread)
    return [
        quantile("held-out error over the oracle's, median", ratios, 0.5, at_most(1.15)),
        quantile("held-out error over the oracle's, 90 % of cases below", ratios, 0.9, at_most(2.5)),
        bootstrapped("held-out predictions: rms of error over .std", spread, _rms, between(0.8, 1.3)),
        median("held-out predictions: the same in the median case", (_rms([s]) for s in spread)),
        bootstrapped(
            "held-out predictions: inside 1.96 .std",
            spread,
            _inside,
            between(0.9, 0.98),
            as_share=True,
            hits=inside,
            n=n,
        ),
    ]


def _tool(scores: Sequence[Score]) -> list[Figure]:
    known = [(s.pose_ratio, bool(s.solution.truths)) for s in scores if s.pose_ratio is not None]
    name = "tool pose on fresh poses, improved over plain"
    models = [s for s in scores if s.predicted.unphysical is not None]
    return [
        median(f"{name}, median", (ratio for ratio, truths in known if truths), at_most(0.5)),
        share(f"{name}, cases above 1.02", known, lambda case: case[0] > WORSE, at_most(0.0)),
        share(
            "signs or bounds broken in improved.yaml",
            models,
            lambda s: bool(s.predicted.unphysical),
            at_most(0.0),
        ),
    ]


def _rms(scores: Sequence[Score]) -> float:
    squares = sum(s.predicted.squares for s in scores)
    return float(np.sqrt(squares / sum(s.predicted.n for s in scores)))


def _inside(scores: Sequence[Score]) -> float:
    return sum(s.predicted.inside for s in scores) / sum(s.predicted.n for s in scores)


def _rows(scores: Sequence[Score]) -> list[Figure]:
    judged = [s.rows for s in scores]
    quiet = [r for r in judged if not r.wild and r.calm]
    return [
        counted(
            "rows set aside, of those that are not wild",
            sum(r.false for r in judged),
            sum(r.calm for r in judged),
        ),
        counted(
            "rows kept, of those that are wild", sum(r.kept for r in judged), sum(r.wild for r in judged)
        ),
        share("cases without wild rows: rows set aside all the same", quiet, lambda r: r.invented),
    ]


__all__ = ["calibration", "clear", "headline", "of_stratum"]
