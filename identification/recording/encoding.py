"""How a text is encoded: UTF-8, UTF-16, else Latin-1. Nothing is guessed: bytes that may mean several texts are refused."""

from __future__ import annotations

import codecs
import io
from collections.abc import Iterator
from typing import BinaryIO, Final

from truepose.errors import InputError

MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
"""What an encoded text may begin with."""
_BLOCK: Final = 1 << 16
"""Bytes that are looked at together: few enough for the processor's cache."""
_CONTROLS: Final = bytes({*range(32)} - {*b"\t\n\v\f\r"})
_UNCLEAR: Final = bytes(range(0x80, 0xA0))
"""Letters in Windows-1252, nothing in Latin-1."""


def encoding_of(stream: BinaryIO, where: str) -> tuple[str, tuple[str, ...]]:
    """A file's encoding, and a note where it is no Unicode; the file is read a block at a time.

    Raises InputError for what is no text, or may be several; ``where`` opens messages.
    """
    encoding, notes = _marked(stream), tuple[str, ...]()
    try:
        control = _control(stream, encoding or "utf-8")
    except UnicodeDecodeError:
        if encoding is not None or any(_among(block, _UNCLEAR) for block in _blocks(stream)):
            raise InputError(
                f"{where}: cannot read the file: neither text in UTF-8, UTF-16 or Latin-1, nor Parquet, Excel or a bag"
            ) from None
        encoding, notes = "latin-1", (f"{where}: read as Latin-1: it is no text in UTF-8",)
        control = _control(stream, encoding)
    if control:
        raise InputError(
            f"{where}: cannot read the file: found the control character {control!r}, expected text"
        )
    return encoding or "utf-8", notes


def decoded(data: bytes, where: str) -> tuple[str, tuple[str, ...]]:
    """The text, with a note where it is no Unicode. Raises InputError like ``encoding_of``."""
    encoding, notes = encoding_of(io.BytesIO(data), where)
    return data.decode(encoding), notes


def _marked(stream: BinaryIO) -> str | None:
    """The encoding that the first bytes and the size tell; None where they do not."""
    size = stream.seek(0, io.SEEK_END)
    stream.seek(0)
    start = stream.read(4)
    marked = next((name for mark, name in MARKS if start.startswith(mark)), None)
    if marked is None and start[:2].count(0) == 1 and not size % 2:
        return "utf-16-le" if start[1:2] == b"\0" else "utf-16-be"
    return marked


def _control(stream: BinaryIO, encoding: str) -> str:
    """The first control character that no text has; empty where there is none. All of the file is decoded."""
    decoder, found = codecs.getincrementaldecoder(encoding)(), ""
    for block in _blocks(stream):
        text = decoder.decode(block, final=not block)
        if not found and _among(text.encode(), _CONTROLS):
            found = next(c for c in text if c in _CONTROLS.decode())
    return found


def _blocks(stream: BinaryIO) -> Iterator[bytes]:
    """The whole file, and an empty block behind its end."""
    stream.seek(0)
    while block := stream.read(_BLOCK):
        yield block
    yield b""


def _among(data: bytes, some: bytes) -> bool:
    """Whether one of ``some`` bytes is there."""
    return len(data.translate(None, some)) < len(data)
