"""Names and units as they may stand in generated texts: in comments, in strings, and in Markdown.

A machine file of a stranger names joints as it likes. Here each place gets a form in which no name ends the place that it
stands in, and C, C++ and Python get printable ASCII only, whatever a compiler takes its input for.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Final

_MARKS: Final = re.compile(r"[\\`*\[\]|]|(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])")
"""What Markdown reads as more than a letter; an underscore within a word is one."""


def comment(text: str) -> str:
    """A text that may stand inside a C comment, with more text of the comment after it."""
    line = "".join(_plain(letter) for letter in re.sub(r"\s+", " ", text))
    line = re.sub(
        r"\?(?=\?)", "? ", line
    )  # two of them may begin a trigraph, and one of those is a backslash
    return line.replace("*/", "* /").replace("/*", "/ *").rstrip("\\")


def c_string(text: str) -> str:
    """A string literal of C and C++ that holds the text in UTF-8."""
    line = "".join(_octal(byte) for byte in text.encode("utf-8", "surrogatepass"))
    return '"' + re.sub(r"(?<=\?)\?", r"\\?", line) + '"'


def python_string(text: str) -> str:
    """A string literal of Python."""
    quoted = "".join(f"\\{letter}" if letter in '"\\' else _plain(letter) for letter in text)
    return f'"{quoted}"'


def markdown(text: str) -> str:
    """A text of one line in Markdown, in a table too: shown as it is, and never HTML."""
    line = "".join(
        letter if ord(letter) > 0x9F and letter.isprintable() else _plain(letter) for letter in _line(text)
    )
    line = line.replace("&", "&amp;").replace("<", "&lt;")
    return _MARKS.sub(lambda mark: f"\\{mark[0]}", line)


def code_span(text: str) -> str:
    """The same as code; a text that has a mark of code in it is shown without being one."""
    plain = not set(text) & set("`|\\") and text.isprintable() and text == text.strip() != ""
    return f"`{text}`" if plain else markdown(text)


def _line(text: str) -> str:
    return re.sub(r"\s+", " ", text)


def _plain(letter: str) -> str:
    """A printable character of ASCII as it is, another as Python writes it: \\u00e4."""
    return (
        letter
        if " " <= letter <= "~"
        else f"\\u{ord(letter):04x}"
        if ord(letter) < 0x10000
        else f"\\U{ord(letter):08x}"
    )


def _octal(byte: int) -> str:
    """A byte in a string of C: three octal digits end where they end, whatever follows."""
    return chr(byte) if 0x20 <= byte < 0x7F and byte not in b'"\\' else f"\\{byte:03o}"


FILTERS: Final[Mapping[str, Callable[[str], str]]] = {
    "comment": comment,
    "c_string": c_string,
    "python_string": python_string,
    "markdown": markdown,
    "code_span": code_span,
}
"""The same by the names that templates use."""
