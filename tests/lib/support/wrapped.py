"""Wrappers of generated C where the C is, and a Simulink block driven as Simulink drives it."""

from __future__ import annotations

import ctypes
import importlib.util
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import ModuleType

import numpy as np

from support.generated_c import Built, compile_library
from truepose.arrays import Array

SIMULINK = Path(__file__).parent / "simulink"
"""A stand-in for Simulink's headers."""
PORTS = ctypes.POINTER(ctypes.c_double)


def wrapped(built: Built) -> Path:
    """The directory of a machine's wrappers."""
    return built.directory / "wrappers"


def rows_of(built: Built, count: int = 4) -> tuple[Array, Array]:
    """Joints (count, n) and poses (count, 12) of a machine's test vectors."""
    rows = built.samples(count)
    return rows[:, : built.n], rows[:, built.n :]


def python_of(built: Built) -> ModuleType:
    """The module of a machine's Python wrapper."""
    return python_at(wrapped(built) / f"{built.machine.name}_kin.py", built.real)


def python_at(file: Path, real: str = "double") -> ModuleType:
    """The module of a Python wrapper's file."""
    spec = importlib.util.spec_from_file_location(f"{file.stem}_{real}", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def simulink(built: Built) -> ctypes.CDLL:
    """A machine's block with the stand-in around it, compiled with every warning an error."""
    directory, name = wrapped(built), built.machine.name
    files = [f"{name}_sfun.c", f"../{name}_kin.c"]
    where = ["-DMATLAB_MEX_FILE", f"-I{SIMULINK}", "-I.."]
    if (directory / "block.so").exists():
        library = ctypes.CDLL(str(directory / "block.so"))
    else:  # Simulink's signals are double
        library = compile_library(directory, files, "-Wno-double-promotion", *where, "-O1", name="block.so")
    library.block_new.restype = ctypes.c_void_p
    library.block_new.argtypes = [ctypes.c_int, PORTS, PORTS, ctypes.c_int]
    library.block_error.restype = ctypes.c_char_p
    library.block_error.argtypes = [ctypes.c_void_p]
    library.block_sizes.argtypes = [ctypes.c_void_p, ctypes.POINTER(ctypes.c_int)]
    library.block_step.argtypes = [ctypes.c_void_p, PORTS, PORTS, ctypes.c_int]
    library.block_free.argtypes = [ctypes.c_void_p]
    return library


class Block:
    """One Simulink block: ports' widths, the block's sizes, and its outputs step by step."""

    def __init__(
        self, built: Built, function: float, p: Sequence[float] = (), *, parameters: int = 2
    ) -> None:
        self._library = simulink(built)
        self._kept = (ctypes.c_double * 1)(function), (ctypes.c_double * len(p))(*p)
        self._block = self._library.block_new(parameters, *self._kept, len(p))
        found = self._library.block_error(self._block)
        self.error = None if found is None else found.decode()
        numbers = (ctypes.c_int * 32)()
        self._library.block_sizes(self._block, numbers)
        n, m = numbers[0], numbers[1]
        self.inputs, self.outputs = list(numbers[2 : 2 + n]), list(numbers[2 + n : 2 + n + m])
        self.feedthrough, self.reals, self.integers, self.others = numbers[2 + n + m : 6 + n + m]

    def step(self, *inputs: Iterable[float], major: bool = True) -> tuple[int, Array]:
        """The code, and the result, of one call of the block's outputs."""
        flat = [float(value) for port in inputs for value in port]
        assert len(flat) == sum(self.inputs)
        out = (ctypes.c_double * sum(self.outputs))()
        self._library.block_step(self._block, (ctypes.c_double * len(flat))(*flat), out, int(major))
        return int(out[-1]), np.array(out[:-1])

    def close(self) -> None:
        """The end of the simulation."""
        self._library.block_free(self._block)
