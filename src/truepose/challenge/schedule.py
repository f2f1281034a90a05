"""Which case is of which stratum, at which machine: the same for any number of cases that begin alike.

The order says nothing to the engine, which sees a case in a folder without a number.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

NULL, SINGLE, CONCEALED = "null", "single", "concealed"
LOOK_ALIKE, TWO, OUTSIDE = "look-alike", "two", "out-of-library"
SHARES = {NULL: 60, SINGLE: 40, CONCEALED: 30, LOOK_ALIKE: 20, TWO: 25, OUTSIDE: 25}
"""Cases of each stratum among 200."""
CLEAN, INERT, TAILS = "clean", "inert drivers", "heavy tails"
SIGMA, TOLERANCES = "wrong sigma", "understated tolerances"
VARIANTS = {NULL: (CLEAN, INERT, TAILS, CLEAN, SIGMA, TOLERANCES)}


@dataclass(frozen=True)
class Seat:
    """The place of a case: its number from 1, stratum, sort of null (else empty) and machine."""

    index: int
    stratum: str
    variant: str
    machine: str

    @property
    def name(self) -> str:
        """Name of the case's folder."""
        return f"case{self.index:03d}"


def schedule(n: int, machines: Sequence[str], strata: Sequence[str] = tuple(SHARES)) -> tuple[Seat, ...]:
    """The first ``n`` cases: strata in their shares at any length, machines and variants evenly within each."""
    total = sum(SHARES[s] for s in strata)
    credit = dict.fromkeys(strata, 0)
    seen: Counter[str] = Counter()
    out = []
    for index in range(1, n + 1):
        for s in strata:
            credit[s] += SHARES[s]
        chosen = max(strata, key=lambda s: credit[s])
        credit[chosen] -= total
        k = seen[chosen]
        seen[chosen] += 1
        variants = VARIANTS.get(chosen, ("",))
        # a further step each round, so that machines and variants meet in every combination
        variant = variants[(k + k // len(machines)) % len(variants)]
        machine = machines[(k + list(SHARES).index(chosen)) % len(machines)]
        out.append(Seat(index, chosen, variant, machine))
    return tuple(out)


__all__ = ["SHARES", "VARIANTS", "Seat", "schedule"]
