"""Where rows come from: the digest of a file, and the day on which it says that it was recorded."""

from __future__ import annotations

import codecs
import datetime
import hashlib
import re
from pathlib import Path

_COMMENTS = ("#", "!", "%", "*", "//")
_DATE = re.compile(r"(?<!\d)((?:19|20)\d\d-\d\d-\d\d)(?!\d)")
_FIELD = re.compile(r"[\s,;]+")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_LINES, _BYTES = 40, 1 << 16
"""Lines and bytes at the head of a file in which a date is looked for."""


def digest_of(path: Path | str) -> str:
    """SHA-256 of a file in hexadecimal; empty for what is no file, such as a table in memory."""
    file = Path(path)
    if not file.is_file():
        return ""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def recorded_on(path: Path | str) -> str:
    """The first date (2026-03-14) in the comments above a text's data; empty where there is none.

    A file's own time stamp says when it was copied, not when it was recorded.
    """
    file = Path(path)
    if not file.is_file():
        return ""
    with file.open("rb") as stream:
        head = _text(stream.read(_BYTES))
    for line in head.splitlines()[:_LINES]:
        if line.lstrip().startswith(_COMMENTS):
            dates = [found for found in _DATE.findall(line) if _is_day(found)]
            if dates:
                return str(dates[0])
        elif _is_data(line):
            break
    return ""


def _text(head: bytes) -> str:
    """The head of a file as text, whose dates and comments are of ASCII in any case; empty for one that is none."""
    for mark, name in _MARKS:
        if head.startswith(mark):
            return head.decode(name, errors="ignore")
    return "" if b"\0" in head else head.decode("latin-1")


def _is_day(text: str) -> bool:
    try:
        datetime.date.fromisoformat(text)
    except ValueError:
        return False
    return True


def _is_data(line: str) -> bool:
    """Whether a line has two numbers and more: a heading has none."""
    return sum(_NUMBER.fullmatch(field) is not None for field in _FIELD.split(line)) >= 2


__all__ = ["digest_of", "recorded_on"]
