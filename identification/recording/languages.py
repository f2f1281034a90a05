"""Languages of robots and machine tools, recognised by what only their texts have, to be called what they are.

A table of points has none of these words, so what is not recognised is left to whoever reads tables.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from truepose.errors import InputError

HEAD_MOST: Final = 64 * 1024
"""Characters from the beginning of a file that are looked at."""


@dataclass(frozen=True)
class _Language:
    """What a text of a language has, and endings that no other file has."""

    pattern: re.Pattern[str]
    endings: tuple[str, ...] = ()


def _language(pattern: str, *endings: str) -> _Language:
    return _Language(re.compile(rf"(?im)^\s*+(?:{pattern})"), endings)


_LANGUAGES: Final[Mapping[str, _Language]] = {
    "FANUC TP program (LS)": _language(r"/PROG\b|/MN\s*$|/POS\s*$", ".ls", ".tp"),
    "Yaskawa INFORM job (JBI)": _language(r"/JOB\s*$|//(?:NAME|POS|INST)\b", ".jbi"),
    "Kawasaki AS or V+ program": _language(r"\.(?:PROGRAM|TRANS|JOINTS|REALS)\b", ".as", ".pg", ".v2"),
    "Staubli VAL 3 program": _language(
        r"<(?:Program|Programs|Database)\b[^>]*xmlns=\"[^\"]*(?:ProgramNameSpace|staubli)", ".pgx", ".dtx"
    ),
    "Mitsubishi MELFA BASIC program": _language(
        r"(?:\d+\s+)?(?:MOV|MVS|MVR2?|MVC)\s+[PJ]\w+|P\w+\s*=\s*\([^()\n]*\)\s*\(\s*\d+\s*,\s*\d+\s*\)"
    ),
    "Epson SPEL+ program": _language(r"FEND\s*$"),
    "Denso PAC program": _language(r"TAKEARM\b|(?:\d+\s+)?MOVE\s+[PLCS]\s*,", ".pac", ".pcs"),
    "Comau PDL2 program": _language(r"MOVE(?:FLY)?\s+(?:LINEAR|JOINT|CIRCULAR)?\s*TO\b", ".pdl"),
    "FANUC KAREL program": _language(r"PROGRAM\s+\w+\s*\n(?:.*\n){0,20}?\s*%|%NOLOCKGROUP\b", ".kl"),
    "Hyundai or Nachi job": _language(r"Program File Format Version\b|MOVEX\s+A="),
    "Doosan DRL program": _language(r"(?:\w+\s*=\s*)?(?:move[jlcs]x?\s*\(\s*)?pos[xj]\s*\(", ".drl"),
    "Heidenhain program": _language(r"(?:\d+\s+)?BEGIN PGM\b"),
    "APT or CLDATA file": _language(r"GOTO\s*/\s*[-+.\d]", ".apt", ".cls"),
    "G-code program": _language(
        r"(?:/ *)?(?:N *\d+ *)?G *0*\d+(?:\.\d)? *[A-Z] *[-+]?(?:\d|\.\d)|%\s*\n\s*(?:O\d+|:\d+)", ".gcode", ".ngc", ".mpf"
    ),
    "PolyScope program": _language(r"<URProgram\b", ".urp"),
}  # fmt: skip
_OURS: Final[Mapping[str, re.Pattern[str]]] = {
    "kuka": re.compile(r"(?im)^\s*+(?:&ACCESS\b|DEFDAT\s|(?:GLOBAL\s+)?DEF\s+\w+\s*\((?!.*\)\s*:))"),
    "rapid": re.compile(r"(?im)^\s*+MODULE\s+\w+|\b(?:CONST|PERS|VAR)\s+(?:robtarget|jointtarget)\s"),
    "urscript": re.compile(
        r"(?ms)\A(?!.*\bpos[xj]\s*\().*?^\s*+(?:def\s+\w+\s*\([^\n]*\)\s*:|(?:move[jlpc]|set_tcp)\s*\()"
    ),  # posx and posj are Doosan's
}
_TITLES: Final = {"kuka": "KUKA KRL program", "rapid": "ABB RAPID program", "urscript": "URScript program"}
_NO_TABLES: Final[Mapping[str, re.Pattern[str]]] = {
    "XML": re.compile(r"\A\s*<(?:\?xml|robot|mujoco|sdf)\b", re.IGNORECASE),
    "JSON": re.compile(r"\A\s*\{\s*\""),
    "a machine file": re.compile(r"(?m)^schema:\s*truepose/"),
}


def refuse_languages(text: str, where: str, ending: str = "") -> None:
    """Refuse the beginning of a text that is no table of rows. Raises InputError that says what it is."""
    own = own_language(text)
    found = other_language(text, ending) or (_TITLES[own] if own else None)
    if found is not None:
        found = f"{'an' if found[0] in 'AEIO' else 'a'} {found}"
    found = found or next((name for name, pattern in _NO_TABLES.items() if pattern.search(text)), None)
    if found is not None:
        raise InputError(f"{where}: found {found}, expected a table of rows below the names of its columns")


def other_language(text: str, ending: str = "") -> str | None:
    """Return the language of a text that no dialect reads, or None; ``ending`` is that of its file (``.ls``)."""
    by_ending = (title for title, one in _LANGUAGES.items() if ending.lower() in one.endings)
    if (title := next(by_ending, None)) is not None or own_language(text) is not None:
        return title
    head = text[:HEAD_MOST]
    return next((title for title, one in _LANGUAGES.items() if one.pattern.search(head)), None)


def own_language(text: str) -> str | None:
    """Return the name of the dialect that a text is written in, or None."""
    head = text[:HEAD_MOST]
    return next((name for name, pattern in _OURS.items() if pattern.search(head)), None)
