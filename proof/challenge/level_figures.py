"""Figures of what was said at three levels: place, driver, law."""

from __future__ import annotations

from collections.abc import Sequence

from challenge.calibration import error_of_cases
from challenge.figures import Figure, at_least, at_most, bootstrapped, share
from challenge.schedule import OUTSIDE
from challenge.score import Score
from challenge.statements import SURE, Statement

Said = Sequence[tuple[Statement, ...]]
"""Statements by case."""


def level_figures(scores: Sequence[Score]) -> list[Figure]:
    """How often sure statements are right, how much of what is large is found, whether probabilities mean what they say."""
    places, drivers, laws = (
        [own for own in said if own]
        for said in (
            [s.levels.places for s in scores],
            [s.levels.drivers for s in scores],
            [s.levels.laws for s in scores],
        )
    )
    own = [s for s in scores if s.solution.stratum == OUTSIDE]
    return [
        share("place and driver, said with 0.9 or more, right", _sure(drivers), _right, at_least(0.95)),
        share("place, said with 0.9 or more, right", _sure(places), _right),
        share("law, said with 0.9 or more, right", _sure(laws), _right, at_least(0.95)),
        share(
            "effects above 5 limits whose place and driver are said with 0.9 or more",
            _large(scores),
            bool,
            at_least(0.8),
        ),
        share(
            "verdict unknown though place and driver are known",
            [s for s in scores if s.levels.told],
            lambda s: s.levels.withheld,
            at_most(0.0),
        ),
        bootstrapped("place: expected calibration error", places, error_of_cases, at_most(0.05)),
        bootstrapped("place and driver: expected calibration error", drivers, error_of_cases, at_most(0.05)),
        bootstrapped("law: expected calibration error", laws, error_of_cases, at_most(0.05)),
        share(
            "out of library: a wrong law with 0.9 or more", own, lambda s: s.levels.wrong_law, at_most(0.03)
        ),
    ]


def _sure(said: Said) -> list[Statement]:
    return [x for own in said for x in own if x.probability >= SURE]


def _right(statement: Statement) -> bool:
    return statement.right


def _large(scores: Sequence[Score]) -> list[bool]:
    """For each large effect whether it was found; none where no diagnosis tells levels."""
    if not any(s.levels.told for s in scores):
        return []
    return [known for s in scores if s.levels.told or not s.answered for known in s.large_known]


__all__ = ["level_figures"]
