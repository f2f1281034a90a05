"""The test program of a target: driver, start and linker script beside generated C, compiled and linked."""

from __future__ import annotations

import csv
import math
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from truepose.arrays import Array
from truepose.codegen.leaves.embedded.toolchain import Target, Toolchain, run
from truepose.codegen.printer import Real, literal
from truepose.codegen.texts import TEMPLATES, environment
from truepose.errors import InputError

_DEGREE = math.radians(1.0)
_SHARE_OF_TURN, _SHARE = 0.02, 0.005
_AWAY = 100.0


@dataclass(frozen=True)
class Source:
    """Generated C as it lies in ``directory``.

    joints (m, n)   of the test vectors, in the units of the interface
    poses (m, 12)   of the tool there, 3x4 row-major [R|p], mm
    units (n,)      of the joints, "rad", "mm" or another
    """

    directory: Path
    name: str
    real: Real
    units: tuple[str, ...]
    joints: Array
    poses: Array

    @property
    def remembers(self) -> bool:
        """Whether drivers that remember are followed by ``NAME_state.c``."""
        return (self.directory / f"{self.name}_state.c").is_file()

    @property
    def aside(self) -> Array:
        """(n,) how far a warm guess stands from the solution: 1 deg, or for lengths 0.5 % of what the vectors span."""
        span = np.ptp(self.joints, axis=0)
        turning = np.array([unit == "rad" for unit in self.units])
        away: Array = np.where(turning, np.minimum(_DEGREE, _SHARE_OF_TURN * span), _SHARE * span)
        return away

    @property
    def far(self) -> float:
        """A distance (mm) that no pose of the machine is away from another."""
        return _AWAY * (1.0 + float(np.max(np.linalg.norm(self.poses[:, 3::4], axis=1))))


def read_source(directory: Path, name: str | None = None) -> Source:
    """Read header and test vectors of ``name`` (default: the one machine in ``directory``).

    Raises InputError where a file is missing or is not what truepose writes.
    """
    headers = sorted(directory.glob(f"{name or '*'}_kin.h"))
    if len(headers) != 1:
        raise InputError(
            f"{directory}: found {len(headers)} files {name or 'NAME'}_kin.h, expected one of generated C"
        )
    header = headers[0].read_text(encoding="utf-8")
    name = headers[0].name.removesuffix("_kin.h")
    real = re.search(rf"^typedef (double|float) {re.escape(name)}_real;", header, re.MULTILINE)
    size = re.search(rf"^#define {re.escape(name)}_N (\d+)", header, re.MULTILINE)
    listed = header.partition("\n   p: ")[0]
    units = re.findall(r"^ +\d+  .*? \[(.*?)\]", listed, re.MULTILINE)
    if not real or not size or len(units) != int(size.group(1)):
        raise InputError(
            f"{headers[0]}: expected type, number and units of the joints as truepose writes them"
        )
    joints, poses = _vectors(directory / "test_vectors.csv", len(units))
    return Source(directory, name, cast(Real, real.group(1)), tuple(units), joints, poses)


def _vectors(file: Path, n: int) -> tuple[Array, Array]:
    try:
        rows = list(csv.reader(file.read_text(encoding="utf-8").splitlines()))[1:]
        table = np.array([[float(value) for value in row] for row in rows])
    except (OSError, ValueError) as exc:
        raise InputError(f"{file}: cannot read the test vectors: {exc}") from exc
    if table.ndim != 2 or table.shape[1] != n + 12 or not np.isfinite(table).all():
        raise InputError(f"{file}: found a table {table.shape}, expected {n + 12} finite numbers a row")
    return table[:, :n], table[:, n:]


STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror")
_SECTIONS = ("-ffunction-sections", "-fdata-sections")
_FRAMES = "-fcallgraph-info=su"
LONG_LOOP = 3_000_000
"""Turns of the longest loop of known cost; longer than any inverse is expected to take."""


@dataclass(frozen=True)
class Sizes:
    """Bytes: code and constants, initialised data, zeroed data."""

    text: int
    data: int
    bss: int


