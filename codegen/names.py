"""Names in the generated C: identifiers of parameters and drivers."""

from __future__ import annotations

import re
from collections.abc import Sequence


def identifiers(names: Sequence[str]) -> list[str]:
    """Tails of C identifiers: other characters become underscores; what then collides gets _2, _3 ..."""
    taken: set[str] = set()
    out = []
    plain = [re.sub(r"[^A-Za-z0-9_]", "_", name) for name in names]
    for name in plain:
        candidate, count = name, 1
        while candidate in taken or (count > 1 and candidate in plain):
            count += 1
            candidate = f"{name}_{count}"
        taken.add(candidate)
        out.append(candidate)
    return out
