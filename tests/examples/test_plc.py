"""The function block for a PLC: its struct as Structured Text declares it, and a cyclic task along a path.

The block is reached through a struct made from ``FB_Compensate.st``, so that the two declarations cannot part.
"""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support import ROOT
from support.command import run
from support.embedded import needs_toolchain
from support.generated_c import COMPILER, WARNINGS, needs_compiler
from support.rail_arm import MIDDLE, NAME, STRAIGHT, Path6, compensated, planned, written
from truepose.arrays import Array
from truepose.codegen.printer import Real

EXAMPLE = ROOT / "examples" / "plc"
TEXT = (EXAMPLE / "FB_Compensate.st").read_text(encoding="utf-8")
REALS: tuple[Real, ...] = ("double", "float")
TYPES: dict[str, Any] = {
    "BOOL": ctypes.c_uint8,
    "UDINT": ctypes.c_uint32,
    "LREAL": ctypes.c_double,
    "REAL": ctypes.c_float,
}
UNLIMITED = 1e30
DRIVER_RANGE, MAX_STEP, MAX_CORRECTION = 17, 18, 19

pytestmark = [pytest.mark.nightly, needs_compiler]


def fields(real: Real) -> list[tuple[str, Any]]:
    """The block's fields as its declaration has them."""
    constants = {name: int(value) for name, value in re.findall(r"(\w+) : INT := (\d+);", TEXT)}
    types = {**TYPES, "KIN_REAL": TYPES["LREAL" if real == "double" else "REAL"]}
    (declared,) = re.findall(r"^FUNCTION_BLOCK FB_Compensate$(.*?)^END_FUNCTION_BLOCK", TEXT, re.M | re.S)
    found = re.findall(r"^\s+(\w+) : (?:ARRAY\[1\.\.(\w+)\] OF )?(\w+);", declared, re.M)
    return [
        (name, types[kind] * constants[length] if length else types[kind]) for name, length, kind in found
    ]


@dataclass(frozen=True)
class Built:
    """The block's library for the machine in ``folder``, and the struct that the declaration describes."""

    folder: Path
    machine: Path
    real: Real
    library: ctypes.CDLL
    struct: type[ctypes.Structure]

    @property
    def tolerance(self) -> float:
        """Of a joint, mm and rad: what an inverse promises, in single precision 2e-6 of a reach of 1000 mm."""
        return 1e-5 if self.real == "double" else 5e-3

    @property
    def rounding(self) -> float:
        """Of a position of 100 mm."""
        return 1e-13 if self.real == "double" else 1e-5

    def block(self, step: float = UNLIMITED) -> Any:
        """A block after its initialisation; ``step`` is how far the correction may change in a cycle."""
        made = self.struct()
        ctypes.memset(ctypes.byref(made), 0xA5, ctypes.sizeof(made))  # memory of a controller is not clean
        self.library.FB_Compensate_init(ctypes.byref(made))
        made.aMaxStep[:] = [step] * 6
        made.bEnable = 1
        return made

    def cycle(self, block: Any, nominal: Array, drivers: Array, actual: Array | None = None) -> Array:
        """One cycle of the task; the command afterwards."""
        block.aNominal[:] = nominal.tolist()
        block.aActual[:] = (nominal if actual is None else actual).tolist()
        block.aDriver[:] = drivers.tolist()
        self.library.FB_Compensate(ctypes.byref(block))
        return np.array(block.aCommand[:])


@pytest.fixture(scope="module", params=REALS)
def built(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Built:
    assert COMPILER is not None
    folder = tmp_path_factory.mktemp("plc")
    machine = written(folder, request.param)
    (folder / "size.c").write_text(
        '#include "FB_Compensate.h"\nunsigned size(void);\nunsigned size(void) { return sizeof(FB_Compensate_typ); }\n'
    )
    sources = [str(EXAMPLE / "FB_Compensate.c"), f"controller/{NAME}_kin.c", "size.c"]
    where = [f"-DMACHINE={NAME}", f"-I{EXAMPLE}", "-Icontroller"]
    shared = ["-O2", "-shared", "-fPIC", "-lm", "-o", "block.so"]
    subprocess.run([COMPILER, *WARNINGS, *where, *sources, *shared], cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "block.so"))
    struct = type("FB_Compensate", (ctypes.Structure,), {"_fields_": fields(request.param)})
    return Built(folder, machine, request.param, library, struct)


