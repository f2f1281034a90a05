"""What a result says, free of any form: made once for each kind of result, and written as text or as a page.

The headline, gains, summary and steps are the first screen; sections are what a page has below it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from truepose.shown.chart import Chart

if TYPE_CHECKING:
    import pandas as pd

Tone = Literal["", "lead", "muted", "good", "warn"]


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str
    tone: Tone = ""


@dataclass(frozen=True)
class Items:
    """A list under a title. label: what stands before each item on a terminal; weight: its share of the room there."""

    items: Sequence[str]
    title: str = ""
    tone: Tone = ""
    label: str = ""
    weight: int = 1


@dataclass(frozen=True)
class Table:
    """A table; columns after ``text_columns`` hold numbers and are set to the right.

    csv: the whole table as text with all digits, for the button that copies it; a table that has it can be sorted.
    links: where the first cell of each row leads.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    text_columns: int = 1
    csv: str = ""
    links: Sequence[str] = ()

    @classmethod
    def of(cls, frame: pd.DataFrame) -> Table:
        """A data frame, with six digits of its numbers."""
        rows = [
            [v if isinstance(v, str) else f"{v:.6g}" for v in row] for row in frame.itertuples(index=False)
        ]
        return cls([str(name) for name in frame.columns], rows)


@dataclass(frozen=True)
class Charts:
    """Panels that share a legend and a caption, which says what to see."""

    charts: Sequence[Chart]
    caption: str


@dataclass(frozen=True)
class Command:
    """A line to be typed, and what it does."""

    command: str
    does: str = ""


@dataclass(frozen=True)
class Fold:
    """Blocks behind a line that opens them; open in print."""

    title: str
    blocks: Sequence[Block]


@dataclass(frozen=True)
class Card:
    """Blocks that belong together under a title, with a short badge; ``slug`` stands beside it in small type."""

    title: str
    blocks: Sequence[Block]
    badge: str = ""
    tone: Tone = ""
    slug: str = ""
    number: int = 0


Block = Text | Items | Table | Charts | Command | Fold | Card


@dataclass(frozen=True)
class Gain:
    """Error of one kind of reading before (empty where one model was fitted) and after, as texts with their unit.

    note: on which rows; each: what was before, by name; floor: what the dashed mark is, such as what the instrument
    alone makes; shares: before, after and floor as shares of the largest, for bars.
    """

    kind: str
    before: str
    after: str
    note: str
    floor: str
    shares: tuple[float, float, float]
    each: str = ""


@dataclass(frozen=True)
class Guilty:
    """A place that stands out in the drawing: what is there in plain words, its slug, how probable it is, and its names."""

    what: str
    slug: str
    probability: str
    place: tuple[str, ...]


@dataclass(frozen=True)
class Scene:
    """What is drawn (``data``, for the script), what is guilty, and a sentence that says what is to be seen."""

    data: dict[str, Any]
    guilty: Sequence[Guilty]
    told: str


@dataclass(frozen=True)
class Section:
    """A numbered part of the page; ``anchor`` is its address within it."""

    anchor: str
    title: str
    blocks: Sequence[Block] = field(default_factory=tuple)


@dataclass(frozen=True)
class Document:
    """A result as it is told.

    ``headline`` is the result in a sentence, below ``cautions``; ``notes`` are remarks beside it; ``more`` says where the rest
    is. What may take a while is made when somebody looks: the page's ``sections`` and its ``scene``.
    """

    title: str
    headline: str
    tone: Tone = ""
    facts: Sequence[tuple[str, str]] = ()
    gains: Sequence[Gain] = ()
    summary: Sequence[Block] = ()
    steps: Sequence[Command | Text] = ()
    notes: Sequence[str] = ()
    cautions: Sequence[str] = ()
    more: str = ""
    sections: Callable[[], Sequence[Section]] = tuple
    scene: Callable[[], Scene | None] = lambda: None
    rows: Sequence[int] = ()
    """Numbers, from 0, of the recording's rows that the k-th points of charts are of."""
