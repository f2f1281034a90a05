"""Controllers that the generated C is measured on: processor, compiler flags, and the board that QEMU plays."""

from __future__ import annotations

from dataclasses import dataclass

from truepose.codegen.printer import Real


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
    flash: Region
    ram: Region
    timer: int
    frequency: int
    stack: int


# Arm MPS2 boards, application notes 385/386 and 500: SSRAM1 at 0, SSRAM2 and 3 at 0x20000000, 25 MHz.
_FLASH = Region(0x00000000, 4 << 20)
_RAM = Region(0x20000000, 4 << 20)
_TIMER, _FREQUENCY = 0x40000000, 25_000_000
_STACK = 256 << 10

CORTEX_M7 = Target(
    name="cortex-m7",
    title="Cortex-M7",
    real="double",
    flags=("-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard", "-mthumb"),
    machine="mps2-an500",
    flash=_FLASH,
    ram=_RAM,
    timer=_TIMER,
    frequency=_FREQUENCY,
    stack=_STACK,
)
CORTEX_M4F = Target(
    name="cortex-m4f",
    title="Cortex-M4F",
    real="float",
    flags=("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", "-mthumb"),
    machine="mps2-an386",
    flash=_FLASH,
    ram=_RAM,
    timer=_TIMER,
    frequency=_FREQUENCY,
    stack=_STACK,
)
TARGETS = {target.name: target for target in (CORTEX_M7, CORTEX_M4F)}


def target_for(real: Real) -> Target:
    """The target whose floating point unit computes with ``real``."""
    return next(target for target in TARGETS.values() if target.real == real)
