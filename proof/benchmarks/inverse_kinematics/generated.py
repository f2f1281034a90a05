"""The generated C: written, compiled with its driver, timed alone, in batches, for all branches and from Python."""

from __future__ import annotations

import ctypes
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truepose.codegen.c import generate
from truepose.codegen.printer import Real
from truepose.models.load import load_machine

from .machine import pinned, run
from .outcome import Timing, median_of
from .problems import ProblemFiles, Problems

Array = NDArray[np.float64]
DRIVER = Path(__file__).parent / "drivers" / "generated.c"
Flags = tuple[str, ...]
NATIVE: Flags = ("-O3", "-march=native", "-ffp-contract=fast")
PLAIN: Flags = ("-O2",)
_STANDARD = ("-std=c99", "-D_POSIX_C_SOURCE=199309L")


@dataclass(frozen=True)
class Source:
    """A machine's C in ``folder``: joints, how many branches NAME_ik_all gives at most (0: not declared), batches."""

    name: str
    folder: Path
    real: Real
    joints: int
    branches: int
    batch: bool

    @property
    def files(self) -> list[Path]:
        names = ("kin", "batch") if self.batch else ("kin",)
        return [self.folder / f"{self.name}_{part}.c" for part in names]

    def missing(self) -> list[str]:
        """What this C has not, and the tables therefore lack."""
        lacks = [] if self.batch else [f"no {self.name}_batch.c was generated: nothing is timed in batches"]
        return (
            lacks
            if self.branches
            else [*lacks, f"{self.name}_ik_all is not declared: no branches of truepose"]
        )


@dataclass(frozen=True)
class Program:
    """The driver of one machine, compiled with ``flags``."""

    source: Source
    path: Path
    flags: tuple[str, ...]


def write(machine: Path, folder: Path, real: Real) -> Source:
    """Generate the C of a machine file into ``folder/<name>``."""
    loaded = load_machine(machine)
    target = folder / loaded.name
    drawing = loaded.file.nominal if loaded.file else {}
    generate(loaded, target, real, nominal=drawing or None)
    header = (target / f"{loaded.name}_kin.h").read_text()
    branches = _define(header, loaded.name, "BRANCHES") if f"{loaded.name}_ik_all(" in header else 0
    batch = (target / f"{loaded.name}_batch.c").exists()
    return Source(loaded.name, target, real, _define(header, loaded.name, "N"), branches, batch)


def build(source: Source, flags: Sequence[str], compiler: str = "gcc") -> Program:
    """The driver with the machine's C, compiled with ``flags``."""
    path = source.folder / ("driver" + "".join(flags).replace("=", "-"))
    name = source.name
    defines = [f"-DMACHINE={name}", f'-DKIN="{name}_kin.h"']
    defines += [f'-DBATCH="{name}_batch.h"'] if source.batch else []
    defines += ["-DHAS_ALL"] if source.branches else []
    files = [str(file) for file in (DRIVER, *source.files)]
    run([compiler, *_STANDARD, *flags, *defines, f"-I{source.folder}", *files, "-lm", "-o", str(path)])
    return Program(source, path, tuple(flags))


def timed(program: Program, mode: str, files: ProblemFiles, repeats: int, core: int | None) -> Timing:
    """Time a mode of the driver: ``one``, ``batch`` or ``all``; a row of the output is the code, then the numbers."""
    out = program.path.with_suffix(".out")
    words: list[str | Path] = [program.path, mode, files.targets, files.guesses, out, str(repeats)]
    seconds = median_of(pinned(words, core))
    width = (
        2 + program.source.branches * program.source.joints if mode == "all" else 1 + program.source.joints
    )
    return Timing(seconds, np.fromfile(out).reshape(-1, width))


def library(source: Source, flags: Sequence[str] = NATIVE, compiler: str = "gcc") -> Path:
    """The machine's C alone as a shared library."""
    path = source.folder / f"lib{source.name}.so"
    files = [str(file) for file in source.files]
    run([compiler, "-std=c99", *flags, "-shared", "-fPIC", *files, "-lm", "-o", str(path)])
    return path


def from_python(source: Source, shared: Path, problems: Problems, repeats: int) -> Timing:
    """One call of NAME_ik a pose through ctypes, with buffers and their addresses prepared; codes and joints."""
    solve = getattr(ctypes.CDLL(str(shared)), f"{source.name}_ik")
    solve.argtypes, solve.restype = [ctypes.c_void_p] * 5, ctypes.c_int
    kind = np.float64 if source.real == "double" else np.float32
    targets = np.ascontiguousarray(problems.targets[:, :3], dtype=kind)
    guesses = np.ascontiguousarray(problems.guesses, dtype=kind)
    joints = np.full(guesses.shape, np.nan, dtype=kind)
    calls = list(zip(*(_addresses(rows) for rows in (targets, guesses, joints)), strict=True))
    seconds = []
    for _ in range(repeats):
        start = time.process_time()
        codes = [solve(None, None, target, guess, q) for target, guess, q in calls]
        seconds.append((time.process_time() - start) / len(calls))
    return Timing(float(np.median(seconds)), np.column_stack([codes, joints.astype(float)]))


def _addresses(rows: NDArray[Any]) -> list[int]:
    return [rows.ctypes.data + k * rows.strides[0] for k in range(len(rows))]


def _define(header: str, name: str, what: str) -> int:
    found = re.search(rf"#define {name}_{what} (\d+)", header)
    if found is None:
        raise RuntimeError(f"{name}_kin.h: found no {name}_{what}, expected one")
    return int(found.group(1))
