"""Texts that are printed: identifiers, names and units as they may stand in each place, the templates, and what is cut off.

A machine file of a stranger names joints as it likes. Here each place gets a form in which no name ends the place that it
stands in, and C, C++ and Python get printable ASCII only, whatever a compiler takes its input for.

``pruned`` takes out of generated C what nothing in it uses: static functions, tables, macros and types. It reads C as the
templates write it: what stands outside of functions begins in the first column, and a function ends with a brace there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
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


_WORD = re.compile(r"[A-Za-z_]\w*")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_EMPTY = re.compile(
    r"(?:^/\*(?:[^*]|\*(?!/))*\*/\n)?^#if[^\n]*\n(?:\n|#el(?:se|if)[^\n]*\n)*#endif[^\n]*\n", re.MULTILINE
)
_ATTRIBUTE = re.compile(r"__attribute__ *\(\((?:[^()]|\((?:[^()]|\([^()]*\))*\))*\)\)")
_HEADING = "/* ----"


@dataclass(frozen=True)
class _Piece:
    """Text outside of functions that stands or goes as a whole; ``names`` that it defines, ``words`` that it reads.

    root: whether it stays in any case.
    """

    text: str
    names: frozenset[str]
    words: frozenset[str]
    root: bool


def pruned(text: str, name: str) -> str:
    """The text of a C file of the machine ``name`` with what its interface, and `main`, come to use."""
    pieces = list(_pieces(text, name))
    defined: dict[str, list[_Piece]] = {}
    for piece in pieces:
        for word in piece.names:
            defined.setdefault(word, []).append(piece)
    kept, pending = set[_Piece](), [piece for piece in pieces if piece.root]
    while pending:
        piece = pending.pop()
        if piece not in kept:
            kept.add(piece)
            pending += [other for word in piece.words for other in defined.get(word, ())]
    return _tidy([piece.text for piece in pieces if piece in kept])


def _tidy(texts: list[str]) -> str:
    """The texts in a file, without headings of nothing, empty conditions and gaps."""
    held = [
        text
        for text, after in zip(texts, [*texts[1:], _HEADING], strict=True)
        if not (text.startswith(_HEADING) and after.startswith(_HEADING))
    ]
    out = "\n".join(held)
    while _EMPTY.search(out):
        out = _EMPTY.sub("", out)
    return re.sub(r"\n{3,}", "\n\n", out).rstrip("\n") + "\n"


def _pieces(text: str, name: str) -> Iterator[_Piece]:
    lines: list[str] = []
    for line in text.split("\n"):
        lines.append(line)
        whole = "\n".join(lines)
        if _complete(whole):
            yield _piece(whole, name)
            lines = []
    if lines:
        yield _piece("\n".join(lines), name)


def _complete(text: str) -> bool:
    """Whether a piece ends here: a comment is part of what follows it at once."""
    bare = _COMMENT.sub("", text)
    if "/*" in bare:
        return False
    if bare.lstrip().startswith("#"):
        return not text.endswith("\\")
    if not bare.strip():
        return text.endswith("\n") or not text
    ended = bare.rstrip().endswith((";", "}"))
    return ended and bare.count("{") == bare.count("}")


def _piece(text: str, name: str) -> _Piece:
    bare = _COMMENT.sub("", text).strip()
    words = frozenset(_WORD.findall(bare))
    if bare.startswith("#"):
        macro = re.match(r"#define (\w+)", bare)
        own = {macro.group(1)} if macro else set[str]()
        return _Piece(text, frozenset(own), words - own, not macro)
    own = _defined(bare)
    return _Piece(text, frozenset(own), words - own, not own or _is_interface(bare, own, name))


def _is_interface(bare: str, own: set[str], name: str) -> bool:
    public = bare.startswith(("int ", "void ", "const ")) and any(word.startswith(f"{name}_") for word in own)
    return public or "main" in own


def _defined(bare: str) -> set[str]:
    """Names that a piece of code defines: constants of an enumeration, a type, or functions and tables."""
    if bare.startswith("enum"):
        return set(re.findall(r"(?:\{|,)\s*(\w+)", bare))
    if bare.startswith("typedef"):
        return {_WORD.findall(_ATTRIBUTE.sub("", bare))[-1]}
    if not bare or bare.startswith("extern"):
        return set()
    head = _ATTRIBUTE.sub("", bare).partition("{")[0]
    function = re.search(r"(\w+)\(", head)
    if function and "=" not in head:
        return {function.group(1)}
    return set(re.findall(r"(\w+)(?:\[[^\]]*\])* *(?:=|;|$)", head))
