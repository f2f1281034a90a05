"""What a machine may be called: files and functions of its C have its name as it is written."""

from __future__ import annotations

import re
from typing import Final

from truepose.errors import InputError

LONGEST: Final = 63
"""Initial characters of an internal identifier that C99 guarantees to tell apart."""
_KEYWORDS: Final = [
    "auto",
    "break",
    "case",
    "char",
    "const",
    "continue",
    "default",
    "do",
    "double",
    "else",
    "enum",
    "extern",
    "float",
    "for",
    "goto",
    "if",
    "inline",
    "int",
    "long",
    "register",
    "restrict",
    "return",
    "short",
    "signed",
    "sizeof",
    "static",
    "struct",
    "switch",
    "typedef",
    "union",
    "unsigned",
    "void",
    "volatile",
    "while",
]
NAMED_SO: Final = rf"^[A-Za-z][A-Za-z0-9_]{{0,{LONGEST - 1}}}$"
"""The same for a JSON Schema, keywords of C aside."""
EXPECTED: Final = (
    f"a name that its C can have, at most {LONGEST} letters a-z A-Z, digits and underscores, a letter first"
)


def nearest_name(text: str) -> str:
    """Return the name nearest to a text that a machine may have; the text itself where it may."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", text).lstrip("_")
    if not plain[:1].isalpha() or plain in _KEYWORDS:
        plain = f"machine_{plain}".rstrip("_")
    return plain[:LONGEST]


def check_machine_name(name: str) -> str:
    """Return the name. Raises InputError if C cannot have it."""
    if nearest_name(name) != name:
        raise InputError(f"name: found {name!r}, expected {EXPECTED}: {nearest_name(name)}")
    return name


__all__ = ["EXPECTED", "LONGEST", "NAMED_SO", "check_machine_name", "nearest_name"]
