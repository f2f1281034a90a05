"""C texts to functions of this process: compiled by the system's C compiler for this processor, and kept.

``load`` gives the library of a C text, or of several files, from the cache, or compiles it. ``NotCompiledError`` says why
there is none.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from truepose.codegen.evaluation.cache import library_cache

COMPILERS = ("cc", "gcc", "clang")
FLAGS = ("-std=c99", "-O2", "-march=native", "-fno-math-errno", "-shared", "-fPIC")
FUSED = {False: "-ffp-contract=off", True: "-ffp-contract=fast"}
PATIENCE = 600.0
"""Seconds after which a compiler is given up."""
_ONE = "source.c"


class NotCompiledError(Exception):
    """There is no compiled function; the text says why."""


@dataclass(frozen=True)
class Compiler:
    """A C compiler: its path, and what it says of its version."""

    path: str
    version: str

    def build(self, sources: Mapping[str, str], flags: Sequence[str], library: Path) -> None:
        """Write the library of C texts by file name, which are put beside it; those named ``*.c`` are compiled.

        Raises NotCompiledError with the first thing the compiler has to say.
        """
        files = {library.parent / name: text for name, text in sources.items()}
        units = [str(path) for path in files if path.suffix == ".c"]
        command = [self.path, *flags, *units, "-lm", "-o", str(library)]
        try:
            for path, text in files.items():
                path.write_text(text, encoding="utf-8", newline="\n")
            done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
        except (OSError, subprocess.TimeoutExpired) as exc:
            raise NotCompiledError(f"{self.path} failed: {exc}") from None
        if done.returncode != 0 or not library.exists():
            said = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr[:200])
            raise NotCompiledError(f"{self.path} failed: {said.strip() or f'exit code {done.returncode}'}")


def load(source: str | Mapping[str, str], *, fused: bool = False) -> ctypes.CDLL:
    """The library of a C text, or of several by file name, ``*.c`` and the headers that they include by these names.

    ``TRUEPOSE_CC`` names the compiler, or none where it is empty.
    ``fused`` lets products be added without rounding, faster, but not digit for digit as CasADi does. Raises NotCompiledError.
    """
    flags = (*FLAGS, FUSED[fused])
    compiler = _compiler(os.environ.get("TRUEPOSE_CC"), os.environ.get("PATH", ""))
    sources = {_ONE: source} if isinstance(source, str) else source
    texts = [part for item in sources.items() for part in item]
    making = "\0".join([*texts, compiler.path, compiler.version, *flags, _processor()])
    key = hashlib.sha256(making.encode()).hexdigest()[:40]
    try:
        return library_cache().load(key, lambda path: compiler.build(sources, flags, path))
    except OSError as exc:
        raise NotCompiledError(f"what {compiler.path} made cannot be loaded: {exc}") from None


@cache
def _compiler(asked: str | None, path: str) -> Compiler:
    if asked == "":
        raise NotCompiledError("TRUEPOSE_CC is empty")
    names = COMPILERS if asked is None else (asked,)
    for name in names:
        found = shutil.which(name, path=path)
        if found:
            return Compiler(found, _version(found))
    raise NotCompiledError(f"found no C compiler ({', '.join(names)})")


def _version(path: str) -> str:
    try:
        told = subprocess.run([path, "--version"], capture_output=True, text=True, timeout=60, check=True)
    except (OSError, subprocess.SubprocessError) as exc:
        raise NotCompiledError(f"{path} --version failed: {exc}") from None
    return told.stdout


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


__all__ = ["NotCompiledError", "load"]
