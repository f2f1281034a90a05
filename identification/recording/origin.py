"""Where rows come from: the digest of a file, and the day on which it says that it was recorded."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

_COMMENTS = (b"#", b"!", b"/", b"%", b";")
_DATE = re.compile(rb"\b((?:19|20)\d\d-(?:0[1-9]|1[0-2])-(?:0[1-9]|[12]\d|3[01]))\b")
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
        head = stream.read(_BYTES).splitlines()[:_LINES]
    found = (_DATE.search(line) for line in head if line.lstrip().startswith(_COMMENTS))
    return next((match[1].decode() for match in found if match), "")


__all__ = ["digest_of", "recorded_on"]
