"""The programs that measuring needs, found on this computer: cross compiler, its C library, emulator."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from truepose.errors import InputError

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
