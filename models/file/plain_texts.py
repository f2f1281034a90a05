"""Texts of a machine file that everybody sees as they are: nothing invisible, and nothing that turns the line around.

Names go into tables, pages, comments of C and terminals. A control character there can end a comment or clear a screen, and
a mark that sets the direction of writing shows another order of the letters than a compiler reads.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Mapping
from typing import Any, Final

from truepose.errors import InputError

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


def check_texts(texts: Iterable[str], where: str) -> None:
    """The same of several."""
    for text in texts:
        check_text(text, where)


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
