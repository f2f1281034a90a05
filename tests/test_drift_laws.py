"""When a movement between sessions is believed."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from truepose.identification.drift.movement_evidence import Stack, solve, weigh
from truepose.identification.drift.movement_selection import Candidate, select
from truepose.identification.selection.scales import Point


def test_a_movement_is_believed_from_a_probability_of_095() -> None:
    """One parameter that may move, or not, as likely as each other: its log Bayes factor is its log odds."""
    rng = np.random.default_rng(1)
    rows = 30
    jacobian = rng.standard_normal((2, rows, 1))
    points, only = [Point(1.0, (1.0,), 0.0)], Candidate("q1.d", (0,), False)
    believed: list[float] = []
    doubted: list[float] = []
    for size in np.linspace(0.0, 1.5, 61):
        apart = np.array([-size / 2, size / 2])[:, None] * jacobian[:, :, 0]
        stack = Stack(jacobian, apart, 2 * rows, np.ones(1), np.zeros(1, dtype=bool))
        gain = float(weigh(stack, [solve(stack, {}, points[0])], [(0,)]).gain[0])
        found = select(stack, [only], points)
        (believed if found.accepted else doubted).append(float(expit(gain)))
    assert max(doubted) < 0.96 and min(believed) > 0.94
    assert max(doubted) > 0.8 and min(believed) < 0.99  # near enough to the limit to tell
