"""Where the evidence points: log Bayes factor of the best explanation at each place."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

import numpy as np

from truepose.identification.diagnosis.result import NOTABLE
from truepose.identification.report.numbers import known, significant
from truepose.shown.chart import Axis, Bars, Chart, Level, Tone

SHOWN = 24
_GROUPS: tuple[tuple[str, Tone, bool], ...] = (
    ("place of a finding", "before", True),
    ("other places", "free", False),
)
_TICKS = (-1000, -100, -10, -1, 0, 3, 10, 100, 1000, 10_000, 100_000, 1_000_000)


def squeeze(value: float) -> float:
    """A logarithm on either side of zero, so that 3 and 3,000 are both readable."""
    return math.copysign(math.log10(1.0 + abs(value)), value)


def evidence_map(evidence: Mapping[str, float], named: Collection[str]) -> Chart:
    """Bars of the strongest places, best on top; places of findings stand out."""
    best = sorted(((p, v) for p, v in evidence.items() if known(v)), key=lambda item: -item[1])[:SHOWN]
    low, high = min([v for _, v in best] + [-1.0]), max([v for _, v in best] + [NOTABLE])
    span = squeeze(high) - squeeze(low)
    ticks = [(squeeze(t), f"{t:,}".replace("-", "\u2212")) for t in _TICKS if low <= t <= 1.5 * high]
    bars = [
        Bars(
            np.array([squeeze(best[k][1]) for k in at]),
            tone,
            name,
            at=np.array(at, dtype=float),
            texts=[significant(best[k][1]) for k in at],
        )
        for name, tone, wanted in _GROUPS
        if (at := [k for k, (place, _) in enumerate(best) if (place in named) is wanted])
    ]
    return Chart(
        "",
        Axis(
            "log Bayes factor [1]",
            squeeze(low) - 0.03 * span,
            squeeze(high) + 0.1 * span,
            ticks=_apart(ticks, span),
        ),
        Axis("", names=[place for place, _ in best]),
        [
            *bars,
            Level(0.0, "x", dashed=False),
            Level(squeeze(NOTABLE), "x", "worth a name: 3", tone="accent"),
        ],
        height=70.0 + 19.0 * max(len(best), 3),
    )


def _apart(ticks: list[tuple[float, str]], span: float) -> list[tuple[float, str]]:
    """Ticks whose numbers do not touch."""
    out: list[tuple[float, str]] = []
    for tick in ticks:
        if not out or tick[0] - out[-1][0] > 0.13 * span:
            out.append(tick)
    return out
