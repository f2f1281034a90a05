"""Which case is of which stratum, at which machine: the same for any number of cases that begin alike.

The order says nothing to the engine, which sees a case in a folder without a number.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

NULL, SINGLE, CONCEALED = "null", "single", "concealed"
LOOK_ALIKE, TWO, OUTSIDE, REAL = "look-alike", "two", "out-of-library", "real-like"
SHARES = {NULL: 70, SINGLE: 50, CONCEALED: 30, LOOK_ALIKE: 20, TWO: 50, OUTSIDE: 100, REAL: 80}
"""Cases of each stratum among 400."""
CLEAN, INERT, TAILS = "clean", "inert drivers", "heavy tails"
SIGMA, TOLERANCES = "wrong sigma", "understated tolerances"
PERFECT, MISSTATED = "", "misstated, wild rows"
HALF = (PERFECT, MISSTATED)
"""On a machine that is perfect otherwise, and with sigma, tolerances and rows that are not as the drawing says."""
VARIANTS = {
    NULL: (CLEAN, INERT, TAILS, CLEAN, SIGMA, TOLERANCES, MISSTATED),
    SINGLE: HALF,
    CONCEALED: HALF,
    LOOK_ALIKE: HALF,
    TWO: HALF,
    OUTSIDE: HALF,
    REAL: (MISSTATED,),
}


@dataclass(frozen=True)
class Seat:
    """The place of a case: its number from 1, stratum, variant and machine."""

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
        round_, place = divmod(seen[chosen], len(machines))
        seen[chosen] += 1
        # a further step each round, so that machines and variants meet in every combination
        variant = VARIANTS[chosen][(place + round_) % len(VARIANTS[chosen])]
        machine = machines[(place + list(SHARES).index(chosen)) % len(machines)]
        out.append(Seat(index, chosen, variant, machine))
    return tuple(out)


__all__ = ["SHARES", "VARIANTS", "Seat", "schedule"]
