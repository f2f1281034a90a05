"""Files that are no tables of rows, by their words: robot programs and descriptions, to be called what they are."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from truepose.errors import InputError

_LANGUAGES: Final[Mapping[str, re.Pattern[str]]] = {
    name: re.compile(pattern, re.MULTILINE | re.IGNORECASE)
    for name, pattern in {
        "a FANUC TP program (.ls)": r"^\s*/(?:PROG\s|ATTR\s*$|MN\s*$)",
        "a Yaskawa INFORM job": r"^\s*/JOB\s*$",
        "G-code": r"^\s*(?:/?N\d+\s*)?(?:G\d{1,3}(?:\.\d)?\s*)+[XYZABCUVWIJKFRP]\s*[-+]?[\d.]",
        "a URScript program": r"^\s*(?:def\s+\w+\s*\(.*\)\s*:|(?:movej|movel|movep)\s*\()",
        "a KUKA KRL program": r"^\s*(?:&ACCESS\b|DEFDAT\s+\w|DEF\s+\w+\s*\()",
        "an ABB RAPID program": r"^\s*(?:MODULE\s+\w+\s*(?:\(|$)|(?:LOCAL\s+)?PROC\s+\w+\s*\()",
        "XML": r"\A\s*<(?:\?xml|robot|mujoco|sdf)\b",
        "JSON": r"\A\s*\{\s*\"",
        "a machine file": r"^schema:\s*truepose/",
    }.items()
}


def refuse_languages(text: str, where: str) -> None:
    """Refuse the beginning of a text that is no table. Raises InputError that says what it is."""
    found = next((name for name, pattern in _LANGUAGES.items() if pattern.search(text)), None)
    if found is not None:
        raise InputError(f"{where}: found {found}, expected a table of rows below the names of its columns")


__all__ = ["refuse_languages"]
