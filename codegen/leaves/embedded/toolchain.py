"""The programs that measuring needs, found on this computer: cross compiler, its C library, emulator."""

from __future__ import annotations

import math
import shutil
import struct
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from truepose.codegen.printer import Real
from truepose.errors import InputError


@dataclass(frozen=True)
class Region:
    """Memory: address of its first byte and its size in bytes."""

    origin: int
    size: int


@dataclass(frozen=True)
class Target:
    """A processor and the emulated board it is run on.

    name, title       identifier, and what people call it
    real              type of the numbers that its floating point unit computes with
    flags             of the compiler, for processor and floating point unit
    machine           QEMU's name of the board
    flash, ram        where code and constants, where data and the stack (bytes) are linked to
    timer, frequency  address of a CMSDK APB timer (32 bits, counting down), and its ticks a second
    stack             size of the stack, bytes
    """

    name: str
    title: str
    real: Real
    flags: tuple[str, ...]
    machine: str
    # Arm MPS2 boards, application notes 385/386 and 500: SSRAM1 at 0, SSRAM2 and 3 at 0x20000000, 25 MHz.
    flash: Region = Region(0x00000000, 4 << 20)
    ram: Region = Region(0x20000000, 4 << 20)
    timer: int = 0x40000000
    frequency: int = 25_000_000
    stack: int = 256 << 10


CORTEX_M7 = Target(
    name="cortex-m7",
    title="Cortex-M7",
    real="double",
    flags=("-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard", "-mthumb"),
    machine="mps2-an500",
)
CORTEX_M4F = Target(
    name="cortex-m4f",
    title="Cortex-M4F",
    real="float",
    flags=("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", "-mthumb"),
    machine="mps2-an386",
)
TARGETS = {target.name: target for target in (CORTEX_M7, CORTEX_M4F)}


def target_for(real: Real) -> Target:
    """The target whose floating point unit computes with ``real``."""
    return next(target for target in TARGETS.values() if target.real == real)


_TIME_LIMIT = 600.0
_PROGRAMS = {
    "gcc": ("arm-none-eabi-gcc", "gcc-arm-none-eabi"),
    "size": ("arm-none-eabi-size", "binutils-arm-none-eabi"),
    "qemu": ("qemu-system-arm", "qemu-system-arm"),
}
_LIBRARY = "libnewlib-arm-none-eabi"


@dataclass(frozen=True)
class Toolchain:
    """Paths of the programs, and what compiler and emulator say of their versions."""

    gcc: Path
    size: Path
    qemu: Path
    compiler: str
    emulator: str


def toolchain() -> Toolchain | None:
    """The toolchain of this computer, or None; ``missing`` says what lacks."""
    if missing():
        return None
    gcc, size, qemu = (Path(str(shutil.which(program))) for program, _ in _PROGRAMS.values())
    return Toolchain(gcc, size, qemu, _version(gcc), _version(qemu))


def missing() -> list[str]:
    """What is not there, each with the Debian package that holds it; empty when nothing lacks."""
    lacks = [f"{program} ({package})" for program, package in _PROGRAMS.values() if not shutil.which(program)]
    gcc = shutil.which(_PROGRAMS["gcc"][0])
    if gcc:
        # the compiler answers with the bare name where it finds no such file
        found = run([gcc, "-print-file-name=libm.a"]).stdout.strip()
        lacks += [] if Path(found).is_absolute() else [f"libm.a for arm-none-eabi ({_LIBRARY})"]
    return lacks


def required() -> Toolchain:
    """The toolchain; raises InputError that names what is missing."""
    found = toolchain()
    if found is None:
        raise InputError(f"measuring: found no {', no '.join(missing())}")
    return found


