"""Texts of a machine file: its name, which its C has too, characters that all readers see, and where its schema is found.

Names go into tables, pages, comments of C and terminals. A control character there can end a comment or clear a screen, and
a mark that sets the direction of writing shows another order of the letters than a compiler reads.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from typing import Any, Final

from truepose.errors import InputError

LONGEST: Final = 63
"""Initial characters of an internal identifier that C99 guarantees to tell apart."""
_KEYWORDS: Final = (
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern", "float",
    "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed", "sizeof", "static",
    "struct", "switch", "typedef", "union", "unsigned", "void", "volatile", "while",
)  # fmt: skip
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


_HIDDEN: Final = frozenset(("Cc", "Cf", "Cs", "Co", "Zl", "Zp"))
"""Categories of Unicode: controls, formats (zero width, direction), surrogates, private use, ends of lines and paragraphs."""
_WRAPPED: Final = "computed"
"""A formula may go over several lines: it is read by its syntax, not shown as a name."""
_ENCODED: Final = "covariance"
"""Numbers of a fit, encoded in many lines; what it names is compared with names that were checked."""


def hidden_character(text: str) -> str | None:
    """The first character of a text that nobody sees, as ``U+202E RIGHT-TO-LEFT OVERRIDE``; None where there is none."""
    found = next((letter for letter in text if unicodedata.category(letter) in _HIDDEN), None)
    return None if found is None else f"U+{ord(found):04X} {unicodedata.name(found, '')}".rstrip()


def check_text(text: str, where: str) -> str:
    """The text. Raises InputError, which opens with ``where``, for one with a character that nobody sees."""
    found = hidden_character(text)
    if found is not None:
        raise InputError(f"{where}: found {found} in {text[:60]!a}, expected only characters that are seen")
    return text


def check_document(document: Mapping[str, Any], where: str) -> None:
    """The same of all keys and values of a document; messages name the field."""
    for key, value in document.items():
        check_text(str(key), where)
        if key != _ENCODED:
            _check_value(value, f"{where}: {key}", wrapped=False)


def _check_value(value: Any, where: str, *, wrapped: bool) -> None:
    if isinstance(value, str):
        check_text(" ".join(value.split()) if wrapped else value, where)
    elif isinstance(value, bytes):  # !!binary: would become a text unseen
        raise InputError(f"{where}: found binary data, expected a text or a number")
    elif isinstance(value, Mapping):
        for key, item in value.items():
            _check_value(item, f"{where}.{check_text(str(key), where)}", wrapped=key == _WRAPPED)
    elif isinstance(value, (list, tuple)):
        for k, item in enumerate(value):
            _check_value(item, f"{where}[{k}]", wrapped=wrapped)


MACHINE_SCHEMA: Final = "https://truepose.dev/schema/machine-1.json"
SCHEMA_LINE: Final = f"# yaml-language-server: $schema={MACHINE_SCHEMA}"
"""First line of a machine file: editors complete and check what follows. For truepose it is a comment."""
