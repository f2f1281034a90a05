"""A drift as it shows itself, as a table, and as files."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from truepose.files import atomic_directory, atomic_write_text
from truepose.identification.gate import Caution
from truepose.identification.leaves.drift import words
from truepose.identification.leaves.drift.analysis import Drift
from truepose.identification.leaves.drift.page import drift_html
from truepose.identification.leaves.drift.sizes import Movement
from truepose.identification.report.files import REPORT
from truepose.identification.report.json_text import json_text
from truepose.identification.report.numbers import measure, percent
from truepose.shown.drawing import bars
from truepose.shown.result import files, frame, html, view
from truepose.shown.view import View
from truepose.wording import shortened

_MOST = 12
MOVEMENTS = [
    "parameter", "status", "probability", "change", "std", "unit", "rate", "rate_std", "steady", "hidden",
    "extrinsic",
]  # fmt: skip


@view.register
def _(found: Drift) -> View:
    order = ("moved", "perhaps", "anew", "still", "masked", "unseen")
    rows = tuple(
        (
            m.name,
            m.status,
            measure(m.change[-1], m.unit) if m.change else "",
            measure(m.std[-1] if m.change else m.hidden, m.unit, 2),
            percent(m.probability),
        )
        for m in sorted(found.movements, key=lambda m: order.index(m.status))
    )
    return View(
        f"Drift of {words.headline(found)}",
        facts=(
            f"sessions: {shortened(list(found.labels), _MOST)}",
            *words.moved_sentences(found),
            *words.durability_sentences(found),
            *(f"note: {text}" for text in words.drift_notes(found)),
        ),
        head=("parameter", "status", "change in all", "1-sigma", "probability"),
        rows=rows,
        more="to_frame() has all constants",
        picture=partial(draw_movements, found),
    )


def draw_movements(found: Drift) -> str:
    """What moved most, in its own uncertainty."""
    sizes = {m.name: m.change[-1] / m.std[-1] for m in found.movements if m.change and m.std[-1] > 0}
    largest = dict(sorted(sizes.items(), key=lambda item: -abs(item[1]))[:_MOST])
    return bars(largest, title="change from the first session to the last, in 1-sigma") if largest else ""


@frame.register
def _(found: Drift) -> pd.DataFrame:
    return pd.DataFrame([_movement(one) for one in found.movements], columns=MOVEMENTS)


def _movement(one: Movement) -> tuple[object, ...]:
    change, std = (one.change[-1], one.std[-1]) if one.change else (np.nan, np.nan)
    rate, rate_std = (np.nan if value is None else value for value in (one.rate, one.rate_std))
    moved = (one.name, one.status, one.probability, change, std, one.unit)
    return (*moved, rate, rate_std, one.steady, one.hidden, one.extrinsic)


@html.register
def _(result: Drift) -> str:
    return drift_html(result)


@files.register
def _(result: Drift, output: Path) -> list[str]:
    return write_drift(result, output)


def write_drift(result: Drift, output: Path, caution: Caution | None = None) -> list[str]:
    """``drift.json`` and ``report.html``; their names. A ``caution`` stands above all."""
    with atomic_directory(output) as partial:
        atomic_write_text(
            partial / "drift.json",
            json_text({**words.drift_json(result), **(caution.document if caution else {})}),
        )
        atomic_write_text(partial / REPORT, drift_html(result, caution.sentences if caution else ()))
        return sorted(file.name for file in partial.iterdir())
