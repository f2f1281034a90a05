"""The page of a fleet: one self-contained HTML file; nothing is estimated here."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from typing import Any
from urllib.parse import quote

import numpy as np

from truepose.identification.fleet.result import Fleet
from truepose.identification.fleet.statistics import EffectInFleet, Interval, ToleranceInFleet
from truepose.identification.fleet.table import Row
from truepose.identification.report import render
from truepose.identification.report.document import (
    Block,
    Charts,
    Command,
    Document,
    Items,
    Opening,
    Section,
    Table,
    Text,
    Tone,
)
from truepose.identification.report.fleet_words import (
    MET,
    change_sentences,
    effect_sentence,
    headline,
    moved_words,
    off_drawing,
    often,
    said_words,
    status_sentences,
    tolerance_sentence,
)
from truepose.identification.report.level_words import title
from truepose.identification.report.numbers import NONE, percent, significant, unit_symbol
from truepose.shown.chart import Axis, Chart, Layer, Level, Line, Marks

OPENING, DRAWN, LISTED = 5, 20, 200
"""Most lines of a list on the first screen, intervals of a chart, and rows of a table of changes."""
_HEAD = (
    "machine",
    "status",
    "verdict",
    "findings",
    "chi2 before",
    "chi2 after",
    "rms before",
    "rms after",
    "unit",
    "held out",
    "oddness",
)


def fleet_html(fleet: Fleet) -> str:
    """The page as text."""
    sections = [
        Section("effects", "What occurs, how often and how large", _effect_blocks(fleet)),
        Section("tolerances", "Which tolerances are met", _tolerance_blocks(fleet)),
        Section("odd", "Machines unlike the others", _odd_blocks(fleet)),
        Section("changes", "What changed since last time", _change_blocks(fleet)),
        Section("machines", "The machines", _machine_blocks(fleet)),
    ]
    if fleet.undone:
        sections.insert(0, Section("undone", "Machines without a diagnosis", _undone_blocks(fleet)))
    facts = [("machines", str(fleet.machines)), ("diagnosed", str(fleet.diagnosed)), ("odd", str(fleet.odd))]
    facts += [(name, str(count)) for name, count in sorted(fleet.verdicts.items())]
    tone: Tone = "good" if fleet.diagnosed == fleet.machines and not fleet.odd else "warn"
    name = f"truepose: fleet {fleet.name}"
    return render.html(Document(name, headline(fleet), tone, facts, sections, opening=_opening(fleet)))


def _opening(fleet: Fleet) -> Opening:
    told = fleet.statistics
    lists = [
        Items(status_sentences(fleet), title="Not all went well", tone="warn"),
        Items([effect_sentence(e) for e in told.anywhere if often(e)][:OPENING], title="What occurs"),
        Items([tolerance_sentence(t) for t in told.tolerances if t.met < MET][:OPENING], title="Tolerances in doubt"),
        Items([f"{r.name}: {r.odd_because}" for r in fleet.unusual[:OPENING]], title="Unlike the others"),
        Items(change_sentences(fleet.changes), title="Since last time"),
    ]
    command = "truepose diagnose MACHINE RECORDING --prior prior.yaml -o DIR"
    steps = [Command(command, "Diagnose the next machine with what this fleet has taught:")]
    return Opening(lists=[one for one in lists if one.items], steps=steps if fleet.diagnosed else ())


def _effect_blocks(fleet: Fleet) -> list[Block]:
    told = fleet.statistics
    if not told.anywhere:
        return [Text("No machine was diagnosed, so there is nothing to say of effects.")]
    shown = [one for one in told.anywhere if often(one)]
    blocks: list[Block] = [
        Text(
            "Frequencies come from the evidence of all machines together, not from counts of names: a machine whose"
            " recording could not show an effect counts for neither side. Intervals are 90 %."
        )
    ]
    if shown:
        caption = "Share of machines that have an effect at any place, with its 90 % interval; rings: what was expected before."
        blocks.append(Charts([_often_chart(shown[:DRAWN])], caption))
    blocks.append(_effect_table(told.anywhere, "Each effect at any of its places, most frequent first."))
    places = [one for one in told.places if often(one)]
    if places:
        blocks.append(_effect_table(places, "Effects by place, where at least one machine probably has them."))
    return blocks


def _often_chart(shown: Sequence[EffectInFleet]) -> Chart:
    names = [_called(one) for one in shown]
    usual = 100 * np.array([one.usual for one in shown])
    before = Marks(usual, np.arange(len(shown), dtype=float), "free", "expected before", "ring")
    chart = _intervals(names, [_scaled(one.frequency, 100.0) for one in shown], "share of machines [%]", [before])
    return chart


def _scaled(interval: Interval, factor: float) -> Interval:
    return Interval(factor * interval.value, factor * interval.low, factor * interval.high)


def _intervals(
    names: Sequence[str], intervals: Sequence[Interval], axis: str, below: Sequence[Layer] = ()
) -> Chart:
    """One line a name, with its value and interval."""
    at = np.arange(len(names), dtype=float)
    ends = np.array([[one.low, one.high, np.nan] for one in intervals]).ravel()
    values = np.array([one.value for one in intervals])
    layers: list[Layer] = [
        *below,
        Line(ends, np.repeat(at, 3), "after", "90 % interval"),
        Marks(values, at, "after", "value"),
    ]
    top = float(np.nanmax(ends)) if len(names) else 1.0
    return Chart("", Axis(axis, 0.0, 1.05 * top), Axis("", names=list(names)), layers, height=62.0 + 17.0 * len(names))


def _called(one: EffectInFleet) -> str:
    where = f" at {' + '.join(one.place)}" if one.place else ""
    return f"{title(one.effect)}{where}"


def _effect_table(effects: Sequence[EffectInFleet], caption: str) -> Table:
    """Columns that say the same of all are left out."""
    head = ["effect", "place", "mechanism", "machines", "in", "90 % interval"]
    head += ["expected", "median size", "90 % interval", "spread"]
    rows = [_effect_row(one) for one in effects]
    shown = [k for k in range(len(head)) if k not in (1, 2) or len({row[k] for row in rows}) > 1]
    told = f"{caption} Sizes without a unit count in the largest that the catalogue expects; spread: factor of one sigma."
    digits = [[one.effect, "+".join(one.place), *_digits(one)] for one in effects]
    whole = ["effect", "place", "mechanism", "machines", "in", "from", "to", "expected"]
    whole += ["median size", "from", "to", "unit", "spread"]
    return Table(
        [head[k] for k in shown],
        [[row[k] for k in shown] for row in rows],
        told,
        text_columns=len(shown) - 7,
        csv=_csv(whole, digits),
    )


def _effect_row(one: EffectInFleet) -> list[str]:
    _, _, often, *ends, usual, size, low, high, unit, spread = _digits(one)
    size_ends = f"{significant(low)} to {significant(high)}" if size is not None else NONE
    return [
        f"{title(one.effect)} ({one.effect})",
        " + ".join(one.place) or "anywhere",
        one.mechanism,
        str(one.machines),
        percent(often),
        " to ".join(map(percent, ends)),
        percent(usual),
        f"{significant(size)} {unit_symbol(unit)}".rstrip(),
        size_ends,
        significant(spread, 2),
    ]


def _digits(one: EffectInFleet) -> list[Any]:
    sized = one.amount or one.size
    sizes = (None, None, None) if sized is None else (sized.value, sized.low, sized.high)
    often = (one.frequency.value, one.frequency.low, one.frequency.high, one.usual)
    return [one.mechanism, one.machines, *often, *sizes, one.unit if one.amount else "", one.spread]


def _tolerance_blocks(fleet: Fleet) -> list[Block]:
    told = fleet.statistics.tolerances
    if not told:
        return [Text("No constant was seen well enough to compare it with its tolerance.")]
    blocks: list[Block] = [
        Text(
            "How far constants of a class really scatter about the drawing, over all machines, with what each measurement is"
            " unsure of taken out. Above 1 the tolerance is not met."
        )
    ]
    level = Level(1.0, "x", "as stated")
    names = [one.parts for one in told[:DRAWN]]
    chart = _intervals(names, [one.ratio for one in told[:DRAWN]], "true spread over stated tolerance", [level])
    blocks.append(Charts([chart], "Values and 90 % intervals; dashed: the stated tolerance."))
    head = ["parts", "constants", "spread / tolerance", "from", "to", "met with"]
    rows = [_tolerance_row(one) for one in told]
    return [*blocks, Table(head, rows, csv=_csv(head, rows)), *_drawing_blocks(fleet)]


def _drawing_blocks(fleet: Fleet) -> list[Block]:
    """Constants that are off the drawing in all machines alike."""
    off = off_drawing(fleet)
    if not off:
        return []
    head = ["constant", "mechanism", "machines", "mean off the drawing", "from", "to", "spread"]
    rows = [
        [one.name, one.mechanism, str(one.machines)]
        + [significant(v) for v in (one.mean.value, one.mean.low, one.mean.high, one.spread)]
        for one in off[:LISTED]
    ]
    caption = (
        "Constants whose mean over the machines is not the drawing's, in tolerances: the drawing, or how all are built, rather"
        f" than one machine. One in ten of such intervals misses the drawing by chance. {_shown(len(rows), len(off))}"
    )
    return [Table(head, rows, caption, text_columns=2, csv=_csv(head, rows))]


def _tolerance_row(one: ToleranceInFleet) -> list[str]:
    values = (one.ratio.value, one.ratio.low, one.ratio.high)
    return [one.parts, str(one.deviations), *(significant(v) for v in values), percent(one.met)]


def _odd_blocks(fleet: Fleet) -> list[Block]:
    if not fleet.odd:
        return [Text("No machine is further from the others than chance makes one of so many.", tone="good")]
    head = ["machine", "verdict", "findings", "because", "oddness"]
    rows = [[r.name, r.verdict, r.findings or NONE, r.odd_because, significant(r.oddness)] for r in fleet.unusual]
    caption = (
        "Oddness: minus log10 of how probable anything so unusual is in a machine of this fleet, counted for all that was"
        f" looked at. {_shown(len(rows), fleet.odd)}"
    )
    return [Table(head, rows, caption, text_columns=4, csv=_csv(head, rows), links=_links(fleet, fleet.unusual))]


def _undone_blocks(fleet: Fleet) -> list[Block]:
    head = ["machine", "status", "why"]
    rows = [[r.name, r.status, r.why] for r in fleet.undone]
    return [Table(head, rows, _shown(len(rows), fleet.machines - fleet.diagnosed), text_columns=3, csv=_csv(head, rows))]


def _change_blocks(fleet: Fleet) -> list[Block]:
    changes = fleet.changes
    blocks: list[Block] = [Items(change_sentences(changes))]
    if changes is None:
        return blocks
    if changes.said:
        rows = [said_words(one) for one in changes.said[:LISTED]]
        head = ["machine", "what", "before", "after"]
        blocks.append(Table(head, rows, _shown(len(rows), len(changes.said)), text_columns=4, csv=_csv(head, rows)))
    if changes.moved:
        rows = [moved_words(one) for one in changes.moved[:LISTED]]
        head = ["machine", "parameter", "moved by [mm or rad]", "in 1 sigma"]
        caption = (
            f"Moved: by more than {significant(changes.limit)} sigma, which chance makes of none of the"
            f" {changes.compared} compared in 95 of 100 runs. {_shown(len(rows), len(changes.moved))}"
        )
        blocks.append(Table(head, rows, caption, text_columns=2, csv=_csv(head, rows)))
    return blocks


def _machine_blocks(fleet: Fleet) -> list[Block]:
    rows = [_machine_row(one) for one in fleet.rows]
    caption = f"{_shown(len(rows), fleet.machines)} fleet.csv has all machines, with all digits."
    return [Table(_HEAD, rows, caption, text_columns=4, csv=_csv(_HEAD, rows), links=_links(fleet, fleet.rows))]


def _machine_row(one: Row) -> list[str]:
    said: Callable[[float | None], str] = significant
    return [
        one.name,
        one.status,
        one.verdict or NONE,
        one.findings or NONE,
        said(one.chi2_before),
        said(one.chi2_after),
        said(one.rms_before),
        said(one.rms_after),
        unit_symbol(one.unit) or NONE,
        said(one.ratio),
        said(one.oddness),
    ]


def _links(fleet: Fleet, rows: Sequence[Row]) -> list[str]:
    """Where a machine's report lies as seen from the page, or its results where it has none."""
    reports = {"done", "refused"} if not fleet.brief else set()
    return [
        f"machines/{quote(one.name, safe='')}/{'report.html' if one.status in reports else ''}" for one in rows
    ]


def _shown(shown: int, there: int) -> str:
    return f"Shown are {shown} of {there}." if shown < there else ""


def _csv(head: Sequence[str], rows: Any) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([head, *rows])
    return text.getvalue()


__all__ = ["fleet_html"]