@pytest.fixture(scope="module")
def path(built: Built) -> Path6:
    return compensated(built.folder, built.machine, *planned())


def test_the_declaration_is_the_struct(built: Built) -> None:
    """Size and order: what init sets is where the declaration says, and nowhere else."""
    assert built.library.size() == ctypes.sizeof(built.struct)
    header = (EXAMPLE / "FB_Compensate.h").read_text()
    (struct,) = re.findall(r"typedef struct FB_Compensate \{(.*?)\} FB_Compensate_typ;", header, re.S)
    in_c = re.findall(r"^    (\w+) (\w+)(?:\[\w+\])?;", struct, re.M)
    declared = re.findall(
        r"^    (\w+) : (?:ARRAY\[[^]]+\] OF )?(\w+);", TEXT.split("FUNCTION_BLOCK")[1], re.M
    )
    assert [(name, kind) for kind, name in in_c] == declared
    block = built.block()
    assert list(block.aDriver) == [2.0, 20.0] and list(block.aNominal) == [0.0] * 6
    assert [block.bValid, block.bBusy, block.bError, block.nErrorID, block.bStarted] == [0] * 5
    assert list(block.aDriverMax) == pytest.approx([UNLIMITED] * 2)
    assert list(block.aMaxCorrection) == pytest.approx([UNLIMITED] * 6)


def test_the_commands_are_those_of_truepose_compensate(built: Built, path: Path6) -> None:
    block = built.block()
    found = []
    for nominal, drivers in zip(path.nominal, path.drivers, strict=True):
        found.append(built.cycle(block, nominal, drivers))
        assert (block.bValid, block.bBusy, block.bError, block.nErrorID) == (1, 0, 0, 0)
    np.testing.assert_allclose(found, path.command, rtol=0, atol=built.tolerance)


def test_a_start_is_where_the_drives_are(built: Built, path: Path6) -> None:
    """The first set point is a step from the measured positions at most, and then the correction arrives."""
    block, step = built.block(1e-4), 1e-4
    actual = path.nominal[0] + np.array([0.4, 1e-3, -2e-3, 3e-3, 0.0, -1e-3])
    before = actual
    for cycle in range(2000):  # noqa: B007
        command = built.cycle(block, path.nominal[0], path.drivers[0], actual)
        assert np.abs(command - before).max() <= step * 1.01 + built.rounding
        before = command
        if not block.bBusy:
            break
    assert 100 < cycle < 1999
    np.testing.assert_allclose(before, path.command[0], rtol=0, atol=built.tolerance)


def test_a_payload_is_no_step(built: Built, path: Path6) -> None:
    """The correction is kept from cycle to cycle, and goes on from where it was."""
    heavy = np.array([60.0, 20.0])
    at_once = built.block()
    light, loaded = (built.cycle(at_once, MIDDLE, drivers) for drivers in (path.drivers[0], heavy))
    assert abs(loaded[1] - light[1]) > 5e-4
    block = built.block(1e-4)
    built.cycle(block, MIDDLE, path.drivers[0], light)
    assert not block.bBusy or built.real == "float"
    steps = [built.cycle(block, MIDDLE, heavy)[1] for _ in range(30)]
    assert np.abs(np.diff([light[1], *steps])).max() <= 1.01e-4 + built.rounding
    np.testing.assert_allclose(steps[-1], loaded[1], rtol=0, atol=built.tolerance)
    assert steps[3] != steps[4] != steps[5]


