"""Sections of sensors to start from: an instrument stands at the origin, straight, until somebody says otherwise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from truepose.models.leaves.starting.written import PRESETS

STATED = ("sigma", "tolerance", "points")
"""What an instrument is worth, and targets, which must not lie in one place."""


def numbers(value: Any) -> Iterator[float]:
    if isinstance(value, Mapping):
        value = [v for key, v in value.items() if key not in STATED]
    if isinstance(value, list):
        for one in value:
            yield from numbers(one)
    elif isinstance(value, int | float):
        yield value


@pytest.mark.parametrize("name", PRESETS)
def test_nothing_is_said_of_where_an_instrument_stands(name: str) -> None:
    assert set(numbers(PRESETS[name].section)) <= {0}


def test_targets_do_not_lie_on_one_line() -> None:
    (p1, p2, p3) = PRESETS["targets"].section["points"].values()
    turned = (p2[0] - p1[0]) * (p3[1] - p1[1]) - (p2[1] - p1[1]) * (p3[0] - p1[0])
    assert abs(turned) > 1e3  # mm^2
