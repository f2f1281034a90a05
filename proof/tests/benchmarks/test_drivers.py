"""Heat by finite volumes, which is no first-order lag, is found by a diagnosis."""

from __future__ import annotations

import pytest
from drivers.study import heated


@pytest.mark.parametrize("seed", [2, 3])
def test_a_part_beside_anothers_thermometer_is_named(seed: int) -> None:
    """A link of an arm, and a leg of a hexapod."""
    judged = heated(seed)
    assert judged.place and judged.law, judged.said
