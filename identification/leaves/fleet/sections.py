"""What a fleet's page says of all machines together: effects with their frequencies and sizes, and tolerances."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

from truepose.identification.leaves.fleet.result import Fleet
from truepose.identification.leaves.fleet.statistics import EffectInFleet, ToleranceInFleet
from truepose.identification.leaves.fleet.words import off_drawing, often, percent_range
from truepose.identification.report.naming import title
from truepose.identification.report.numbers import NONE, percent, significant, unit_symbol
from truepose.shown.document import Block, Table, Text

LISTED = 200
"""Most rows of a table of what is off."""


def effect_blocks(fleet: Fleet) -> list[Block]:
    told = fleet.statistics
    if not told.anywhere:
        return [Text("No machine was diagnosed, so there is nothing to say of effects.")]
    blocks: list[Block] = [
        Text(
            "Frequencies come from the evidence of all machines together, not from counts of names: a machine whose"
            " recording could not show an effect counts for neither side. Intervals are 90 %."
        )
    ]
    blocks.append(_effect_table(told.anywhere, "Each effect at any of its places, most frequent first."))
    places = [one for one in told.places if often(one)]
    if places:
        blocks.append(
            _effect_table(places, "Effects by place, where at least one machine probably has them.")
        )
    return blocks


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
        csv=csv_text(whole, digits),
    )


def _effect_row(one: EffectInFleet) -> list[str]:
    _, _, often, _, _, usual, size, low, high, unit, spread = _digits(one)
    size_ends = f"{significant(low)} to {significant(high)}" if size is not None else NONE
    return [
        f"{title(one.effect)} ({one.effect})",
        " + ".join(one.place) or "anywhere",
        one.mechanism,
        str(one.machines),
        percent(often),
        percent_range(one.frequency),
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


def tolerance_blocks(fleet: Fleet) -> list[Block]:
    told = fleet.statistics.tolerances
    if not told:
        return [Text("No constant was seen well enough to compare it with its tolerance.")]
    blocks: list[Block] = [
        Text(
            "How far constants of a class really scatter about the drawing, over all machines, with what each measurement is"
            " unsure of taken out. Above 1 the tolerance is not met."
        )
    ]
    head = ["parts", "constants", "spread / tolerance", "from", "to", "met with"]
    rows = [_tolerance_row(one) for one in told]
    return [*blocks, Table(head, rows, csv=csv_text(head, rows)), *_drawing_blocks(fleet)]


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
        f" than one machine. One in ten of such intervals misses the drawing by chance. {shown_words(len(rows), len(off))}"
    )
    return [Table(head, rows, caption, text_columns=2, csv=csv_text(head, rows))]


def _tolerance_row(one: ToleranceInFleet) -> list[str]:
    values = (one.ratio.value, one.ratio.low, one.ratio.high)
    return [one.parts, str(one.deviations), *(significant(v) for v in values), percent(one.met)]


def shown_words(shown: int, there: int) -> str:
    """That a table is not whole; nothing of one that is."""
    return f"Shown are {shown} of {there}." if shown < there else ""


def csv_text(head: Sequence[str], rows: Any) -> str:
    """A table as text."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([head, *rows])
    return text.getvalue()


__all__ = ["LISTED", "csv_text", "effect_blocks", "shown_words", "tolerance_blocks"]
