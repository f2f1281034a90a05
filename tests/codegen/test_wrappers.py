"""Wrappers of the generated C: Python, C++17 and a Simulink block say what the library says, and nothing else."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from support import ROOT
from support.generated_c import COMPILER, WARNINGS, Built, cases, needs_compiler
from support.wrapped import SIMULINK, Block, python_of, wrapped

Array = NDArray[np.float64]
CPP = shutil.which("g++") or shutil.which("c++")
MACHINES = ("arm", "nano", "turns")
COMPENSATE, IK, FK = 1, 2, 3
STRICT = ["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wconversion", "-Wshadow"]

pytestmark = needs_compiler


def python(built: Built) -> tuple[Any, Any]:
    """The module, and the machine of the library without functions for rows that the other tests use."""
    module = python_of(built)
    return module, module.load(built.directory / f"lib{built.machine.name}.so")


def rows_of(built: Built, count: int = 4) -> tuple[Array, Array]:
    rows = built.samples(count)
    return rows[:, : built.n], rows[:, built.n :]


def same(a: Array, b: Array) -> None:
    """Poses equal to rounding: several at a time may be computed in another order than one by one."""
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-9)


@cases(MACHINES)
def test_python_says_what_the_library_says(built: Built) -> None:
    _, machine = python(built)
    q, poses = (v.tolist() for v in rows_of(built))
    guess = (0.999 * np.array(q[1])).tolist()
    said = {
        "fk": (machine.fk(q[1]), built.fk(q[1])),
        "fk_from": (machine.fk_from(q[1], poses[1]), built.call("fk_from", q[1], poses[1], out=np.zeros(12))),
        "ik": (machine.ik(poses[1], guess), built.ik(poses[1], guess)),
        "jac": (machine.jac(q[1]), built.call("jac", q[1], out=np.zeros(6 * built.n))),
        "compensate": (machine.compensate(q[1]), built.call("compensate", q[1], out=np.zeros(built.n))),
    }
    for name, (found, (code, expected)) in said.items():
        assert code == 0, name
        assert isinstance(found, list), name
        assert found == expected.tolist(), name


@cases(MACHINES, ("double",))
def test_arrays_give_arrays_with_the_numbers_of_lists(built: Built) -> None:
    _, machine = python(built)
    q, poses = rows_of(built)
    matrix = np.vstack([poses[2].reshape(3, 4), [0, 0, 0, 1]])
    pairs = [
        (machine.fk(q[2]), machine.fk(q[2].tolist()), (3, 4)),
        (machine.jac(q[2]), machine.jac(q[2].tolist()), (6, built.n)),
        (machine.compensate(q[2]), machine.compensate(q[2].tolist()), (built.n,)),
        (machine.ik(matrix, q[2]), machine.ik(poses[2].tolist(), q[2].tolist()), (built.n,)),
        (
            machine.ik(poses[2].reshape(3, 4), q[2]),
            machine.ik(matrix[:3].tolist(), q[2].tolist()),
            (built.n,),
        ),
    ]
    for array, numbers, shape in pairs:
        assert array.shape == shape
        assert array.ravel().tolist() == numbers
    wide = np.zeros((built.n, 2))
    wide[:, 0] = q[2]
    assert machine.fk(wide[:, 0]).ravel().tolist() == machine.fk(q[2].tolist())  # not contiguous


@cases(("arm", "nano"))
def test_names_are_those_of_the_header_in_its_order(built: Built) -> None:
    module, machine = python(built)
    assert tuple(module.PARAMETERS) == built.model.names
    assert tuple(module.DRIVERS) == built.model.drivers
    assert tuple(module.JOINTS) == built.model.readings
    for size in ("N", "NP", "NZ"):
        assert getattr(module, size) == built.define(size)
    changed = machine.p({"tool.z": 321.5})
    places = [k for k, (a, b) in enumerate(zip(changed, machine.p(), strict=True)) if a != b]
    assert places == [built.define("P_tool_z")] and changed[places[0]] == 321.5
    q = rows_of(built)[0][1]
    assert machine.fk(q.tolist(), p={"tool.z": 321.5}) == built.fk(q, p=np.array(changed))[1].tolist()
    assert machine.fk(q.tolist(), p={"tool.z": 321.5}) != machine.fk(q.tolist())
    with pytest.raises(KeyError, match=r"tool\.zz: found no such name"):
        machine.p({"tool.zz": 1.0})


@cases(("arm",), ("double",))
def test_codes_are_exceptions(built: Built) -> None:
    module, machine = python(built)
    q, poses = (v.tolist() for v in rows_of(built))
    with pytest.raises(module.BadInputError, match="code 4"):
        machine.fk([float("nan"), *q[0][1:]])
    far = list(poses[0])
    far[3] += 1e5
    with pytest.raises(module.KinematicsError) as caught:
        machine.ik(far, q[0])
    assert caught.value.code == built.ik(np.array(far), np.array(q[0]))[0] != 0
    assert issubclass(module.BadInputError, ValueError)
    with pytest.raises(ValueError, match=r"q: found 5 numbers, expected 6"):
        machine.fk(q[0][:5])
    with pytest.raises(ValueError, match=r"p: found 3 numbers, expected \d+"):
        machine.fk(q[0], p=[1.0, 2.0, 3.0])
    with pytest.raises(FileNotFoundError, match=r"build\(\) makes one"):
        module.load(built.directory / "nothing.so")


@cases(MACHINES, ("double",))
def test_rows_are_what_one_after_the_other_gives(built: Built) -> None:
    module, plain = python(built)
    compiled = module.build(COMPILER, ("-O1",))
    assert module.load().p() == compiled.p()
    for machine in (plain, compiled):
        q, poses = rows_of(built)
        near = 0.999 * q
        broken = q.copy()
        broken[2, 0] = np.nan
        found, codes = machine.fk_n(broken)
        assert found.shape == (4, 3, 4) and codes.tolist() == [0, 0, 4, 0]
        assert np.isnan(found[2]).all()
        for k in (0, 1, 3):
            same(found[k], machine.fk(q[k]))
        joints, codes = machine.ik_n(poses.reshape(4, 3, 4), near)
        assert not codes.any()
        np.testing.assert_allclose(machine.fk_n(joints)[0].reshape(4, 12), poses, rtol=0, atol=2e-6)
        commands, codes = machine.compensate_n(q.tolist())
        assert codes == [0, 0, 0, 0]
        np.testing.assert_allclose(
            commands, [machine.compensate(row) for row in q.tolist()], rtol=0, atol=1e-6
        )


@cases(("arm",), ("double",))
def test_rows_take_drivers_by_row_or_once(built: Built) -> None:
    module, plain = python(built)
    q = rows_of(built)[0]
    z = np.array([plain.z({"payload": k, "temperature.link3": 20.0 + k}) for k in range(4)])
    for machine in (plain, module.build(COMPILER, ("-O1",))):
        each = machine.fk_n(q, z=z)[0]
        for k in range(4):
            same(each[k], machine.fk(q[k], z=z[k]))
        for once in (z[3], z[3].tolist(), {"payload": 3.0, "temperature.link3": 23.0}):
            found = machine.fk_n(q, z=once)[0]
            same(found[3], each[3])
            same(found[0], machine.fk(q[0], z=z[3]))


@cases(("arm",), ("double",))
def test_all_solutions_are_rows_where_the_library_has_them(built: Built) -> None:
    _, machine = python(built)
    q, poses = rows_of(built)
    assert hasattr(built.library, "arm_ik_all")
    found = machine.ik_all(poses[1])
    assert found.shape[1] == built.n and len(found) == len(machine.ik_all(poses[1].tolist()))
    turn = 2 * np.pi
    apart = (found - q[1] + np.pi) % turn - np.pi
    # the scale error of q4 makes a full turn of it 5 mrad short: the branch is the same, the winding another
    assert np.min(np.max(np.abs(apart), axis=1)) < 0.01
    for row in found:
        np.testing.assert_allclose(machine.fk(row).ravel(), poses[1], rtol=0, atol=2e-6)


@cases(("turns",), ("double",))
def test_without_a_closed_form_there_is_no_list_of_solutions(built: Built) -> None:
    with pytest.raises(NotImplementedError, match="use ik"):
        python(built)[1].ik_all(rows_of(built)[1][1])


@cases(("arm",), ("double",))
def test_python_needs_no_numpy(built: Built) -> None:
    code = (
        "import sys; sys.modules['numpy'] = None\n"
        "import arm_kin\n"
        f"machine = arm_kin.load({str(built.directory / 'libarm.so')!r})\n"
        "q = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]\n"
        "rows, codes = machine.fk_n([q, q])\n"
        "assert rows == [machine.fk(q)] * 2 and codes == [0, 0]\n"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], cwd=wrapped(built), check=True)


@cases(("arm", "nano"), ("double",))
def test_the_python_wrapper_is_clean_itself(built: Built) -> None:
    ruff = shutil.which("ruff") or str(Path(sys.executable).with_name("ruff"))
    if not Path(ruff).exists():
        pytest.skip("no ruff found")
    file = str(wrapped(built) / f"{built.machine.name}_kin.py")
    settings = ["--config", str(ROOT / "pyproject.toml"), "--no-cache"]
    for command in (["check"], ["format", "--check"]):
        done = subprocess.run([ruff, *command, *settings, file], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


PROGRAM = """#include "NAME_kin.hpp"