@dataclass(frozen=True)
class Compiler:
    """How C is compiled for one target: its flags, warnings as errors, one optimisation."""

    tools: Toolchain
    target: Target
    optimisation: str

    @property
    def flags(self) -> tuple[str, ...]:
        """Flags of every C file; what single precision would quietly compute in double is an error."""
        promoted = ("-Wdouble-promotion",) if self.target.real == "float" else ()
        return (*self.target.flags, *STRICT, *promoted, self.optimisation)

    def compile(self, source: Path, out: Path, extra: Sequence[str] = ()) -> None:
        """An object file; raises InputError with the compiler's words."""
        self._gcc(*self.flags, *extra, f"-I{source.parent}", "-c", str(source), "-o", str(out))

    def assemble(self, source: Path, out: Path) -> None:
        """An object file of assembly."""
        self._gcc(*self.target.flags, "-c", str(source), "-o", str(out))

    def link(self, objects: Sequence[Path], out: Path, extra: Sequence[str]) -> None:
        """A program of ``objects`` and the C library, without start files and what nothing refers to."""
        options = ("-nostartfiles", "-Wl,--gc-sections", *extra)
        self._gcc(*self.target.flags, *options, *(str(o) for o in objects), "-lm", "-o", str(out))

    def sizes(self, file: Path) -> Sizes:
        """What an object file or program takes."""
        listed = run([str(self.tools.size), str(file)]).stdout.splitlines()
        return Sizes(*(int(number) for number in listed[1].split()[:3]))

    def _gcc(self, *arguments: str) -> None:
        run([str(self.tools.gcc), *arguments], doing=f"{self.tools.gcc.name} for {self.target.title}")


def build(source: Source, compiler: Compiler, where: Path) -> Path:
    """Compile and link the test program in the folder ``where``; the program's path.

    It leaves ``kin.o`` there, and ``kin.ci`` with its frames; and ``state.o`` where drivers remember.
    """
    script = write_program(source, compiler.target, where)
    objects = [where / f"{part}.o" for part in ("start", "driver", "kin")]
    if source.remembers:
        objects.append(where / "state.o")
        compiler.compile(where / f"{source.name}_state.c", objects[-1])
    compiler.assemble(where / "start.S", objects[0])
    compiler.compile(where / "driver.c", objects[1])
    compiler.compile(where / f"{source.name}_kin.c", objects[2], [_FRAMES])
    program = where / "driver.elf"
    compiler.link(objects, program, (f"-Wl,-T,{script}",))
    return program


def write_program(source: Source, target: Target, where: Path) -> Path:
    """Write all sources of the test program into ``where``; the linker script's path."""
    context = {
        "name": source.name,
        "target": target,
        "vectors": list(zip(source.joints, source.poses, strict=True)),
        "aside": source.aside,
        "far": source.far,
        "long_loop": LONG_LOOP,
        "remembers": source.remembers,
        "lit": lambda value: literal(float(value), source.real),
        "numbers": lambda values: ", ".join(literal(float(v), source.real) for v in values),
    }
    for file in ("driver.c", "link.ld"):
        text = environment().get_template(f"embedded/{file}.j2").render(context)
        (where / file).write_text(text, encoding="utf-8")
    shutil.copy(TEMPLATES / "embedded" / "start.S", where)
    for part in ("kin", "state") if source.remembers else ("kin",):
        for suffix in ("c", "h"):
            shutil.copy(source.directory / f"{source.name}_{part}.{suffix}", where)
    return where / "link.ld"


def linked_sizes(source: Source, compiler: Compiler, where: Path) -> tuple[Sizes, Sizes]:
    """What a program takes that calls the inverse alone, and one that calls forward kinematics alone.

    All that they need of the C library is in them, what nothing refers to is not. ``where`` is that of ``build``.
    """
    parts = where / "parts.o"
    compiler.compile(where / f"{source.name}_kin.c", parts, _SECTIONS)
    found = []
    for function in ("ik", "fk"):
        program = where / f"{function}.elf"
        compiler.link([parts], program, (f"-Wl,-e,{source.name}_{function}",))
        found.append(compiler.sizes(program))
    return found[0], found[1]
