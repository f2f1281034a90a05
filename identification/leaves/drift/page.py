"""A comparison of sessions as a document: its first screen, and the page below it; nothing is estimated here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truepose.identification.leaves.drift.analysis import Drift
from truepose.identification.leaves.drift.sizes import Check, Movement
from truepose.identification.leaves.drift.words import (
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
from truepose.identification.report.closing import machine_name, origin_section, recording_names
from truepose.identification.report.phrases import (
    finer,
    measure,
    p_value,
    percent,
    significant,
    uncertain,
    unit_symbol,
)
from truepose.shown.chart import Axis, Band, Chart, Layer, Level, Line, Marks
from truepose.shown.document import (
    Block,
    Charts,
    Command,
    Document,
    Gain,
    Items,
    Section,
    Table,
    Text,
)
from truepose.shown.result import document

MOST_PANELS = 12
_ORDER = ("moved", "perhaps", "anew", "still", "masked", "unseen")


@document.register
def drift_document(found: Drift) -> Document:
    """What moved, what did not or could not be told, how long a calibration lasts, and every parameter."""
    shown = [m for m in found.movements if m.status in ("moved", "perhaps")]
    sentences = [f"{m.status}: {movement_sentence(found, m)}" for m in shown]
    lists = [
        Items([*moved_sentences(found), *sentences], "What moved", weight=3),
        Items(still_sentences(found), "What did not move, or could not be told"),
        Items(durability_sentences(found), "How long a calibration lasts", weight=3),
    ]
    return Document(
        f"truepose: drift of {found.machine}",
        headline(found),
        "warn" if found.moved else "good",
        [("sessions", ", ".join(found.labels)), ("readings", str(sum(found.n_observations)))],
        _gains(found),
        [one for one in lists if one.items],
        _steps(found),
        drift_notes(found),
        more="to_frame(), drift.json and report.html have all",
        sections=lambda: _sections(found, shown),
    )


def _steps(found: Drift) -> list[Command | Text]:
    if not found.fits or found.recording is None or not found.moved:
        return []
    machine, files = machine_name(found.fits[0].nominal), recording_names(found.recording.files)
    line = f"truepose calibrate {machine} {files.split()[-1]} -o fit"
    return [Command(line, "calibrate on the last session:")]


def _gains(found: Drift) -> list[Gain]:
    """What the first calibration misses in the last session, beside what it would if nothing had moved."""
    check = found.durability.carried[-1] if found.durability.carried else None
    out = []
    for kind, value in {} if check is None else check.rms.items():
        assert check is not None
        expected, unit = check.expected[kind], check.units[kind]
        largest = max(value, expected) or 1.0
        note = f"the calibration of {found.labels[0]} on {found.labels[-1]}, rms"
        floor = f"if nothing had moved: {measure(expected, unit)}"
        shares = (0.0, value / largest, expected / largest)
        out.append(
            Gain(f"{kind} error of the first calibration", "", measure(value, unit), note, floor, shares)
        )
    return out


def _sections(found: Drift, shown: Sequence[Movement]) -> list[Section]:
    sized = [m for m in shown if m.change]
    more = f" {len(sized) - MOST_PANELS} more are in the table." if len(sized) > MOST_PANELS else ""
    caption = f"Change since the first session, with 1-sigma.{more}"
    charts: list[Block] = [Charts(_change_charts(found, sized[:MOST_PANELS]), caption)] if sized else []
    common = Text("Every parameter is common to all sessions unless the evidence asks otherwise.")
    notes = drift_notes(found)
    sections = [
        Section("moved", "What moved", [common, *charts, _parameter_table(found)]),
        Section("lasting", "How long a calibration lasts", [_lasting_table(found)]),
        *([Section("notes", "Notes", [Items(notes)])] if notes else []),
    ]
    if found.recording is not None and found.fits:
        sections.append(origin_section(found.fits[0].nominal, found.recording, "drift"))
    return sections


def _clock(found: Drift) -> tuple[list[float], str]:
    """Place of each session on the axis of time."""
    if found.times is None:
        return [float(k + 1) for k in range(len(found.labels))], "session"
    size, name = (DAY, "days") if rate_unit(found)[0] == DAY else (HOUR, "hours")
    return [(t - found.times[0]) / size for t in found.times], name


def _change_charts(found: Drift, shown: Sequence[Movement]) -> list[Chart]:
    x, unit = _clock(found)
    out = []
    for movement in shown:
        factor, name = finer(float(max(np.abs(movement.change))), movement.unit)
        change, std = factor * np.array(movement.change), factor * np.array(movement.std)
        layers: list[Layer] = [
            Level(0.0, "y", dashed=False),
            Line(np.array(x), change, "after"),
            Band(np.array(x), change - std, change + std, "after"),
            Marks(np.array(x), change, "after"),
        ]
        y = Axis(f"change [{unit_symbol(name) or '1'}]")
        out.append(Chart(movement.name, Axis(unit), y, layers))
    return out


def _lasting_table(found: Drift) -> Table:
    durable = found.durability
    head = ["session", "what is kept", "kind", "rms", "expected", "p", "suffices"]
    ways = {"everything": durable.carried, "the mechanism": durable.frames, "nothing": durable.full}
    rows = [
        row
        for k, label in enumerate(found.labels[1:])
        for name, checks in ways.items()
        for row in _check_rows(label, name, checks[k])
    ]
    caption = (
        "Expected: what noise and the first calibration's own uncertainty leave if nothing kept has moved."
    )
    return Table(head, rows, caption=caption, text_columns=3)


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
    rows = []
    for m in sorted(found.movements, key=lambda m: _ORDER.index(m.status)):
        change = uncertain(m.change[-1], m.std[-1], m.unit) if m.change else "-"
        hidden = "-" if m.change else measure(2 * m.hidden, m.unit, 2)
        rows.append(
            [m.name, m.status, change, percent(m.probability), significant(m.log_bayes_factor), hidden]
        )
    caption = (
        "The last column: two sigmas of a movement from the first session to the last, if it moved alone."
    )
    head = ["parameter", "status", "change to the last session", "probability", "log Bayes factor"]
    return Table([*head, "would show from"], rows, caption=caption, text_columns=2)
