"""How many examples a law is tried on, and how many rows of a large recording."""

from __future__ import annotations

import os

TIMES = int(os.environ.get("TRUEPOSE_EXAMPLES", "1"))
NIGHT = TIMES > 1
"""Whether all is tried of what is usually tried in part: the tests of a change must not take all night."""


def examples(usual: int) -> int:
    """So many times more than usual as ``TRUEPOSE_EXAMPLES`` says (.ci/nightly does)."""
    return TIMES * usual


def one_in(usual: int) -> int:
    """One of so many rows is usually taken; at night, every row."""
    return 1 if NIGHT else usual