#include <cstdio>

namespace k = NAME_kin;

template <std::size_t n> static void show(const std::array<k::real, n> &values)
{
    for (const auto v : values) {
        std::printf("%.17g ", static_cast<double>(v));
    }
    std::printf("\\n");
}

template <std::size_t n> static void told(const std::array<const char *, n> &names)
{
    for (const char *name : names) {
        std::printf("%s ", name);
    }
    std::printf("\\n");
}

static_assert(noexcept(k::fk(k::Joints{})), "no exceptions");

int main()
{
    const k::Joints q{{ Q }};
    const auto T = k::fk(q);
    if (!T) {
        return 1;
    }
    show(*T);
    const auto near = k::fk_from(q, *T);
    const auto J = k::jac(q);
    const auto back = k::ik(*T, q);
    const auto command = k::compensate(q);
    if (!near || !J || !back || !command) {
        return 2;
    }
    show(*near);
    show(*J);
    show(*back);
    show(*command);
    k::Parameters p = k::calibrated();
    p[NAME_P_tool_z] += 10;
    k::Drivers z = k::usual();
    z[0] += static_cast<k::real>(1.5);
    show(*k::fk(q, { &p, &z }));
    k::Pose far = *T, untouched{};
    far[3] = static_cast<k::real>(1e6);
    k::Joints kept = q;
    if (k::ik(far, q, kept) == k::Code::solved || kept != q || k::ik(far, q)) {
        return 3;
    }
    far[0] = 7;
    if (k::fk_from(q, far, untouched) != k::Code::bad_input || untouched != k::Pose{}) {
        return 4;
    }
    told(k::joint_names);
    told(k::joint_units);
    told(k::parameter_names);
    told(k::driver_names);
    return 0;
}
"""


@pytest.mark.skipif(CPP is None, reason="no C++ compiler found")
@cases(("arm", "nano", "turns"))
def test_cpp_says_what_the_library_says(built: Built) -> None:
    assert CPP is not None and COMPILER is not None
    directory, name = wrapped(built), built.machine.name
    q, _ = rows_of(built)
    row = q[1].astype(built.dtype)
    numbers = ", ".join(f"static_cast<k::real>({float(v)!r})" for v in row)
    (directory / "use.cpp").write_text(PROGRAM.replace("NAME", name).replace("Q }", f"{numbers} }}"))
    subprocess.run([COMPILER, *WARNINGS, "-c", f"../{name}_kin.c", "-o", "kin.o"], cwd=directory, check=True)
    subprocess.run([CPP, *STRICT, "-I..", "use.cpp", "kin.o", "-lm", "-o", "use"], cwd=directory, check=True)
    said = subprocess.run([str(directory / "use")], capture_output=True, text=True, check=True).stdout
    *lines, joints, units, parameters, drivers = said.splitlines()
    pose = built.fk(row)[1]
    moved = built.model.p_home.copy()
    moved[built.define("P_tool_z")] += 10
    z = built.model.z_home.copy() if len(built.model.drivers) else np.zeros(1)
    z[0] += 1.5
    expected = [
        pose,
        built.call("fk_from", row, pose, out=np.zeros(12))[1],
        built.call("jac", row, out=np.zeros(6 * built.n))[1],
        built.ik(pose, row)[1],
        built.call("compensate", row, out=np.zeros(built.n))[1],
        built.fk(row, p=moved, z=z)[1],
    ]
    assert tuple(joints.split()) == built.model.readings
    assert units.split() == [a.reading_unit for a in built.machine.mechanism.actuators]
    assert tuple(parameters.split()) == built.model.names
    assert tuple(drivers.split()) == built.model.drivers
    for k, (line, values) in enumerate(zip(lines, expected, strict=True)):
        found = [float(v) for v in line.split()]
        # the C is compiled twice, with and without optimisation
        scale = 1e-12 if built.real == "double" else 1e-5
        np.testing.assert_allclose(
            found, values, rtol=scale, atol=scale * np.max(np.abs(values)), err_msg=str(k)
        )


@cases(("arm", "nano", "turns"))
def test_a_block_says_what_the_library_says(built: Built) -> None:
    q, poses = (v.astype(built.dtype).astype(float) for v in rows_of(built))
    drivers = [built.model.z_home + 1.5] if len(built.model.drivers) else []
    z = drivers[0] if drivers else None
    guess = 0.999 * q
    for function, inputs, name in (
        (COMPENSATE, [q], "compensate"),
        (IK, [poses, guess], "ik"),
        (FK, [q], "fk"),
    ):
        block = Block(built, function)
        assert block.error is None
        width = 12 if function == FK else built.n
        assert block.inputs == [v.shape[1] for v in inputs] + [len(d) for d in drivers]
        assert block.outputs == [width, 1]
        assert block.feedthrough == 1 and block.reals == width and block.integers == 1 and block.others == 0
        for k in range(4):
            code, found = block.step(*(v[k] for v in inputs), *drivers)
            expected = built.call(name, *(v[k] for v in inputs), out=np.zeros(width), z=z)
            assert code == expected[0] == 0
            np.testing.assert_array_equal(found, expected[1])
        block.close()


@cases(("arm", "nano"), ("double",))
def test_a_block_holds_the_latest_result_where_there_is_none(built: Built) -> None:
    q, poses = rows_of(built)
    drivers = [built.model.z_home] if len(built.model.drivers) else []
    far = poses[0] + 1e6 * np.eye(12)[3]
    block = Block(built, IK)
    code, found = block.step(far, q[0], *drivers)
    assert code != 0
    np.testing.assert_array_equal(found, q[0])  # nothing solved yet: the guess
    solved = block.step(poses[1], q[1], *drivers)[1]
    trial = block.step(poses[2], q[2], *drivers, major=False)[1]  # a minor step is no result to keep
    assert not np.array_equal(trial, solved)
    code, found = block.step(far, q[0], *drivers)
    assert code != 0
    np.testing.assert_array_equal(found, solved)
    block.close()
    wrong = np.full(built.n, np.nan)
    for function, expected in ((COMPENSATE, wrong), (FK, np.zeros(12))):
        block = Block(built, function)
        code, found = block.step(wrong, *drivers)
        assert code == 4
        np.testing.assert_array_equal(found, expected)
        block.close()


@cases(("arm",), ("double",))
def test_blocks_run_beside_each_other_with_their_own_calibration(built: Built) -> None:
    q, _ = rows_of(built)
    z, moved = built.model.z_home, built.model.p_home.copy()
    moved[built.define("P_q1_r")] += 25.0
    one, other = Block(built, FK), Block(built, FK, moved.tolist())
    for k in range(4):
        heights = [block.step(q[k], z)[1][11] for block in (one, other)]
        assert heights[1] - heights[0] == pytest.approx(25.0, abs=0.1)  # its axis is vertical to 0.1 deg
    one.close()
    np.testing.assert_array_equal(other.step(q[0], z)[1], built.fk(q[0], p=moved)[1])
    other.close()


@cases(("nano",), ("double",))
def test_a_block_tells_parameters_that_are_wrong(built: Built) -> None:
    for function in (0.0, 4.0, 1.5, -1.0):
        error = Block(built, function).error
        assert error == "nano_sfun: FUNCTION: expected 1 (compensate), 2 (ik) or 3 (fk)"
    error = Block(built, FK, [1.0, 2.0]).error
    assert error == f"nano_sfun: P: expected [] or {built.define('NP')} numbers"
    assert Block(built, FK, parameters=1).inputs == []  # Simulink itself says that one is missing


@cases(("arm", "nano"))
def test_a_block_compiles_for_generated_code_too(built: Built) -> None:
    assert COMPILER is not None
    flags = [flag for flag in WARNINGS if flag != "-Wdouble-promotion"]
    where = [f"-I{SIMULINK}", "-I..", "-fsyntax-only", f"{built.machine.name}_sfun.c"]
    subprocess.run([COMPILER, *flags, *where], cwd=wrapped(built), check=True)


@cases(("arm",), ("double",))
def test_wrappers_name_nothing_of_others(built: Built) -> None:
    files = sorted(path.name for path in wrapped(built).iterdir() if path.suffix in (".hpp", ".py", ".c"))
    assert files == ["arm_kin.hpp", "arm_kin.py", "arm_sfun.c"]
    for name in files:
        text = (wrapped(built) / name).read_text(encoding="utf-8")
        assert text.endswith("\n") and "nano" not in text and "{{" not in text.replace("{{ }}", "")
