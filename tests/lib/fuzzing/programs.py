"""Mutation of text that is neither a table nor YAML: robot programs and trackers' lists, by words and lines."""

from __future__ import annotations

import re
from random import Random

from fuzzing import texts

_NUMBER = re.compile(r"[-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?")
_SIGN = re.compile(r"[^\w\s]")


def mutated(rng: Random, seed: str) -> str:
    """A text with one flaw or some."""
    out = seed
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        out = _flawed(rng, out)
    return out


def _flawed(rng: Random, seed: str) -> str:
    kind = rng.randrange(6)
    if kind <= 2:
        found = list((_NUMBER if kind <= 1 else _SIGN).finditer(seed))
        if not found:
            return seed + texts.number(rng)
        one = rng.choice(found)
        new = (
            texts.number(rng)
            if kind <= 1
            else rng.choice(("", ",", "[", "]", "{", "}", "(", ")", ":", ";", '"', "!", one[0] * 40))
        )
        return seed[: one.start()] + new + seed[one.end() :]
    lines = seed.splitlines(keepends=True)
    k = rng.randrange(len(lines))
    if kind == 3:
        del lines[k]
    elif kind == 4:
        lines[k:k] = [lines[k]] * rng.choice((1, 2, 500))
    else:
        other = rng.randrange(len(lines))
        lines[k], lines[other] = lines[other], lines[k].strip() + rng.choice((" ", "\n", "!", ";", "\t"))
    return "".join(lines) or "\n"


__all__ = ["mutated"]
