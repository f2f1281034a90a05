"""Work that evidences took, counted in operations: a search that ends by it does the same steps on every processor."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.identification.posterior.terms import SameSize

CALL, DENSE, SMALL = 1e5, 0.04, 3.0
"""What counts for one: a call with what is around it, a multiplication among large matrices, one among many small ones.
In nanoseconds of a processor of 2023, about."""


class Work:
    """Operations that were done."""

    def __init__(self) -> None:
        self.done = 0.0

    def count_taken(self, columns: int, width: int) -> None:
        """Add what it takes to take in some columns beside ``width`` others."""
        self.done += CALL + DENSE * columns**2 * (columns / 3.0 + width)

    def count_left(self, columns: int, taken: int, width: int) -> None:
        """Add what it takes to leave some of the columns out again that were taken in beside ``width`` others."""
        self.done += CALL + DENSE * columns * taken * (columns + width)

    def count_weighed(self, groups: Sequence[SameSize], sizes: int) -> None:
        """Add what it takes to weigh all terms at all sizes."""
        for group in groups:
            count, k = group.columns.shape
            self.done += CALL + count * k**2 * sizes * (SMALL + DENSE * k)
