"""Mutation of XML (URDF, MJCF, xacro) by its structure: attributes, elements, entities."""

from __future__ import annotations

import re
from random import Random

from fuzzing import texts

_ATTRIBUTE = re.compile(r'([A-Za-z_:]+)="([^"]*)"')
_ELEMENT = re.compile(r"<([A-Za-z]+)\b[^<>]*?(?:/>|>)", re.DOTALL)
PIECES = (
    '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>', "<!-- -- -->", "<![CDATA[x]]>",
    '<?xml version="1.0" encoding="utf-16"?>', '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>', "&e;", "&#0;",
    "<a>" * 2000,
    '<include file="/dev/zero"/>', '<xacro:include filename="x"/>', "&lt;", "<mimic/>", '<limit lower="1" upper="-1"/>',
)  # fmt: skip
VALUES = (
    "", " ", "x", "0 0 0", "0 0", "1 0 0", "nan nan nan", "1e-300 0 0", "1e300 0 0", "inf 0 0", "0 0 0 0", "-1",
    "1e999", "revolute",
    "continuous", "floating", "planar", "fixed", "prismatic", "mimic", "base", "world", "../x.xml",
    "file:///etc/passwd", "\u202e",
    "9" * 400, "1" * 3000, "hinge", "slide", "ball", "free",
)  # fmt: skip


def mutated(rng: Random, seed: str) -> str:
    """A document with one flaw or some."""
    out = seed
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        out = _flawed(rng, out)
    return out


def _flawed(rng: Random, seed: str) -> str:
    kind = rng.randrange(7)
    if kind <= 2:
        return _attribute(rng, seed, kind)
    elements = list(_ELEMENT.finditer(seed))
    if not elements:
        return seed + rng.choice(PIECES)
    one, other = rng.choice(elements), rng.choice(elements)
    if kind == 3:
        return seed[: one.start()] + seed[one.end() :]
    if kind == 4:
        return seed[: one.start()] + one[0] * rng.choice((2, 3, 400)) + seed[one.end() :]
    if kind == 5:
        return seed[: one.start()] + other[0] + seed[one.end() :]
    return seed[: one.start()] + rng.choice(PIECES) + seed[one.start() :]


def _attribute(rng: Random, seed: str, kind: int) -> str:
    found = list(_ATTRIBUTE.finditer(seed))
    if not found:
        return seed
    one = rng.choice(found)
    if kind == 0:
        own = one[2].split()
        if own:
            own[rng.randrange(len(own))] = texts.number(rng)
        value = " ".join(own)
    else:
        value = rng.choice(VALUES) if kind == 1 else rng.choice(found)[2]
    name = one[1] if rng.random() < 0.9 else rng.choice(("name", "link", "x", "type", "lower"))
    return seed[: one.start()] + f'{name}="{value}"' + seed[one.end() :]


__all__ = ["mutated"]
