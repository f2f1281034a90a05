"""The figures by stratum, machine and effect: what has no target of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from challenge.calibration import honest_error
from challenge.figures import Figure, Test, median, share
from challenge.headline import ROUNDING, clear, of_stratum
from challenge.schedule import CONCEALED, LOOK_ALIKE, NULL, OUTSIDE, PERFECT, REAL, SINGLE, TWO
from challenge.score import Score
from challenge.strata import CLEAR


def details(scores: Sequence[Score]) -> tuple[Figure, ...]:
    """Each stratum; whether a drawing that is wrong itself makes a difference; flags and nulls."""
    null = of_stratum(scores, NULL)
    out = [
        share(
            f"false alarm: {variant}",
            [s for s in null if s.solution.variant == variant],
            lambda s: s.detected,
        )
        for variant in dict.fromkeys(s.solution.variant for s in null)
    ]
    for stratum in (SINGLE, CONCEALED, LOOK_ALIKE, TWO, OUTSIDE):
        own = of_stratum(scores, stratum)
        large = [s for s in own if s.factor >= CLEAR * ROUNDING]
        faint = [s for s in own if s.factor < CLEAR * ROUNDING]
        for size, some in (("", large), (" (below 3 limits)", faint)):
            if some:
                out += _of_stratum(stratum + size, stratum, some)
    some = clear(scores)
    for what, group in (
        ("on a machine that is perfect otherwise", [s for s in some if s.solution.variant == PERFECT]),
        ("with sigma, tolerances and rows wrong", [s for s in some if s.solution.variant != PERFECT]),
    ):
        out.append(share(f"from 3 limits on, {what}: first name right", group, lambda s: s.first))
        out.append(share(f"from 3 limits on, {what}: exact", group, lambda s: s.exact))
    flagged = [s for s in scores if s.flag is not None]
    out.append(share("concealed said rightly, where detected", flagged, lambda s: bool(s.flag)))
    out.append(share("top effect, from 3 limits on", some, lambda s: s.top_effect))
    out.append(share("top place, from 3 limits on", some, lambda s: s.top_place))
    quiet = [s.held_out_ratio for s in null]
    out.append(median("null: held-out error over that of the fit without effects, median", quiet))
    return (*out, *_by_chance(scores))


def _by_chance(scores: Sequence[Score]) -> list[Figure]:
    """What honest probabilities would show of a calibration error, for comparison with the headline's."""
    out = []
    for where, some in (("", scores), (" beside a remainder", [s for s in scores if s.remainder])):
        said = [x for s in some for x in s.statements]
        name = f"names{where}: calibration error that honest ones would show by chance"
        out.append(Figure(name, len(said), 0, honest_error(said), None, None, share=False))
    return out


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
    """Detected, named, top effect, top place and exact of cases with one or two of the library's effects, by machine or
    by effect."""
    groups: dict[str, list[Score]] = {}
    for s in scores:
        if s.solution.stratum not in (NULL, OUTSIDE, REAL):
            for name in key(s):
                groups.setdefault(name, []).append(s)
    return {name: tuple(_of_stratum("", "", some)) for name, some in sorted(groups.items())}


def named_at_once(scores: Sequence[Score]) -> dict[str, Figure]:
    """Effects above 5 limits of the real-like cases that were named, by effect; members of a family apart."""
    groups: dict[str, list[bool]] = {}
    for s in of_stratum(scores, REAL):
        for hit, truth in s.large:
            groups.setdefault(truth.effect + (" (family)" if truth.family else ""), []).append(hit)
    return {name: share(name, hits, bool) for name, hits in sorted(groups.items())}


__all__ = ["details", "grouped", "named_at_once"]
