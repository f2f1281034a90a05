"""Where rows come from: the digest of a file, and what its comments say: the day of recording, and that rows are shuffled."""

from __future__ import annotations

import datetime
import hashlib
import re
from itertools import takewhile
from pathlib import Path

_COMMENTS = ("#", "!", "%", "*", "//")
_DATE = re.compile(r"(?<!\d)((?:19|20)\d\d-\d\d-\d\d)(?!\d)")
_SHUFFLED = re.compile(r"\border\s*[:=]\s*shuffled\b", re.IGNORECASE)
_FIELD = re.compile(r"[\s,;]+")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_LINES, _LETTERS = 40, 1 << 16
"""Lines and characters at the head of a file in which comments are looked for."""


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal; empty for what is no file."""
    if not path.is_file():
        return ""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def recorded_on(text: str) -> str:
    """Return the first date (2026-03-14) in the comments above a text's data; empty where there is none.

    A file's own time stamp says when it was copied, not when it was recorded.
    """
    dates = (found for line in _comments(text) for found in _DATE.findall(line) if _is_day(found))
    return str(next(dates, ""))


def says_shuffled(text: str) -> bool:
    """Return True if a comment above a text's data says ``order: shuffled``: rows are no visits one after the other."""
    return any(_SHUFFLED.search(line) for line in _comments(text))


def _comments(text: str) -> list[str]:
    """Return the comments above a text's data."""
    lines = text[:_LETTERS].splitlines()[:_LINES]
    above = takewhile(lambda line: _is_comment(line) or not _is_data(line), lines)
    return [line for line in above if _is_comment(line)]


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def _is_day(text: str) -> bool:
    try:
        datetime.date.fromisoformat(text)
    except ValueError:
        return False
    return True


def _is_data(line: str) -> bool:
    """Return True if a line has two numbers and more: a heading has none."""
    return sum(_NUMBER.fullmatch(field) is not None for field in _FIELD.split(line)) >= 2
