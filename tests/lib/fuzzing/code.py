"""Mutation of a plug-in: what its functions return, what it runs, and how it is written."""

from __future__ import annotations

import re
from random import Random

from fuzzing import texts

_RETURN = re.compile(r"^( +)return (.+)$", re.MULTILINE)
INSTEAD = (
    "return None", "return float('nan')", "return {}", "return []", "return 'x'", "return object()", "return ((),)",
    "return {1: 2}",
    "raise ValueError('it broke')", "raise KeyError('x')", "raise RuntimeError('two\\nlines')", "raise SystemExit(0)", "1 / 0",
    "import sys; sys.exit(7)", "raise EOFError", "raise BaseException('x')", "return (lambda: 0)",
    "return [0.0] * 100000",
    "return {'nonsense': 1}", "assert False", "raise StopIteration", "raise MemoryError", "return return",
)  # fmt: skip


def mutated(rng: Random, seed: str) -> bytes:
    """A plug-in with one flaw or two."""
    out = seed
    for _ in range(rng.choice((1, 1, 2))):
        if rng.random() < 0.6:
            found = list(_RETURN.finditer(out))
            if found:
                one = rng.choice(found)
                out = out[: one.start()] + one[1] + rng.choice(INSTEAD) + out[one.end() :]
        elif rng.random() < 0.3:
            out += "\n" + rng.choice(INSTEAD).replace("return ", "x = ") + "\n"
        else:
            return texts.mutated(rng, out.encode(), out.encode())
    return out.encode()


__all__ = ["mutated"]
