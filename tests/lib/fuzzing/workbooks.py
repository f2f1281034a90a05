"""Mutation of workbooks: a part of the zip with a flaw in its XML, parts gone or doubled, then plain bytes."""

from __future__ import annotations

import io
import zipfile
from random import Random

from fuzzing import marked_up, texts


def mutated(rng: Random, seed: bytes, other: bytes) -> bytes:
    """A workbook with one flaw or two."""
    if rng.random() < 0.3:
        return texts.mutated(rng, seed, other)
    with zipfile.ZipFile(io.BytesIO(seed)) as book:
        parts = [(name, book.read(name)) for name in book.namelist()]
    for _ in range(rng.choice((1, 1, 2))):
        parts = _flawed(rng, parts)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as book:
        for name, data in dict(parts).items():
            book.writestr(name, data)
    return out.getvalue()


def _flawed(rng: Random, parts: list[tuple[str, bytes]]) -> list[tuple[str, bytes]]:
    k = rng.randrange(len(parts))
    name, data = parts[k]
    kind = rng.randrange(5)
    if kind == 0:
        new = []
    elif kind == 1:
        new = [(name, rng.choice(parts)[1])]
    elif kind == 2:
        new = [(name, texts.mutated(rng, data, data))]
    else:
        text = marked_up.mutated(rng, data.decode("utf-8", errors="replace"))
        new = [(name, text.encode("utf-8", errors="surrogatepass"))]
    return [*parts[:k], *new, *parts[k + 1 :]] or parts


__all__ = ["mutated"]
