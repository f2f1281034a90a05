"""C texts to functions of this process: compiled by the system's C compiler for this processor, and kept.

``load`` gives the library of a C text, or of several files, from the cache, or compiles it. ``NotCompiledError`` says why
there is none.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from truepose.codegen.evaluation.cache import library_cache
from truepose.codegen.evaluation.compiler import NotCompiledError, compiler_of

FLAGS = ("-std=c99", "-O2", "-march=native", "-fno-math-errno", "-shared", "-fPIC")
FUSED = {False: "-ffp-contract=off", True: "-ffp-contract=fast"}
_ONE = "source.c"


def load(
    source: str | Mapping[str, str], functions: Sequence[str] = (), *, fused: bool = False
) -> ctypes.CDLL:
    """The library of a C text, or of several by file name, ``*.c`` and the headers that they include by these names.

    ``functions`` must be in it. ``TRUEPOSE_CC`` names the compiler, with arguments or without, or none where it is empty.
    ``fused`` lets products be added without rounding, faster, but not digit for digit as CasADi does. Raises NotCompiledError.
    """
    flags = (*FLAGS, FUSED[fused])
    compiler = compiler_of(os.environ.get("TRUEPOSE_CC"), os.environ.get("PATH", ""))
    sources = {_ONE: source} if isinstance(source, str) else source
    texts = [part for item in sources.items() for part in item]
    making = "\0".join([*texts, compiler.path, *compiler.arguments, compiler.version, *flags, _processor()])
    key = hashlib.sha256(making.encode()).hexdigest()[:40]
    try:
        return library_cache().load(key, lambda path: compiler.build(sources, flags, path), functions)
    except OSError as exc:
        raise NotCompiledError(f"what {compiler.path} made cannot be loaded: {exc}") from None


@cache
def _processor() -> str:
    """What ``-march=native`` depends on: a cache may be shared by unlike machines."""
    told = [platform.machine(), platform.processor()]
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text(encoding="utf-8", errors="replace").splitlines()
        told += sorted(
            {line for line in lines if line.startswith(("flags", "Features", "model name", "CPU part"))}
        )
    return "\n".join(told)
