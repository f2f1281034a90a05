"""The report of a comparison of sessions: one self-contained HTML page; nothing is estimated here."""

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
from truepose.identification.report import render
from truepose.identification.report.document import (
    Block,
    Charts,
    Command,
    Document,
    Gain,
    Items,
    Opening,
    Section,
    Table,
    Text,
    Tone,
)
from truepose.identification.report.numbers import (
    finer,
    measure,
    p_value,
    percent,
    significant,
    uncertain,
    unit_symbol,
)
from truepose.identification.report.opening import file_name, recording_names
from truepose.identification.report.scene.guilt import Guilty
from truepose.identification.report.scene.scene import scene_of
from truepose.identification.report.sections.origin import origin_section
from truepose.shown.chart import Axis, Chart, Layer, Level, Line, Marks

MOST_PANELS = 12
MOST_LINES = 4


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
    if found.recording is not None and found.fits:
        sections.append(origin_section(found.fits[0].nominal, found.recording, "drift"))
    title = f"truepose: drift of {found.machine}"
    opening = _opening(found)
    return render.html(Document(title, headline(found), tone, facts, sections, cautions, opening))


def _opening(found: Drift) -> Opening:
    """How sure, what could not be told, what to do next, and the machine with what moved."""
    gains = _gains(found)
    lists = [Items(said, title="How sure") for said in [_sure(found)] if said]
    open_ended = still_sentences(found)
    if open_ended:
        lists.append(Items(open_ended[:MOST_LINES], title="What did not move, or could not be told"))
    lists.append(Items(durability_sentences(found)[:MOST_LINES], title="How long a calibration lasts"))
    if not found.fits or found.recording is None:
        return Opening(gains, lists)
    fit = found.fits[0]
    machine, files = file_name(fit.nominal), recording_names(found.recording.files)
    steps = [
        Command(f"truepose calibrate {machine} {files.split()[-1]} -o fit", "Calibrate on the last session:")
    ]
    first = found.recording.subset(found.recording.session == found.recording.session[0])
    moved = [m for m in found.movements if m.status in ("moved", "perhaps")][:MOST_LINES]
    guilty = [Guilty(f"{m.name} {m.status}", "", percent(m.probability), (m.name,)) for m in moved]
    scene = scene_of(fit, None, first, guilty) if len(first) == len(fit.residual) else None
    return Opening(gains, lists, steps if found.moved else (), scene)


def _gains(found: Drift) -> list[Gain]:
    """What the first calibration misses in the last session, beside what it would if nothing had moved."""
    check = found.durability.carried[-1] if found.durability.carried else None
    if check is None:
        return []
    out = []
    for kind, value in check.rms.items():
        expected, unit = check.expected[kind], check.units[kind]
        largest = max(value, expected) or 1.0
        note = f"the calibration of {found.labels[0]} on {found.labels[-1]}, rms"
        floor = f"if nothing had moved (dashed): {measure(expected, unit)}"
        shares = (0.0, value / largest, expected / largest)
        out.append(
            Gain(f"{kind} error of the first calibration", "", measure(value, unit), floor, "", note, shares)
        )
    return out


def _sure(found: Drift) -> list[str]:
    return [f"{m.name}: {percent(m.probability)} that it moved." for m in found.moved][:MOST_LINES]


def _moved_blocks(found: Drift) -> list[Block]:
    shown = [m for m in found.movements if m.status in ("moved", "perhaps")]
    blocks: list[Block] = [
        Text("Every parameter is common to all sessions unless the evidence asks otherwise.")
    ]
    if shown:
        blocks.append(Items([*moved_sentences(found), *(movement_sentence(found, m) for m in shown)]))
    sized = [m for m in shown if m.change]
    if sized:
        charts = _change_charts(found, sized[:MOST_PANELS])
        blocks.append(Charts(charts, "Change since the first session, with 1-sigma."))
    if len(sized) > MOST_PANELS:
        blocks.append(Text(f"{len(sized) - MOST_PANELS} more are in the table.", tone="muted"))
    said = still_sentences(found)
    return [*blocks, Items(said, title="What did not move, or cannot be told")] if said else blocks


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
            Marks(np.array(x), change, "after", error=std),
        ]
        y = Axis(f"change [{unit_symbol(name) or '1'}]")
        out.append(Chart(movement.name, Axis(unit), y, layers, told=movement_sentence(found, movement)))
    return out


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
