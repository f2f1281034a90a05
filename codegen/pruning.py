"""Generated C without what nothing in it uses: static functions, tables, macros and types.

It reads C as the templates write it: what stands outside of functions begins in the first column, and a function ends
with a brace in the first column.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

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
