"""How many examples a law is tried on, which cases are left to the night, and how many rows of a large recording."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import pytest
from hypothesis import Phase, settings

TIMES = int(os.environ.get("TRUEPOSE_EXAMPLES", "1"))
NIGHT = TIMES > 1
"""Whether all is tried of what is usually tried in part: the tests of a change must not take all night."""


def examples(usual: int) -> int:
    """A third of the usual number by day; so many times more than usual as ``TRUEPOSE_EXAMPLES`` says (.ci/nightly does)."""
    return TIMES * usual if NIGHT else -(-usual // 3)


def law(count: int = 12) -> settings:
    """Settings of a law; an example that fails is told as it is, since a smaller one takes minutes."""
    return settings(max_examples=examples(count), phases=(Phase.explicit, Phase.generate))


def by_day(cases: Iterable[Any], *first: Any) -> list[Any]:
    """Return the cases for ``parametrize``; those that are not among the ``first`` are nightly."""
    return [case if any(case is one or case == one for one in first) else _nightly(case) for case in cases]


def _nightly(case: Any) -> Any:
    values = case if isinstance(case, tuple) else (case,)
    return pytest.param(*values, marks=pytest.mark.nightly)


def one_in(usual: int) -> int:
    """One of so many rows is usually taken; at night, every row."""
    return 1 if NIGHT else usual
