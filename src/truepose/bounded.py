"""The limit of every file that is read, checked where it is opened."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from truepose.errors import InputError

FILE_BYTES: Final = 1 << 30
"""Bytes of an input file: 1 GiB."""


def check_input(path: Path) -> None:
    """Refuse what has no end, such as a device, and a file beyond the limit. Raises InputError."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise InputError(f"{path}: cannot read the file: expected a file, found a device or a pipe")
    if path.is_file() and path.stat().st_size > FILE_BYTES:
        raise InputError(
            f"{path}: cannot read the file: found {path.stat().st_size / 1e9:.2f} GB, "
            f"expected at most {FILE_BYTES / 1e9:.2f} GB"
        )


def read_input(path: Path) -> bytes:
    """Return the bytes of a file. Raises InputError as ``check_input``, OSError where it cannot be opened."""
    check_input(path)
    return path.read_bytes()
