"""The report of a comparison of sessions: one self-contained HTML page; nothing is estimated here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from truepose.identification.drift.analysis import Drift
from truepose.identification.drift.durability import Check
from truepose.identification.drift.sizes import Movement
from truepose.identification.report import render
from truepose.identification.report.document import Block, Document, Items, Plot, Section, Table, Text, Tone
from truepose.identification.report.drift_words import (
    DAY,
    HOUR,
    drift_notes,
    durability_sentences,
    headline,
    moved_sentences,
    movement_sentence,
    rate_unit,
    still_sentences,
)
from truepose.identification.report.figures import style
from truepose.identification.report.numbers import (
    finer,
    measure,
    p_value,
    percent,
    significant,
    uncertain,
    unit_symbol,
)

MOST_PANELS = 12
COLUMNS = 3


def drift_html(found: Drift, cautions: Sequence[str] = ()) -> str:
    """The page as text; ``cautions`` stand above all."""
    facts = [
        ("sessions", ", ".join(found.labels)),
        ("readings", str(sum(found.n_observations))),
        ("noise", f"{significant(found.noise)} times the stated"),
    ]
    sections = [
        Section("moved", "What moved", _moved_blocks(found)),
        Section("lasting", "How long a calibration lasts", _lasting_blocks(found)),
        Section("parameters", "Every parameter", [_parameter_table(found)]),
    ]
    notes = drift_notes(found)
    if notes:
        sections.append(Section("notes", "Notes", [Items(notes)]))
    tone: Tone = "warn" if found.moved else "good"
    title = f"Drift of {found.machine}"
    return render.html(Document(title, headline(found), tone, facts, sections, cautions=cautions))


def _moved_blocks(found: Drift) -> list[Block]:
    shown = [m for m in found.movements if m.status in ("moved", "perhaps")]
    blocks: list[Block] = [
        Text("Every parameter is common to all sessions unless the evidence asks otherwise.")
    ]
    if shown:
        blocks.append(Items([*moved_sentences(found), *(movement_sentence(found, m) for m in shown)]))
        blocks.append(
            Plot(_change_figure(found, shown[:MOST_PANELS]), "Change since the first session, with 1-sigma.")
        )
    if len(shown) > MOST_PANELS:
        blocks.append(Text(f"{len(shown) - MOST_PANELS} more are in the table.", tone="muted"))
    said = still_sentences(found)
    return [*blocks, Items(said, title="What did not move, or cannot be told")] if said else blocks


def _clock(found: Drift) -> tuple[list[float], str]:
    """Place of each session on the axis of time."""
    if found.times is None:
        return [float(k + 1) for k in range(len(found.labels))], "session"
    size, name = (DAY, "days") if rate_unit(found)[0] == DAY else (HOUR, "hours")
    return [(t - found.times[0]) / size for t in found.times], name


def _change_figure(found: Drift, shown: Sequence[Movement]) -> go.Figure:
    x, unit = _clock(found)
    columns = min(COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    titles = [style.label(m.name) for m in shown]
    figure = make_subplots(
        rows, columns, subplot_titles=titles, horizontal_spacing=0.12, vertical_spacing=0.3 / rows
    )
    for k, movement in enumerate(shown):
        factor, name = finer(max(np.abs(movement.change)), movement.unit)
        cell = {"row": k // columns + 1, "col": k % columns + 1}
        marks = go.Scatter(
            x=x,
            y=[factor * v for v in movement.change],
            error_y={"type": "data", "array": [factor * s for s in movement.std], "color": style.AFTER},
            mode="markers+lines",
            line={"color": style.AFTER, "width": 1},
            hovertext=list(found.labels),
        )
        figure.add_trace(marks, **cell)
        figure.update_yaxes(title_text=unit_symbol(name) or "1", **cell)
    figure.update_xaxes(title_text=unit, row=rows)
    return style.finish(figure, height=90 + 210 * rows, legend=False)


def _lasting_blocks(found: Drift) -> list[Block]:
    durable = found.durability
    head = ["session", "what is kept", "kind", "rms", "expected", "p", "suffices"]
    ways: list[tuple[str, Sequence[Check | None]]] = [
        ("everything", durable.carried),
        ("the mechanism", durable.frames),
        ("nothing", durable.full),
    ]
    rows = []
    for k, label in enumerate(found.labels[1:]):
        for name, checks in ways:
            rows += _check_rows(label, name, checks[k])
    caption = (
        "Expected: what noise and the first calibration's own uncertainty leave if nothing kept has moved."
    )
    return [Items(durability_sentences(found)), Table(head, rows, caption=caption, text_columns=3)]


def _check_rows(label: str, name: str, check: Check | None) -> list[list[str]]:
    if check is None:
        return [[label, name, "-", "-", "-", "-", "no fit"]]
    return [
        [
            label,
            name,
            kind,
            measure(value, check.units[kind]),
            measure(check.expected[kind], check.units[kind]),
            "-" if name == "nothing" else p_value(check.p),
            "yes" if check.holds else "no",
        ]
        for kind, value in check.rms.items()
    ]


def _parameter_table(found: Drift) -> Table:
    head = [
        "parameter",
        "status",
        "change to the last session",
        "probability",
        "log Bayes factor",
        "would show from",
    ]
    rows = []
    for m in found.movements:
        change = uncertain(m.change[-1], m.std[-1], m.unit) if m.change else "-"
        hidden = "-" if m.change else measure(2 * m.hidden, m.unit, 2)
        rows.append(
            [m.name, m.status, change, percent(m.probability), significant(m.log_bayes_factor), hidden]
        )
    caption = (
        "The last column: two sigmas of a movement from the first session to the last, if it moved alone."
    )
    return Table(head, rows, caption=caption, text_columns=2)
