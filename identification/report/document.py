"""What a page is made of: an opening, then sections of paragraphs, lists, tables, charts and cards, free of any markup."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from truepose.identification.report.scene.scene import Scene
from truepose.shown.chart import Chart

Tone = Literal["", "lead", "muted", "good", "warn"]


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str
    tone: Tone = ""
    kind: Literal["text"] = "text"


@dataclass(frozen=True)
class Items:
    """A list, with a line that introduces it."""

    items: Sequence[str]
    title: str = ""
    tone: Tone = ""
    kind: Literal["items"] = "items"


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
    kind: Literal["table"] = "table"


@dataclass(frozen=True)
class Charts:
    """Panels that share a legend and a caption, which says what to see."""

    charts: Sequence[Chart]
    caption: str
    kind: Literal["charts"] = "charts"


@dataclass(frozen=True)
class Command:
    """A line to be typed, and what it does."""

    command: str
    does: str = ""
    kind: Literal["command"] = "command"


@dataclass(frozen=True)
class Fold:
    """Blocks behind a line that opens them; open in print."""

    title: str
    blocks: Sequence[Block]
    kind: Literal["fold"] = "fold"


@dataclass(frozen=True)
class Card:
    """Blocks that belong together under a title, with a short badge; ``slug`` stands beside it in small type."""

    title: str
    blocks: Sequence[Block]
    badge: str = ""
    tone: Tone = ""
    slug: str = ""
    number: int = 0
    kind: Literal["card"] = "card"


Block = Text | Items | Table | Charts | Command | Fold | Card


@dataclass(frozen=True)
class Gain:
    """Error of one kind of reading before and after, as texts with their unit, and as shares of the largest for bars.

    before: empty where only one model was fitted. floor: what the dashed mark is, such as what
    the instrument alone makes; explained: how much of what lies
    above the floor is explained, in words; where: on which rows.
    """

    kind: str
    before: str
    after: str
    floor: str
    explained: str
    where: str
    shares: tuple[float, float, float]


@dataclass(frozen=True)
class Opening:
    """The first screen: gains, short lists under a title, what to do next, and the machine's drawing."""

    gains: Sequence[Gain] = ()
    lists: Sequence[Items] = ()
    steps: Sequence[Command | Text] = ()
    scene: Scene | None = None


@dataclass(frozen=True)
class Section:
    """A numbered part of the page; ``anchor`` is its address within it."""

    anchor: str
    title: str
    blocks: Sequence[Block] = field(default_factory=tuple)


@dataclass(frozen=True)
class Document:
    """The whole page. ``headline`` is the result in one sentence; ``cautions`` stand above it."""

    title: str
    headline: str
    tone: Tone
    facts: Sequence[tuple[str, str]]
    sections: Sequence[Section]
    cautions: Sequence[str] = ()
    opening: Opening = field(default_factory=Opening)
    rows: Sequence[int] = ()
    """Numbers, from 0, of the recording's rows that the k-th points of charts are of."""
