"""What an alarm is: a statistic, judged by what chance makes of it."""

from __future__ import annotations

from dataclasses import dataclass

RAISED = 0.01
"""p below which an alarm is raised."""


@dataclass(frozen=True)
class Alarm:
    """A statistic, its p-value when nothing is missing, what it is about, and the share of the residual that this explains."""

    statistic: float
    p: float
    about: str = ""
    share: float = 0.0

    @property
    def raised(self) -> bool:
        """p below 1 %."""
        return self.p < RAISED
