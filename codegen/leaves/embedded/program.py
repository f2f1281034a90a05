"""The test program of a target: driver, start and linker script beside generated C, compiled and linked."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from truepose.codegen.leaves.embedded.source import Source
from truepose.codegen.leaves.embedded.targets import Target
from truepose.codegen.leaves.embedded.toolchain import Toolchain, run
from truepose.codegen.printer import literal
from truepose.codegen.texts import TEMPLATES, environment

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
