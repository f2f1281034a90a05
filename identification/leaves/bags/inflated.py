"""How large compressed data is, found by inflating it piece by piece: a few bytes may say anything of gigabytes."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any, BinaryIO, Final

_PIECE: Final = 1 << 16
_MOST_OUT: Final = 1 << 20


def inflated_size(stream: BinaryIO, size: int, compression: str, most: int) -> int:
    """Bytes that the next ``size`` bytes of a stream inflate to; more than ``most`` are not counted further.

    -1 for data that is broken or cut off. 0 for a way of compression that is not known: who reads it says so.
    """
    start = _starts().get(compression)
    if start is None:
        return 0
    engine, count, left, data = start(), 0, size, b""
    while count <= most:
        if engine.needs_input and not engine.eof:
            if not data:
                data = stream.read(min(_PIECE, left))
                left -= len(data)
            if not data:
                return -1
        try:
            count += len(engine.decompress(data, max_length=_MOST_OUT))
        except Exception:  # each library raises what it likes for broken data
            return -1
        data = b""
        if engine.eof:
            if not engine.unused_data and not left:
                break
            data, engine = engine.unused_data or b"", start()
    return count


def _starts() -> dict[str, Callable[[], Any]]:
    """What inflates, by name; the libraries are those that rosbags brings."""
    import bz2

    lz4 = importlib.import_module("lz4.frame")
    zstd = _zstd()
    return {
        "lz4": lz4.LZ4FrameDecompressor,
        "zstd": zstd.ZstdDecompressor,
        "bz2": bz2.BZ2Decompressor,
    }


def _zstd() -> Any:
    try:
        return importlib.import_module("compression.zstd")
    except ImportError:
        return importlib.import_module("backports.zstd")
