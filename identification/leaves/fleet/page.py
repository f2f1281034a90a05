"""A run over a fleet as a document: its first screen, and the page below it; nothing is estimated here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from urllib.parse import quote

from truepose.identification.leaves.fleet.result import Fleet
from truepose.identification.leaves.fleet.sections import (
    LISTED,
    csv_text,
    effect_blocks,
    shown_words,
    tolerance_blocks,
)
from truepose.identification.leaves.fleet.table import Row
from truepose.identification.leaves.fleet.words import (
    MET,
    change_sentences,
    effect_sentence,
    headline,
    moved_words,
    often,
    said_words,
    status_sentences,
    tolerance_sentence,
)
from truepose.identification.report.numbers import NONE, significant, unit_symbol
from truepose.shown.document import (
    Block,
    Command,
    Document,
    Items,
    Section,
    Table,
    Text,
)

OPENING = 5
"""Most lines of a list on the first screen."""
_HEAD = (
    "machine", "status", "verdict", "findings", "chi2 before", "chi2 after", "rms before", "rms after", "unit",
    "held out", "oddness",
)  # fmt: skip


def fleet_document(fleet: Fleet) -> Document:
    """What became of the machines, what occurs, which tolerances are in doubt, who is odd, what changed."""
    told = fleet.statistics
    odd = [f"{r.name}: {r.odd_because}" for r in fleet.unusual]
    doubtful = [tolerance_sentence(t) for t in told.tolerances if t.met < MET]
    lists = [
        Items(status_sentences(fleet), "Not all went well", "warn"),
        Items(_few([effect_sentence(e) for e in told.anywhere if often(e)]), "What occurs", label="occurs"),
        Items(_few(doubtful), "Tolerances in doubt", label="tolerance"),
        Items(_few(odd, fleet.odd), "Unlike the others", label="odd"),
        Items(change_sentences(fleet.changes), "Since last time", label="since last time"),
    ]
    command = "truepose diagnose MACHINE RECORDING --prior prior.yaml -o DIR"
    facts = [("machines", str(fleet.machines)), ("diagnosed", str(fleet.diagnosed)), ("odd", str(fleet.odd))]
    facts += [(name, str(count)) for name, count in sorted(fleet.verdicts.items())]
    return Document(
        f"truepose: fleet {fleet.name}",
        f"{fleet.name}: {headline(fleet)}",
        "good" if fleet.diagnosed == fleet.machines and not fleet.odd else "warn",
        facts,
        summary=[one for one in lists if one.items],
        steps=[Command(command, "use what this fleet has taught:")] if fleet.diagnosed else (),
        more="see fleet.html",
        sections=lambda: _sections(fleet),
    )


def _few(texts: Sequence[str], there: int | None = None) -> list[str]:
    left = (len(texts) if there is None else there) - len(texts[:OPENING])
    return [*texts[:OPENING], *([f"and {left} more: see fleet.html"] if left > 0 else [])]


def _sections(fleet: Fleet) -> list[Section]:
    undone = (
        [Section("undone", "Machines without a diagnosis", _undone_blocks(fleet))] if fleet.undone else []
    )
    return [
        *undone,
        Section("effects", "What occurs, how often and how large", effect_blocks(fleet)),
        Section("tolerances", "Which tolerances are met", tolerance_blocks(fleet)),
        Section("odd", "Machines unlike the others", _odd_blocks(fleet)),
        Section("changes", "What changed since last time", _change_blocks(fleet)),
        Section("machines", "The machines", _machine_blocks(fleet)),
    ]


def _odd_blocks(fleet: Fleet) -> list[Block]:
    if not fleet.odd:
        return [Text("No machine is further from the others than chance makes one of so many.", tone="good")]
    head = ["machine", "verdict", "findings", "because", "oddness"]
    rows = [
        [r.name, r.verdict, r.findings or NONE, r.odd_because, significant(r.oddness)] for r in fleet.unusual
    ]
    caption = (
        "Oddness: minus log10 of how probable anything so unusual is in a machine of this fleet, counted for all that was"
        f" looked at. {shown_words(len(rows), fleet.odd)}"
    )
    return [
        Table(
            head, rows, caption, text_columns=4, csv=csv_text(head, rows), links=_links(fleet, fleet.unusual)
        )
    ]


def _undone_blocks(fleet: Fleet) -> list[Block]:
    head = ["machine", "status", "why"]
    rows = [[r.name, r.status, r.why] for r in fleet.undone]
    return [
        Table(
            head,
            rows,
            shown_words(len(rows), fleet.machines - fleet.diagnosed),
            text_columns=3,
            csv=csv_text(head, rows),
        )
    ]


def _change_blocks(fleet: Fleet) -> list[Block]:
    changes = fleet.changes
    blocks: list[Block] = []
    if changes is None or not changes.any:
        return [Items(change_sentences(changes))]
    if changes.said:
        rows = [said_words(one) for one in changes.said[:LISTED]]
        head = ["machine", "what", "before", "after"]
        blocks.append(
            Table(
                head,
                rows,
                shown_words(len(rows), len(changes.said)),
                text_columns=4,
                csv=csv_text(head, rows),
            )
        )
    if changes.moved:
        rows = [moved_words(one) for one in changes.moved[:LISTED]]
        head = ["machine", "parameter", "moved by [mm or rad]", "in 1 sigma"]
        caption = (
            f"Moved: by more than {significant(changes.limit)} sigma, which chance makes of none of the"
            f" {changes.compared} compared in 95 of 100 runs. {shown_words(len(rows), len(changes.moved))}"
        )
        blocks.append(Table(head, rows, caption, text_columns=2, csv=csv_text(head, rows)))
    return blocks


def _machine_blocks(fleet: Fleet) -> list[Block]:
    rows = [_machine_row(one) for one in fleet.rows]
    caption = f"{shown_words(len(rows), fleet.machines)} fleet.csv has all machines, with all digits."
    return [
        Table(
            _HEAD, rows, caption, text_columns=4, csv=csv_text(_HEAD, rows), links=_links(fleet, fleet.rows)
        )
    ]


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
        f"machines/{quote(one.name, safe='')}/{'report.html' if one.status in reports else ''}"
        for one in rows
    ]


__all__ = ["fleet_document"]
