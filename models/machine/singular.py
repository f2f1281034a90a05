"""How far a joint may move for a small turn of the tool, next to a pose where it turns the tool no longer."""

from __future__ import annotations

from typing import Final

CALM: Final = 0.2
"""Turn of the tool by a turn of a joint, about rad a rad, from which no pose counts as next to a singular one."""
FARTHEST: Final = 0.05
"""rad that a joint may move for a turn that it makes slowly."""
NOTHING: Final = 5e-10
"""rad; a turn below this is met as it is."""
