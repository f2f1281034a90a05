"""What came of one pair: whether it was off, what ``check`` said, and whether its advice was right."""

from __future__ import annotations

from dataclasses import dataclass

RIGHT, REAL = "right pairs", "recordings of others"


@dataclass(frozen=True)
class Outcome:
    """One pair.

    state: ``right`` (nothing done to it, or nothing that a frame or a tolerance does not take up), ``off``, or ``between``
    (worse than the right pair, no worse than physics or the drawing could make it). verdict: of ``check``, ``refused`` where
    it ended in an error. advice: ``right``, ``wrong``, or ``none``.
    """

    name: str
    kind: str
    source: str
    variant: str
    state: str
    verdict: str
    advice: str
    said: str
    seconds: float
    worst: float
    times: float

    @property
    def is_blamed(self) -> bool:
        """Whether what can be right was called wrong."""
        return self.state == "right" and self.verdict in ("wrong", "refused")

    @property
    def is_passed(self) -> bool:
        """Whether what is off was called ok."""
        return self.state == "off" and self.verdict == "ok"

    @property
    def is_misled(self) -> bool:
        """Whether what is not right was answered by wrong advice that is said to be certain."""
        return self.state != "right" and self.advice == "wrong"

    @property
    def breaks_the_law(self) -> bool:
        """Whether it is one of the three."""
        return self.is_blamed or self.is_passed or self.is_misled


__all__ = ["REAL", "RIGHT", "Outcome"]
