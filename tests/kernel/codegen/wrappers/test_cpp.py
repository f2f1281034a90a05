"""The C++17 wrapper of the generated C compiles without a warning and says what the library says."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest

from support.generated_c import COMPILER, WARNINGS, Built, cases, needs_compiler
from support.wrapped import rows_of, wrapped

CPP = shutil.which("g++") or shutil.which("c++")
STRICT = ["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wconversion", "-Wshadow"]

pytestmark = needs_compiler

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
