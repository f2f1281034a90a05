"""Where rows come from: the digest of a file, and what its comments say: the day of recording, and that rows are shuffled."""

from __future__ import annotations

import datetime
import hashlib
import re
from itertools import takewhile
from pathlib import Path

from truepose.identification.recording.encoding import MARKS

_COMMENTS = ("#", "!", "%", "*", "//")
_DATE = re.compile(r"(?<!\d)((?:19|20)\d\d-\d\d-\d\d)(?!\d)")
_SHUFFLED = re.compile(r"\border\s*[:=]\s*shuffled\b", re.IGNORECASE)
_FIELD = re.compile(r"[\s,;]+")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_LINES, _BYTES = 40, 1 << 16
"""Lines and bytes at the head of a file in which comments are looked for."""


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
    dates = (found for line in _comments(path) for found in _DATE.findall(line) if _is_day(found))
    return str(next(dates, ""))


def says_shuffled(path: Path | str) -> bool:
    """Whether a comment above a text's data says ``order: shuffled``: rows are no visits one after the other."""
    return any(_SHUFFLED.search(line) for line in _comments(path))


def _comments(path: Path | str) -> list[str]:
    """The comments above a text's data; none of what is no file."""
    file = Path(path)
    if not file.is_file():
        return []
    with file.open("rb") as stream:
        lines = _text(stream.read(_BYTES)).splitlines()[:_LINES]
    above = takewhile(lambda line: _is_comment(line) or not _is_data(line), lines)
    return [line for line in above if _is_comment(line)]


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def _text(head: bytes) -> str:
    """The head of a file as text, whose dates and comments are of ASCII in any case; empty for one that is none."""
    for mark, name in MARKS:
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
