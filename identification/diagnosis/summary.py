"""What the posterior says, in one place: findings, what leads, sets, inclusion, and the verdict read it here.

Nothing that is told is worked out anywhere else, so no number is told twice with two values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from truepose.identification.diagnosis.inclusion import Inclusion, inclusion
from truepose.identification.diagnosis.judgement import Judgement
from truepose.identification.diagnosis.levels import driver_of, parts_of
from truepose.identification.diagnosis.naming import LEADING, NAMED, Named, as_named, named
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.untested import beside_untested, without_untested
from truepose.identification.fit.estimate import Estimate

SURE = 0.9
"""Probability from which on something without a name is said to be there."""


@dataclass(frozen=True)
class Summary:
    """names: what is more probable than not, at the level at which it is known, the best supported first; leading: what is
    less probable, but leads; inclusion: every effect at every place with the probability of its law, and the sets."""

    names: tuple[Named, ...]
    leading: tuple[Named, ...]
    inclusion: Inclusion

    @property
    def laws(self) -> tuple[Named, ...]:
        """Findings with a name."""
        return tuple(n for n in self.names if not n.nameless)


def summarised(found: Found, fit: Estimate) -> Summary:
    """Of a posterior; terms that the likeliest ``fit`` does not hold (bounds left nothing of them) are not told."""
    said = inclusion(found.problem, found.posterior)
    cat = found.catalogue
    held = {effect.label for effect in fit.effects}
    kept = [
        (n, tuple(i for i in n.candidates if cat.candidates[i].label in held)) for n in named(found, said)
    ]
    every = beside_untested(found, [replace(n, candidates=own) for n, own in kept if own])
    shown = without_untested(found, every)
    names = _told(found, [n for n in shown if n.said])
    rest = [n for n in shown if n not in names and max(n.levels.driver, n.certainty) >= LEADING]
    return Summary(names, tuple(rest), as_named(said, every))


def _told(found: Found, names: Sequence[Named]) -> tuple[Named, ...]:
    """Each part and driver once: by the name that is surest there, and by others that are more probable than not."""
    machine, spoken, out = found.signatures.machine, set[tuple[str, str]](), list[Named]()
    for one in sorted(names, key=lambda n: -n.probability):
        parts = parts_of(machine, one.cause.effect, one.cause.place)
        keys = {(part, driver_of(one.levels.kind)) for part in parts}
        if one.certainty >= NAMED or not keys <= spoken:
            out.append(one)
            spoken |= keys
    return tuple(one for one in names if one in out)


def verdict(summary: Summary, raised: Judgement) -> str:
    """``missing-physics`` where a place with its driver, or a class of names, is known; ``unknown`` where neither is and
    something is surely there, or noise alone cannot make the misfit."""
    if summary.names:
        return "missing-physics"
    return "unknown" if summary.inclusion.nameless > SURE or raised.misfits else "adequate"


__all__ = ["SURE", "Summary", "summarised", "verdict"]