@pytest.mark.parametrize(
    ("joint", "temperature", "numbers"),
    [
        ((2, STRAIGHT), None, {1, 2}),  # not reachable, or not within the iterations
        ((2, np.radians(121.0)), None, {3}),
        ((3, np.nan), None, {4}),
        (None, -200.0, {DRIVER_RANGE}),
        (None, 3276.7, {DRIVER_RANGE}),
        (None, np.nan, {DRIVER_RANGE}),
    ],
)
def test_the_last_good_command_stays(
    built: Built, path: Path6, joint: tuple[int, float] | None, temperature: float | None, numbers: set[int]
) -> None:
    block = built.block()
    block.aDriverMin[:], block.aDriverMax[:] = [0.0, 10.0], [10.0, 60.0]
    good = built.cycle(block, path.nominal[0], path.drivers[0])
    nominal, drivers = path.nominal[1].copy(), path.drivers[1].copy()
    if joint is not None:
        nominal[joint[0]] = joint[1]
    if temperature is not None:
        drivers[1] = temperature
    for _ in range(3):
        held = built.cycle(block, nominal, drivers)
        assert held.tolist() == good.tolist()
        assert (block.bValid, block.bBusy, block.bError) == (0, 0, 1)
        assert block.nErrorID in numbers
    after = built.cycle(block, path.nominal[2], path.drivers[2])
    assert (block.bValid, block.bError, block.nErrorID) == (1, 0, 0)
    np.testing.assert_allclose(after, path.command[2], rtol=0, atol=built.tolerance)


def test_limits_of_the_correction_are_kept(built: Built, path: Path6) -> None:
    most = np.abs(path.command[0] - path.nominal[0])
    for slack, number in ((1.1, 0), (0.9, MAX_CORRECTION)):
        block = built.block()
        block.aMaxCorrection[:] = (slack * most + 10 * built.tolerance * (slack > 1)).tolist()
        built.cycle(block, path.nominal[0], path.drivers[0])
        assert block.nErrorID == number
    block = built.block()
    block.aMaxCorrection[:] = [5.0, *[0.05] * 5]
    # the plan does not begin where the robot is
    elsewhere = path.nominal[0] + np.array([80.0, 0, 0, 0, 0, 0])
    built.cycle(block, path.nominal[0], path.drivers[0], elsewhere)
    assert (block.bValid, block.nErrorID) == (0, MAX_CORRECTION)


@pytest.mark.parametrize("step", [0.0, -1.0, float("nan")])
def test_a_step_that_is_none_is_refused(built: Built, path: Path6, step: float) -> None:
    block = built.block(step)
    built.cycle(block, path.nominal[0], path.drivers[0])
    assert (block.bValid, block.bError, block.nErrorID) == (0, 1, MAX_STEP)


def test_off_is_no_error_and_the_next_start_begins_at_the_drives(built: Built, path: Path6) -> None:
    block = built.block(1e-4)
    for _ in range(5):
        built.cycle(block, path.nominal[0], path.drivers[0])
    block.bEnable = 0
    kept = built.cycle(block, np.full(6, np.nan), path.drivers[0])
    assert kept.tolist() == built.cycle(block, path.nominal[0], path.drivers[0]).tolist()
    assert [block.bValid, block.bBusy, block.bError, block.nErrorID, block.bStarted] == [0] * 5
    block.bEnable = 1
    actual = path.nominal[0] + 0.02
    found = built.cycle(block, path.nominal[0], path.drivers[0], actual)
    assert np.abs(found - actual).max() <= 1.01e-4 + built.rounding


def test_the_command_of_the_readme_compiles_it(tmp_path: Path) -> None:
    shutil.copytree(EXAMPLE, tmp_path / "plc")
    machine, controller = tmp_path / "arm.yaml", tmp_path / "plc" / "controller"
    run("init", "--arm", "irb120", "--sensor", "position", "-o", machine)
    run("codegen", machine, "-o", controller)
    (command,) = re.findall(r"^cc .*", (EXAMPLE / "README.md").read_text(), re.M)
    assert COMPILER is not None
    subprocess.run([COMPILER, *command.split()[1:]], cwd=tmp_path / "plc", check=True)
    assert (tmp_path / "plc" / "FB_Compensate.o").is_file()


@needs_toolchain
@pytest.mark.parametrize(("real", "cpu"), [("double", "cortex-m7"), ("float", "cortex-m4")])
def test_it_compiles_for_controllers(real: Real, cpu: str, tmp_path: Path) -> None:
    compiler = shutil.which("arm-none-eabi-gcc")
    assert compiler is not None
    written(tmp_path, real)
    where = [f"-DMACHINE={NAME}", f"-I{EXAMPLE}", "-Icontroller", f"-mcpu={cpu}", "-mthumb", "-O2"]
    block = [str(EXAMPLE / "FB_Compensate.c"), "-c", "-o", "block.o"]
    subprocess.run([compiler, *WARNINGS, *where, *block], cwd=tmp_path, check=True)
