"""Texts with numbers in them, where another processor or BLAS may flip the last written digit."""

from __future__ import annotations

import re
from decimal import Decimal

_NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")


def assert_same_to_the_last_digit(made: str, kept: str) -> None:
    """The same words around as many numbers, each the same but for a unit of its last written digit."""
    assert _NUMBER.sub("#", made) == _NUMBER.sub("#", kept)
    for one, two in zip(_NUMBER.findall(made), _NUMBER.findall(kept), strict=True):
        last = min(Decimal(1).scaleb(int(Decimal(v).as_tuple().exponent)) for v in (one, two))
        assert abs(Decimal(one) - Decimal(two)) <= last
