"""A test program run by QEMU, and what it said: one observation for each call.

With ``-icount shift=7`` an instruction takes 128 ns of the emulated time, whatever it is, and nothing else takes
any. The board's timer ticks every 40 ns, so that a count of ticks is wrong by less than a third of an
instruction: instructions are counted exactly.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from truepose.codegen.leaves.embedded.targets import Target
from truepose.codegen.leaves.embedded.toolchain import Toolchain, run
from truepose.codegen.printer import Real
from truepose.errors import InputError

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
    command = [str(tools.qemu), "-machine", target.machine, "-display", "none", "-monitor", "none"]
    command += [
        "-serial",
        "none",
        "-parallel",
        "none",
        "-icount",
        f"shift={_SHIFT}",
        "-chardev",
        "stdio,id=said",
    ]
    command += ["-semihosting-config", "enable=on,target=native,chardev=said", "-kernel", str(program)]
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
        yield Observation(
            what=what,
            number=int(number),
            code=int(code),
            kept=kept == "1",
            instructions=_instructions(int(ticks), target) - around,
            stack=int(stack),
            position=position,
            rotation=rotation,
        )


def _instructions(ticks: int, target: Target) -> int:
    return round(ticks * (1_000_000_000 / target.frequency) / (1 << _SHIFT))
