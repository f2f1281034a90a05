"""The dialects by name and by a file's ending and words."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from truepose.errors import InputError
from truepose.files import read_input
from truepose.identification.leaves.programs.kuka import Kuka
from truepose.identification.leaves.programs.points import Points
from truepose.identification.leaves.programs.rapid import Rapid
from truepose.identification.leaves.programs.reader import Language
from truepose.identification.leaves.programs.urscript import UrScript
from truepose.identification.recording.languages import other_language, own_language

Dialect = Language | Points
DIALECTS: Mapping[str, Dialect] = {d.name: d for d in (Kuka(), Rapid(), UrScript(), Points())}
_SUFFIXES = {
    **dict.fromkeys((".src", ".dat", ".sub"), "kuka"),
    **dict.fromkeys((".mod", ".modx", ".prg", ".sys", ".sysx"), "rapid"),
    **dict.fromkeys((".script", ".urscript"), "urscript"),
}
_TABLES = {".csv", ".parquet", ".pq", ".xlsx", ".xls"}
"""Endings of tables: what they say is not looked at."""
_KRL = re.compile(r"(?im)^\s*(?:&ACCESS|DEFDAT|DEF\s)|\{\s*(?:X|A1)\s+[-+.\d]")
_BESIDE = {".src": ".dat", ".dat": ".src"}


def dialect_of(path: Path, name: str | None = None) -> Dialect | None:
    """The dialect that is named, or that a file's ending or words mean; None where it means a table.

    A .dat is KUKA's where its text is. Raises InputError for a name that there is not, and for a program in another language.
    """
    if name is not None:
        if name not in DIALECTS:
            raise InputError(f"--dialect: found {name!r}, expected {', '.join(DIALECTS)}")
        return DIALECTS[name]
    ending = path.suffix.lower()
    known = _SUFFIXES.get(ending)
    head = _bytes(path).decode("latin-1") if path.is_file() and ending not in _TABLES else ""
    if (other := other_language(head, ending)) is not None:
        titles = ", ".join(d.title for d in DIALECTS.values())
        raise InputError(
            f"{path}: found another language, a {other}, expected a program in one of {titles}; of other programs export "
            "the poses as a table, x y z rx ry rz"
        )
    if ending == ".dat" and not _KRL.search(head):
        return None
    known = known or own_language(head)
    return None if known is None else DIALECTS[known]


def text_of(path: Path) -> str:
    """A program's text, one character a byte. Raises InputError for UTF-16, and for what cannot be read."""
    data = _bytes(path)
    if data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data:
        raise InputError(
            f"{path}: found UTF-16 or binary data, expected a program in ASCII, Latin-1 or UTF-8"
        )
    return data.decode("latin-1")


def beside(path: Path) -> str | None:
    """The text of the file that belongs to a KUKA program: its .dat to a .src, and the other way."""
    other = _BESIDE.get(path.suffix.lower())
    if other is None:
        return None
    for found in sorted(path.parent.glob("*")):
        if found.stem == path.stem and found.suffix.lower() == other:
            return text_of(found)
    return None


def _bytes(path: Path) -> bytes:
    try:
        return read_input(path)
    except OSError as exc:
        raise InputError(f"{path}: cannot read the file: {exc.strerror}") from exc