def run(command: list[str], cwd: Path | None = None, doing: str = "") -> subprocess.CompletedProcess[str]:
    """Run a program to its end; what it wrote. Raises InputError when it fails or takes too long."""
    name = doing or Path(command[0]).name
    try:
        done = subprocess.run(
            command,
            cwd=cwd,
            capture_output=True,
            text=True,
            check=False,
            stdin=subprocess.DEVNULL,
            timeout=_TIME_LIMIT,
        )
    except subprocess.TimeoutExpired as exc:
        raise InputError(f"{name}: found no end after {_TIME_LIMIT:.0f} s") from exc
    if done.returncode != 0:
        said = (done.stderr or done.stdout).strip().splitlines() or ["no message"]
        raise InputError(f"{name}: failed with code {done.returncode}: {' '.join(said[:4])}")
    return done


def _version(program: Path) -> str:
    return run([str(program), "--version"]).stdout.splitlines()[0]


_SHIFT = 7
_SPARE = 1024
_FORMAT: dict[Real, str] = {"double": "<d", "float": "<f"}


@dataclass(frozen=True)
class Observation:
    """One call on the target.

    what, number        which call, and its place among the calls of its kind
    code, kept          its return code, and whether it left the output as it was
    instructions        executed from the call's first to its return, both counted
    stack               bytes below the caller's frame down to the lowest word written
    position, rotation  distance (mm) and angle (rad) to the pose it should meet; where there is none, the norm of the
                        output and 0
    """

    what: str
    number: int
    code: int
    kept: bool
    instructions: int
    stack: int
    position: float
    rotation: float


def observe(program: Path, target: Target, tools: Toolchain) -> list[Observation]:
    """Run a program of ``program.build``. Raises InputError when it does not come to its end."""
    silent = "-display none -monitor none -serial none -parallel none"
    said = "-chardev stdio,id=said -semihosting-config enable=on,target=native,chardev=said"
    command = [str(tools.qemu), "-machine", target.machine, *silent.split(), *said.split()]
    command += ["-icount", f"shift={_SHIFT}", "-kernel", str(program)]
    return read_log(run(command, doing=f"{tools.qemu.name} as {target.title}").stdout, target)


def read_log(log: str, target: Target) -> list[Observation]:
    """What the test program said, a line a call (driver.c tells the columns), with ticks turned into instructions.

    Raises InputError where the log ends early, or where calls of known cost were not seen to cost that.
    """
    lines = log.splitlines()
    if not lines or lines[-1] != "end":
        raise InputError(f"{target.machine}: found {lines[-1:]} as the last line of the run, expected 'end'")
    seen = list(_observations(lines[:-1], target))
    _check(seen, target)
    return seen


def _check(seen: list[Observation], target: Target) -> None:
    """Refuse a run whose counters do not agree with calls of known cost, or that ran out of stack."""
    for call in seen:
        known = {"turn": (2 * call.number + 2, 0), "dig": (3 * call.number + 4, 4 * call.number)}.get(
            call.what
        )
        found = (call.instructions, call.stack)
        if known and found != known:
            raise InputError(
                f"{target.machine}: found {found} instructions and bytes of stack, expected {known}"
            )
        if call.stack > target.stack - _SPARE:
            raise InputError(f"{call.what}: found no end of the stack of {target.stack} bytes, expected less")


def _observations(lines: list[str], target: Target) -> Iterator[Observation]:
    empty = next(int(line.split()[4]) for line in lines if line.startswith("nothing "))
    around = _instructions(empty, target) - 1  # of `nothing`, which is one instruction
    for line in lines:
        what, number, code, kept, ticks, stack, *squares = line.split()
        position, rotation = (
            math.sqrt(struct.unpack(_FORMAT[target.real], bytes.fromhex(square))[0]) for square in squares
        )
        instructions = _instructions(int(ticks), target) - around
        called = what, int(number), int(code), kept == "1"
        yield Observation(*called, instructions, int(stack), position, rotation)


def _instructions(ticks: int, target: Target) -> int:
    return round(ticks * (1_000_000_000 / target.frequency) / (1 << _SHIFT))
