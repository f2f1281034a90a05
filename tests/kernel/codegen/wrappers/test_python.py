"""The Python wrapper of the generated C says what the library says, with numpy or without, and nothing else."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from support.generated_c import COMPILER, Built, cases, needs_compiler
from support.wrapped import python_of, rows_of, wrapped

Array = NDArray[np.float64]
MACHINES = ("arm", "nano", "turns")

pytestmark = needs_compiler


def python(built: Built) -> tuple[Any, Any]:
    """The module, and the machine of the library without functions for rows that the other tests use."""
    module = python_of(built)
    return module, module.load(built.directory / "kin.so")


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


@cases(("arm",), ("double",))
def test_python_needs_no_numpy(built: Built) -> None:
    code = (
        "import sys; sys.modules['numpy'] = None\n"
        "import arm_kin\n"
        f"machine = arm_kin.load({str(built.directory / 'kin.so')!r})\n"
        "q = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]\n"
        "rows, codes = machine.fk_n([q, q])\n"
        "assert rows == [machine.fk(q)] * 2 and codes == [0, 0]\n"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], cwd=wrapped(built), check=True)
