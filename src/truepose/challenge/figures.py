"""The figures of an examination, each with its uncertainty and, where one is set, its target."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.challenge.calibration import wilson
from truepose.challenge.schedule import CONCEALED, LOOK_ALIKE, NULL, OUTSIDE, SINGLE, TWO
from truepose.challenge.score import Score
from truepose.challenge.strata import CLEAR

Array = NDArray[np.float64]
Test = Callable[[Score], bool]
DRAWS = 4000


@dataclass(frozen=True)
class Target:
    """What is to be reached: at least, or at most, a value."""

    value: float
    least: bool

    def met(self, value: float) -> bool:
        """Whether a value reaches it."""
        return value >= self.value if self.least else value <= self.value


@dataclass(frozen=True)
class Figure:
    """A share with its Wilson interval (``share``), or a median with its bootstrap interval; n cases."""

    name: str
    n: int
    hits: int
    value: float | None
    interval: tuple[float, float] | None
    target: Target | None
    share: bool = True

    @property
    def met(self) -> bool | None:
        """Whether the target is reached; None without one, or without a case."""
        return None if self.target is None or self.value is None else self.target.met(self.value)


def share(name: str, scores: Iterable[Score], test: Test, target: Target | None = None) -> Figure:
    """How often something holds."""
    answers = [bool(test(s)) for s in scores]
    n, hits = len(answers), sum(answers)
    return Figure(name, n, hits, hits / n if n else None, wilson(hits, n) if n else None, target)


def median(name: str, values: Iterable[float | None], target: Target | None = None) -> Figure:
    """The middle value of those that there are; 95 % by bootstrap over cases."""
    known = np.array([v for v in values if v is not None and np.isfinite(v)], dtype=float)
    if not len(known):
        return Figure(name, 0, 0, None, None, target, share=False)
    picks = np.random.default_rng(1).integers(0, len(known), (DRAWS, len(known)))
    ends = np.quantile(np.median(known[picks], axis=1), [0.025, 0.975])
    middle = float(np.median(known))
    return Figure(name, len(known), 0, middle, (float(ends[0]), float(ends[1])), target, share=False)


def at_least(value: float) -> Target:
    """A lower end."""
    return Target(value, True)


def at_most(value: float) -> Target:
    """An upper end."""
    return Target(value, False)


def headline(scores: Sequence[Score]) -> tuple[Figure, ...]:
    """What the examination is for: the figures with targets."""
    of = {s: [x for x in scores if x.solution.stratum == s] for s in (NULL, CONCEALED, TWO, OUTSIDE)}
    clear = [s for s in scores if s.solution.stratum not in (NULL, OUTSIDE) and s.factor >= CLEAR * 0.999]
    told = [s for s in scores if s.solution.truths and s.held_out_ratio is not None]
    return (
        share("false alarms, null and decoys", of[NULL], lambda s: s.detected, at_most(0.05)),
        share(
            "concealed: detected and named", of[CONCEALED], lambda s: s.detected and s.named, at_least(0.9)
        ),
        share("top effect, from 3 limits on", clear, lambda s: s.top_effect, at_least(0.9)),
        share("top place, from 3 limits on", clear, lambda s: s.top_place, at_least(0.9)),
        share("two effects: exact pair", of[TWO], lambda s: s.exact, at_least(0.8)),
        share("out of library: unknown or honest", of[OUTSIDE], lambda s: bool(s.honest), at_least(0.8)),
        share("out of library: unknown, or as good a name first", of[OUTSIDE], lambda s: bool(s.abstained)),
        share(
            "out of library: confident wrong name", of[OUTSIDE], lambda s: s.confident_wrong, at_most(0.03)
        ),
        share("all cases: confident wrong name", scores, lambda s: s.confident_wrong, at_most(0.03)),
        share("all cases: certain of a class without truth", scores, lambda s: s.wrong_class),
        median("held-out error over the oracle's, median", (s.held_out_ratio for s in told), at_most(1.3)),
        share("held-out error within 1.3 of the oracle's", told, lambda s: (s.held_out_ratio or 9.0) <= 1.3),
        median(
            "concealed: bias before over after, median", (s.bias_ratio for s in of[CONCEALED]), at_least(5.0)
        ),
        share("no diagnosis, or no prediction", scores, lambda s: bool(s.failure), at_most(0.0)),
    )


def details(scores: Sequence[Score]) -> tuple[Figure, ...]:
    """The same by stratum, and what has no target."""
    null = [s for s in scores if s.solution.stratum == NULL]
    out = [
        share(
            f"false alarm: {variant}",
            [s for s in null if s.solution.variant == variant],
            lambda s: s.detected,
        )
        for variant in dict.fromkeys(s.solution.variant for s in null)
    ]
    for stratum in (SINGLE, CONCEALED, LOOK_ALIKE, TWO, OUTSIDE):
        own = [s for s in scores if s.solution.stratum == stratum]
        faint, clear = (
            [s for s in own if s.factor < CLEAR * 0.999],
            [s for s in own if s.factor >= CLEAR * 0.999],
        )
        for size, some in (("", clear), (" (below 3 limits)", faint)):
            if some:
                out += _of_stratum(stratum + size, stratum, some)
    flagged = [s for s in scores if s.flag is not None]
    hidden = [s for s in scores if s.solution.concealed]
    out.append(share("concealed said rightly, where detected", flagged, lambda s: bool(s.flag)))
    out.append(
        share("concealed in any stratum: detected and named", hidden, lambda s: s.detected and s.named)
    )
    quiet = [s.held_out_ratio for s in null]
    out.append(median("null: held-out error over that of the fit without effects, median", quiet))
    return tuple(out)


def _of_stratum(name: str, stratum: str, scores: Sequence[Score]) -> list[Figure]:
    figures = [share(f"{name}: detected", scores, lambda s: s.detected)]
    if stratum != OUTSIDE:
        tests: tuple[tuple[str, Test], ...] = (
            ("named", lambda s: s.named),
            ("top effect", lambda s: s.top_effect),
            ("top place", lambda s: s.top_place),
            ("exact", lambda s: s.exact),
        )
        figures += [share(f"{name}: {what}", scores, test) for what, test in tests]
    return figures


def grouped(scores: Sequence[Score], key: Callable[[Score], Iterable[str]]) -> dict[str, tuple[Figure, ...]]:
    """Detected, named, top effect, top place and exact of the library's cases, by machine or by effect."""
    groups: dict[str, list[Score]] = {}
    for s in scores:
        if s.solution.stratum not in (NULL, OUTSIDE):
            for name in key(s):
                groups.setdefault(name, []).append(s)
    return {name: tuple(_of_stratum("", "", some)) for name, some in sorted(groups.items())}


__all__ = ["Figure", "Target", "details", "grouped", "headline", "median", "share"]
