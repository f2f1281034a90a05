"""What a page or a picture shows, a line an element, and what of it has changed.

Words, elements and their order are kept as they are; numbers too, but they may differ by what another processor rounds
otherwise. Of long lists of numbers (a path through all rows) the length, the sum and the sum of the sizes are kept.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
LONG = 12
"""Numbers of an attribute beyond which they are told together."""
SHARE, LAST, ROUNDING = 0.01, 1.01, 1e-9
"""How far a number may move: as a share of it, in units of its last digit, and what is nothing."""


def shown(page: str) -> list[str]:
    """Lines of what is shown: a tag or a text each, scripts and styles left out."""
    bare = re.sub(r"<(script|style)\b[^>]*>.*?</\1>", "", page, flags=re.DOTALL)
    pieces = (piece.strip() for piece in re.split(r"(<[^>]*>)", bare))
    return [re.sub(r'"([^"]*)"', _shortened, re.sub(r"\s+", " ", piece)) for piece in pieces if piece]


def _shortened(attribute: re.Match[str]) -> str:
    numbers = [float(number) for number in NUMBER.findall(attribute[1].replace("M", " ").replace("L", " "))]
    if len(numbers) <= LONG:
        return attribute[0]
    letters = "".join(sorted(set(re.sub(r"[\d.,\s-]", "", attribute[1]))))
    return f'"{letters}: {len(numbers)} numbers, {sum(numbers):.0f}, {sum(map(abs, numbers)):.0f}"'


def differences(old: list[str], new: list[str]) -> Iterator[str]:
    """A sentence on the first line that differs, and on the number of lines."""
    for n, (was, now) in enumerate(zip(old, new, strict=False), start=1):
        if not _alike(was, now):
            yield f"line {n} was {was!r} and is {now!r}"
            break
    if len(old) != len(new):
        yield f"there were {len(old)} lines and are {len(new)}"


def _alike(was: str, now: str) -> bool:
    if was == now:
        return True
    one, two = NUMBER.findall(was), NUMBER.findall(now)
    if NUMBER.sub("#", was) != NUMBER.sub("#", now):
        return False
    last = np.array([10.0 ** -len(number.partition(".")[2]) if "e" not in number else 0.0 for number in one])
    a, b = np.array(one, dtype=float), np.array(two, dtype=float)
    return bool(np.all(np.abs(a - b) <= np.maximum(SHARE * np.abs(a) + ROUNDING, LAST * last)))


def as_committed(file: Path, new: list[str], *, update: bool) -> None:
    """Fail where what is shown differs from what the file holds; with ``update`` write it there instead."""
    old = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    found = list(differences(old, new))
    if found and update:
        file.write_text("\n".join([*new, ""]), encoding="utf-8")
        return
    assert not found, f"{file.name} (pytest --update-golden, if this is meant): {found[0][:2000]}"


def lines(text: str) -> list[str]:
    """Of plain text, without spaces that only set columns apart."""
    return [re.sub(r"\s+", " ", line).strip() for line in text.splitlines()]
