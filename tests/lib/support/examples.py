"""How many examples a law is tried on."""

from __future__ import annotations

import os

TIMES = int(os.environ.get("TRUEPOSE_EXAMPLES", "1"))


def examples(usual: int) -> int:
    """So many times more than usual as ``TRUEPOSE_EXAMPLES`` says (.ci/nightly does)."""
    return TIMES * usual
