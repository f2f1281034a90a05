"""Classes of parts whose tolerances were stated together, and may be wrong together.

A class is written ``kind:class``: ``length:leg.a`` are all lower joint centres of legs, ``angle:q`` all angles of a
chain's joints. What is wrong for one part of a class is wrong for all of it; all classes of a kind may be
wrong alike (one drawing, one optimist), or one of them alone.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence

INFLATED = ("length", "angle")
"""Kinds whose classes are told apart; all others (frames, sensors, targets) are one class each, ``kind:``."""
ALONE = (*INFLATED, "frame")
"""Kinds that may be misstated alone; gains, sensors and targets come with instruments, each with a paper of its own."""
INFLATIONS = (1.0, 2.0, 4.0)
FEW = 4
"""Parameters that a class needs to stand on its own; smaller ones share the rest of their kind."""
_GROUPS = ("a", "b", "u", "length", "offset", "gain")
_ELEMENT = re.compile(r"^(?P<element>.*?)\d*\.(?P<rest>.+)$")


def part_classes(names: Sequence[str], kinds: Sequence[str]) -> tuple[str, ...]:
    """Class of every parameter."""
    raw = [
        f"{kind}:{_group(name) if kind in INFLATED else ''}" for name, kind in zip(names, kinds, strict=True)
    ]
    count = Counter(raw)
    return tuple(f"{kind}:" if count[label] < FEW else label for label, kind in zip(raw, kinds, strict=True))


def _group(name: str) -> str:
    """``leg3.a.x``: leg.a; ``q4.beta``: q."""
    match = _ELEMENT.match(name)
    if match is None:
        return name
    head = match["rest"].split(".")[0]
    return f"{match['element']}.{head}" if head in _GROUPS else match["element"]


def kind_of(label: str) -> str:
    """``length`` or ``angle`` of a class."""
    return label.partition(":")[0]


def inflations(classes: Sequence[str]) -> tuple[tuple[float, ...], ...]:
    """Inflations of the classes to weigh: lengths and angles, everything at once, and each class of ``ALONE`` alone."""
    kinds = [kind for kind in INFLATED if any(kind_of(c) == kind for c in classes)]
    out = []
    for factors in itertools.product(INFLATIONS, repeat=len(kinds)):
        of = dict(zip(kinds, factors, strict=True))
        out.append(tuple(of.get(kind_of(c), 1.0) for c in classes))
    for factor in INFLATIONS[1:]:
        out.append((factor,) * len(classes))
        alone = [k for k, c in enumerate(classes) if kind_of(c) in ALONE]
        out += [tuple(factor if j == k else 1.0 for j in range(len(classes))) for k in alone]
    return tuple(dict.fromkeys(out))
