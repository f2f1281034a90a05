"""The kinds of slips of this study, what each needs of a pair, and the words that tell it where no mend does."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from truepose.identification.leaves.check.result import Found

from .kinds import KINDS, Maker, Spoilt
from .pairs import Pair

PAIRED = (
    "unit-length",
    "sign",
    "permutation",
    "offset",
    "rotation-convention",
    "rows-shifted",
    "counts",
    "coupled",
)
"""Slips of which two are made at once."""


def two(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Two slips of different kinds in one pair."""
    one, other = (str(name) for name in rng.permutation(PAIRED)[:2])
    first = KINDS[one](pair, rng)
    if first is None:
        return None
    whole = len(first.table) == len(pair.table)
    tool = pair.tool if whole else None
    spoilt = replace(
        pair, document=first.document, table=first.table, files=first.files or pair.files, tool=tool
    )
    second = KINDS[other](spoilt, rng)
    if second is None:
        return None
    return replace(
        second,
        variant=f"{one} ({first.variant}), {other} ({second.variant})",
        where=(*first.where, *second.where),
        kinds=(one, other, *first.kinds, *second.kinds),
        files=second.files or first.files,
        mends=first.mends and second.mends,
        judged="fit",
    )


SLIPS: Mapping[str, Maker] = {**KINDS, "two": two}
SEVERAL = ("two", "signs")
"""Several slips in one: advice on one of them is right."""
NEEDS: Mapping[str, Mapping[str, object]] = {
    "clock": {"moving": True, "poses": 80},
    "frames-swapped": {"known": True},
    "base-missing": {"known": True},
    "tool-missing": {"known": True},
    "gravity-reversed": {"physics": 10.0, "sigma": 0.02},
}
"""Conditions without which a slip makes no sense."""
WORDS: Mapping[str, str] = {
    "order": r"permutation|order",
    "signs": r"\bsign|other way",
    "clock": r"clock|time|latency|earlier|later|early|late|slip",
    "counts": r"count|offset|unit-angle|per turn",
    "wrapped": r"wrap|360|whole turn|full turn",
    "coupled": r"coupl|\bplus\b|\bminus\b",
    "whole-degrees": r"resolution|whole deg|step",
    "stands-still": r"stands? still|never-moves|does not move|stuck|constant from",
    "rows-unit": r"rows?\b|outlier|inch|times too",
    "tool-changed": r"session|tool|from row",
    "base-moved": r"session|base|from row",
    "grams": r"mass|kg|gram",
    "gravity-reversed": r"gravity|hang|upwards",
    "sessions-mixed": r"session",
    "table-rows": r"dh-convention|row|table|permutation|order",
    "rows-shifted": r"rows-shifted|shift|sorted|order of rows",
}
"""What a finding says in which a person finds the slip, where it is not of the slip's kind."""


def is_told(found: Found, kind: str, spoilt: Spoilt) -> bool:
    """Return True if a finding is of the slip's kind, or in its words, and names one of its places."""
    text = " ".join((found.kind, *found.where, found.says, found.fix))
    of_kind = found.kind in (kind, *spoilt.kinds)
    in_words = any(re.search(WORDS[k], text, re.IGNORECASE) for k in (kind, *spoilt.kinds) if k in WORDS)
    words = set(re.split(r"[\s,:;()\[\].]+", text)) | set(found.where)
    return (of_kind or in_words) and bool(words & set(spoilt.where))


def names_no_cause(found: Found) -> bool:
    """Return True if a finding reports what does not fit and advises nothing: a misfit, a reading out of its range."""
    return found.mend is None and (
        found.kind == "unexplained" or re.search(r"range \[[^\]]*\]$", found.says) is not None
    )


__all__ = ["NEEDS", "SEVERAL", "SLIPS", "is_told", "names_no_cause"]
