"""What a recording could not speak of, in words: what stays possible, and what would make it testable."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from truepose.identification.signatures.untestable import Missing, Untestable
from truepose.wording import joined

ONE_SESSION = "the recording holds one session only"
"""Why effects between sessions cannot be tested: nothing is amiss."""
NOTHING = ("nothing to vary",)
SHOWN = 4
"""Most reasons that are told."""


Names = Callable[[str], str]
"""How an effect is called by its slug."""


def missing_words(missing: Sequence[Missing], named: Names = str) -> list[str]:
    """``joint-compliance and link-bending: no `gravity:` in kr6.yaml; add `gravity: [0, 0, -9.80665]` ``, a line each."""
    return [
        f"{one.what or joined([named(slug) for slug in one.effects])}: {one.why}; {one.add}"
        for one in missing
    ]


def untestable_lines(
    untestable: Sequence[Untestable], told: Sequence[Missing] = (), named: Names = str
) -> list[str]:
    """Effects that could not be tested by the reason why, those that a line or a column would change first; without those
    that were ``told`` of already."""
    known = {slug for one in told for slug in one.effects}
    groups: dict[str, list[str]] = {}
    for one in untestable:
        reason = _reason(one.why)
        if reason not in (ONE_SESSION, *NOTHING) and one.effect not in known:
            groups.setdefault(reason, []).append(one.effect)
    ranked = sorted(groups.items(), key=lambda item: "`" not in item[0])
    return [f"{joined([named(slug) for slug in slugs])}: {reason}" for reason, slugs in ranked[:SHOWN]]


def _reason(why: str) -> str:
    """The first of several reasons, without the place that it is of: others are alike."""
    first = why.split("; ", maxsplit=1)[0] if "`" not in why else why
    head, _, rest = first.partition(": ")
    return rest if rest and " " not in head else first


__all__ = ["missing_words", "untestable_lines"]
