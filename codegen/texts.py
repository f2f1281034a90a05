"""Texts that are printed: identifiers, names and units as they may stand in each place, and the templates.

A machine file of a stranger names joints as it likes. Here each place gets a form in which no name ends the place that it
stands in, and C, C++ and Python get printable ASCII only, whatever a compiler takes its input for."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final

import jinja2

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


def identifiers(names: Sequence[str]) -> list[str]:
    """Tails of C identifiers: other characters become underscores; what then collides gets _2, _3 ..."""
    taken: set[str] = set()
    out = []
    plain = [re.sub(r"[^A-Za-z0-9_]", "_", name) for name in names]
    for name in plain:
        candidate, count = name, 1
        while candidate in taken or (count > 1 and candidate in plain):
            count += 1
            candidate = f"{name}_{count}"
        taken.add(candidate)
        out.append(candidate)
    return out


TEMPLATES = Path(__file__).parent / "templates"


@cache
def environment() -> jinja2.Environment:
    """Templates by their path below ``templates``; a name that a template reads and is not given is an error."""
    out = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    out.filters |= FILTERS
    return out


_TEMPLATES = {"kin.py": "kin.py.j2", "kin.hpp": "kin.hpp.j2", "sfun.c": "sfun.c.j2"}


def wrappers(context: Mapping[str, Any]) -> dict[str, str]:
    """Texts of ``wrappers/NAME_kin.py``, ``wrappers/NAME_kin.hpp`` and ``wrappers/NAME_sfun.c`` by file name.

    ``context`` says what the C says: ``name``, ``real``, ``joints`` (place, name, unit), ``parameters`` and
    ``drivers`` (name, identifier, unit), ``p0`` and ``z0`` (at least one number each).
    """
    return {
        f"wrappers/{context['name']}_{ending}": environment()
        .get_template(f"wrappers/{template}")
        .render(context)
        for ending, template in _TEMPLATES.items()
    }
