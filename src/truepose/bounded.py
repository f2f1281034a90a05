"""Files that are read whole, up to a stated size."""

from __future__ import annotations

from pathlib import Path

from truepose.errors import InputError

MIB = 1 << 20


def read_at_most(path: Path, most: int) -> bytes:
    """The bytes of a file. Raises InputError for more than ``most`` (whole MiB), OSError like ``open`` and for what is none."""
    if path.exists() and not path.is_file() and not path.is_dir():  # it may never end, or never begin
        raise OSError(None, "not a file")
    with path.open("rb") as stream:
        data = stream.read(most + 1)
    if len(data) > most:
        raise InputError(
            f"{path}: cannot read the file: found more than {most // MIB} MiB, expected at most that"
        )
    return data
