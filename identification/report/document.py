"""What a page is made of: sections of paragraphs, lists, tables, plots and cards, free of any markup."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

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
    """A table; columns after ``text_columns`` hold numbers and are set to the right."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    text_columns: int = 1
    kind: Literal["table"] = "table"


@dataclass(frozen=True)
class Plot:
    """A plotly figure with a caption that says what to see."""

    figure: Any
    caption: str
    kind: Literal["plot"] = "plot"


@dataclass(frozen=True)
class Card:
    """Blocks that belong together under a title, with a short badge."""

    title: str
    blocks: Sequence[Text | Items | Table | Plot]
    badge: str = ""
    tone: Tone = ""
    kind: Literal["card"] = "card"


Block = Text | Items | Table | Plot | Card


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
