"""Blocks of C statements that differ by the places of what they read alone, as one loop."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import groupby

_PLACE = re.compile(r"\bp\[(\d+)\]")
_STEP = re.compile(r"\bk \+ (\d+)")


def rolled(blocks: Sequence[Sequence[str]]) -> list[str]:
    """Lines of the blocks, one after the other; neighbours that are alike become a loop.

    Alike are blocks that read other entries of p, each as far from its first one, and fill k + N, N being evenly spaced.
    """
    out: list[str] = []
    for group in _alike(blocks):
        out += _loop(group) if len(group) > 1 else group[0]
    return out


def _alike(blocks: Sequence[Sequence[str]]) -> Iterator[list[Sequence[str]]]:
    for _, group in groupby(blocks, key=_form):
        yield list(group)


def _first(block: Sequence[str]) -> int:
    return min((int(place) for line in block for place in _PLACE.findall(line)), default=0)


def _filled(block: Sequence[str]) -> int:
    return next(int(place) for line in block for place in _STEP.findall(line))


def _form(block: Sequence[str]) -> tuple[str, ...]:
    """The block by places beside its first one."""
    first = _first(block)
    beside = [_PLACE.sub(lambda found: f"a[{int(found.group(1)) - first}]", line) for line in block]
    return tuple(_STEP.sub("k + N", line) for line in beside)


def _loop(group: Sequence[Sequence[str]]) -> list[str]:
    firsts = [_first(block) for block in group]
    start, step = _filled(group[0]), _filled(group[1]) - _filled(group[0])
    inside = [line.replace("k + N", f"k + {start} + {step} * i") for line in _form(group[0])[1:-1]]
    count, reads = len(group), any("a[" in line for line in inside)
    table = f"    static const unsigned short first[{count}] = {{ {', '.join(map(str, firsts))} }};"
    return [
        "{",
        *([table] if reads else []),
        "    int i;",
        f"    for (i = 0; i < {count}; ++i) {{",
        *(["        const real *a = p + first[i];"] if reads else []),
        *(f"    {line}" for line in inside),
        "    }",
        "}",
    ]
