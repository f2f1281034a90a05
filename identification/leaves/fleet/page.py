"""A run over a fleet as a document: its first screen, and the page below it; nothing is estimated here."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

import pandas as pd

from truepose.identification.leaves.fleet.pooled import rows_of
from truepose.identification.leaves.fleet.statistics import EffectInFleet
from truepose.identification.leaves.fleet.table import SHOWN, Fleet
from truepose.identification.leaves.fleet.words import (
    MET,
    change_sentences,
    effect_sentence,
    headline,
    often,
    percent_range,
    status_sentences,
    tolerance_sentence,
)
from truepose.identification.report.phrases import NONE, percent, significant, title, unit_symbol
from truepose.shown.document import Block, Command, Document, Items, Section, Table, Text

OPENING = 5
"""Most lines of a list on the first screen."""
LISTED = 200
"""Most rows of a table of what is off."""


def fleet_document(fleet: Fleet) -> Document:
    """What became of the machines, what occurs, which tolerances are in doubt, who is odd, what changed."""
    told, machines, odd = fleet.statistics, len(fleet.table), fleet.odd
    strange = [f"{r.name}: {r.odd_because}" for r in rows_of(odd.head(OPENING))]
    doubtful = [tolerance_sentence(t) for t in told.tolerances if t.met < MET]
    lists = [
        Items(status_sentences(fleet), "Not all went well", "warn"),
        Items(_few([effect_sentence(e) for e in told.anywhere if often(e)]), "What occurs", label="occurs"),
        Items(_few(doubtful), "Tolerances in doubt", label="tolerance"),
        Items(_few(strange, len(odd)), "Unlike the others", label="odd"),
        Items(change_sentences(fleet.changes), "Since last time", label="since last time"),
    ]
    command = "truepose diagnose MACHINE RECORDING --prior prior.yaml -o DIR"
    facts = {"machines": machines, "diagnosed": fleet.diagnosed, "odd": len(odd), **fleet.count("verdict")}
    return Document(
        f"truepose: fleet {fleet.name}",
        f"{fleet.name}: {headline(fleet)}",
        "good" if fleet.diagnosed == machines and not len(odd) else "warn",
        [(name, str(count)) for name, count in facts.items()],
        summary=[one for one in lists if one.items],
        steps=[Command(command, "use what this fleet has taught:")] if fleet.diagnosed else (),
        more="see fleet.html",
        sections=lambda: _sections(fleet),
    )


def _few(texts: Sequence[str], there: int | None = None) -> list[str]:
    left = (len(texts) if there is None else there) - len(texts[:OPENING])
    return [*texts[:OPENING], *([f"and {left} more: see fleet.html"] if left > 0 else [])]


def _sections(fleet: Fleet) -> list[Section]:
    undone = _undone_blocks(fleet)
    return [
        *([Section("undone", "Machines without a diagnosis", undone)] if undone else []),
        Section("effects", "What occurs, how often and how large", _effect_blocks(fleet)),
        Section("tolerances", "Which tolerances are met", _tolerance_blocks(fleet)),
        Section("odd", "Machines unlike the others", _odd_blocks(fleet)),
        Section("changes", "What changed since last time", _change_blocks(fleet)),
        Section("machines", "The machines", _machine_blocks(fleet)),
    ]


def _table(
    head: Sequence[str], rows: Sequence[Sequence[str]], caption: str, text_columns: int, **more: Any
) -> Table:
    """Return a table that can be sorted and copied."""
    return Table(head, rows, caption, text_columns, **{"csv": _csv_text(head, rows), **more})


def _csv_text(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([head, *rows])
    return text.getvalue()


def _shown_words(shown: int, there: int) -> str:
    """Say that a table is not whole; nothing of one that is."""
    return f"Shown are {shown} of {there}." if shown < there else ""


def _undone_blocks(fleet: Fleet) -> list[Block]:
    undone = fleet.undone
    if undone.empty:
        return []
    rows = undone[["name", "status", "why"]].head(SHOWN).to_numpy().tolist()
    rows = [[cell or "" for cell in row] for row in rows]
    return [_table(["machine", "status", "why"], rows, _shown_words(len(rows), len(undone)), 3)]


def _effect_blocks(fleet: Fleet) -> list[Block]:
    told = fleet.statistics
    if not told.anywhere:
        return [Text("No machine was diagnosed, so there is nothing to say of effects.")]
    blocks: list[Block] = [
        Text(
            "Frequencies come from the evidence of all machines together, not from counts of names: a machine whose"
            " recording could not show an effect counts for neither side. Intervals are 90 %."
        ),
        _effect_table(told.anywhere, "Each effect at any of its places, most frequent first."),
    ]
    places = [one for one in told.places if often(one)]
    if places:
        caption = "Effects by place, where at least one machine probably has them."
        blocks.append(_effect_table(places, caption))
    return blocks


def _effect_table(effects: Sequence[EffectInFleet], caption: str) -> Table:
    """Return a row an effect, and all digits to copy; columns of place and mechanism that say the same of all are left out."""
    head = ["effect", "place", "mechanism", "machines", "in", "90 % interval"]
    head += ["expected", "median size", "90 % interval", "spread"]
    whole = ["effect", "place", "mechanism", "machines", "in", "from", "to", "expected"]
    whole += ["median size", "from", "to", "unit", "spread"]
    rows, digits = [], []
    for one in effects:
        size, unit, frequency = one.amount or one.size, one.unit if one.amount else "", one.frequency
        ends = (size.value, size.low, size.high) if size else (None, None, None)
        rows.append([
            f"{title(one.effect)} ({one.effect})", " + ".join(one.place) or "anywhere", one.mechanism, str(one.machines),
            percent(frequency.value), percent_range(frequency), percent(one.usual),
            f"{significant(ends[0])} {unit_symbol(unit)}".rstrip(),
            f"{significant(ends[1])} to {significant(ends[2])}" if size else NONE, significant(one.spread, 2),
        ])  # fmt: skip
        digits.append([
            one.effect, "+".join(one.place), one.mechanism, one.machines, frequency.value, frequency.low, frequency.high,
            one.usual, *ends, unit, one.spread,
        ])  # fmt: skip
    shown = [k for k in range(len(head)) if k not in (1, 2) or len({row[k] for row in rows}) > 1]
    told = f"{caption} Sizes without a unit count in the largest that the catalogue expects; spread: factor of one sigma."
    rows = [[row[k] for k in shown] for row in rows]
    return _table([head[k] for k in shown], rows, told, len(shown) - 7, csv=_csv_text(whole, digits))


def _tolerance_blocks(fleet: Fleet) -> list[Block]:
    told = fleet.statistics.tolerances
    if not told:
        return [Text("No constant was seen well enough to compare it with its tolerance.")]
    text = (
        "How far constants of a class really scatter about the drawing, over all machines, with what each measurement is"
        " unsure of taken out. Above 1 the tolerance is not met."
    )
    rows = []
    for one in told:
        values = (one.ratio.value, one.ratio.low, one.ratio.high)
        rows.append([one.parts, str(one.deviations), *map(significant, values), percent(one.met)])
    head = ["parts", "constants", "spread / tolerance", "from", "to", "met with"]
    return [Text(text), _table(head, rows, "", 1), *_drawing_blocks(fleet)]


def _drawing_blocks(fleet: Fleet) -> list[Block]:
    """Constants whose mean over the fleet is surely not the drawing's."""
    off = [one for one in fleet.statistics.constants if one.mean.low > 0.0 or one.mean.high < 0.0]
    if not off:
        return []
    rows = []
    for one in off[:LISTED]:
        values = (one.mean.value, one.mean.low, one.mean.high, one.spread)
        rows.append([one.name, one.mechanism, str(one.machines), *map(significant, values)])
    caption = (
        "Constants whose mean over the machines is not the drawing's, in tolerances: the drawing, or how all are built, rather"
        f" than one machine. One in ten of such intervals misses the drawing by chance. {_shown_words(len(rows), len(off))}"
    )
    head = ["constant", "mechanism", "machines", "mean off the drawing", "from", "to", "spread"]
    return [_table(head, rows, caption, 2)]


def _odd_blocks(fleet: Fleet) -> list[Block]:
    odd = fleet.odd
    if odd.empty:
        return [Text("No machine is further from the others than chance makes one of so many.", tone="good")]
    shown = odd.head(SHOWN)
    rows = [
        [r.name, r.verdict or "", r.findings or NONE, r.odd_because, significant(r.oddness)]
        for r in rows_of(shown)
    ]
    caption = (
        "Oddness: minus log10 of how probable anything so unusual is in a machine of this fleet, counted for all that was"
        f" looked at. {_shown_words(len(rows), len(odd))}"
    )
    head = ["machine", "verdict", "findings", "because", "oddness"]
    return [_table(head, rows, caption, 4, links=_links(fleet, shown))]


def _change_blocks(fleet: Fleet) -> list[Block]:
    changes = fleet.changes
    blocks: list[Block] = []
    if changes is None or not changes.any:
        return [Items(change_sentences(changes))]
    if changes.said:
        rows = [[one.machine, one.what, one.before or "-", one.after or "-"] for one in changes.said[:LISTED]]
        caption = _shown_words(len(rows), len(changes.said))
        blocks.append(_table(["machine", "what", "before", "after"], rows, caption, 4))
    if changes.moved:
        rows = [
            [one.machine, one.parameter, significant(one.change), significant(one.sigma)]
            for one in changes.moved[:LISTED]
        ]
        caption = (
            f"Moved: by more than {significant(changes.limit)} sigma, which chance makes of none of the"
            f" {changes.compared} compared in 95 of 100 runs. {_shown_words(len(rows), len(changes.moved))}"
        )
        blocks.append(
            _table(["machine", "parameter", "moved by [mm or rad]", "in 1 sigma"], rows, caption, 2)
        )
    return blocks


def _machine_blocks(fleet: Fleet) -> list[Block]:
    shown = fleet.table.head(SHOWN)
    rows = []
    for r in rows_of(shown):
        errors = map(significant, (r.chi2_before, r.chi2_after, r.rms_before, r.rms_after))
        texts = [r.name, r.status, r.verdict or NONE, r.findings or NONE, *errors]
        rows.append([*texts, unit_symbol(r.unit or "") or NONE, significant(r.ratio), significant(r.oddness)])
    caption = f"{_shown_words(len(rows), len(fleet.table))} fleet.csv has all machines, with all digits."
    head = [
        "machine",
        "status",
        "verdict",
        "findings",
        "chi2 before",
        "chi2 after",
        "rms before",
        "rms after",
    ]
    head += ["unit", "held out", "oddness"]
    return [_table(head, rows, caption, 4, links=_links(fleet, shown))]


def _links(fleet: Fleet, rows: pd.DataFrame) -> list[str]:
    """Return where a machine's report lies as seen from the page, or its results where it has none."""
    reports = {"done", "refused"} if not fleet.brief else set()
    return [
        f"machines/{quote(one.name, safe='')}/{'report.html' if one.status in reports else ''}"
        for one in rows_of(rows)
    ]
