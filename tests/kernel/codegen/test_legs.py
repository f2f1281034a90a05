"""Inverse kinematics of closed chains in generated C: legs one by one, and Newton's equations written out."""

from __future__ import annotations

import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from support.examples import by_day
from support.generated_c import COMPILER, needs_compiler
from support.generated_machines import machine_of
from support.legged_machines import BY_NEWTON, CLOSED_FORM, LEGGED, Legged, legged
from support.skips import NO_AVX2
from truepose.codegen.layout import layout_of
from truepose.codegen.legs import legs_of
from truepose.codegen.loops import LoopExpressions, Pivots, factors_of
from truepose.codegen.printer import Real
from truepose.models.machine.kinematics import symbolic_model

Array = NDArray[np.float64]


def readings(built: Legged, count: int, seed: int) -> Array:
    """(count, nq) within the ranges."""
    rng = np.random.default_rng(seed)
    half = [0.9 * a.range[1] if a.range else 1.0 for a in built.machine.mechanism.actuators]
    drawn: Array = rng.uniform(-1, 1, (count, built.n)) * np.array(half)
    return drawn


def is_written_out(built: Legged, name: str) -> bool:
    text = (built.directory / f"{built.machine.name}_kin.c").read_text()
    return f"static void {name}(" in text


@needs_compiler
@pytest.mark.parametrize(
    "name", by_day(LEGGED, "warm_rails", "coupled_rails", "plain_turns", "weighed_rails")
)
def test_readings_are_those_of_the_pose(root_directory: Path, name: str) -> None:
    built = legged(root_directory, name)
    assert is_written_out(built, "roots_of") == (name in CLOSED_FORM)
    assert is_written_out(built, "legs_of") == (name in BY_NEWTON)
    rng = np.random.default_rng(5)
    model = built.model
    for k, (q, guess) in enumerate(zip(readings(built, 8, 1), readings(built, 8, 2), strict=True)):
        p = model.p_home * (1 + (k % 2) * 1e-3 * rng.standard_normal(len(model.p_home)))
        z = model.z_home + (k % 2) * rng.uniform(0.1, 2.0, len(model.z_home))
        pose = built.pose(q, p, z)
        code, found = built.ik(pose, guess, p=p, z=z if len(z) else np.zeros(1))
        # a pose is met to 5e-7 mm where Newton's method goes over it, to rounding in closed form
        np.testing.assert_allclose(found, q, rtol=0, atol=1e-9 if name != "weighed_rails" else 2e-6)
        assert code == 0
        if not k % 2:
            assert built.ik(pose, guess)[1] == pytest.approx(found, abs=1e-11)


@needs_compiler
@pytest.mark.parametrize("name", ["plain_rails", "warm_turns", "screw_rails", "coupled_rails"])
def test_what_cannot_be_reached_is_told(root_directory: Path, name: str) -> None:
    built = legged(root_directory, name)
    pose = built.samples()[1][built.n :]
    away = pose + np.eye(12)[3] * 1e5
    code, left = built.ik(away, np.zeros(built.n))
    if name.startswith(("plain", "coupled", "screw")):
        assert code in ((1,) if name in CLOSED_FORM else (1, 2))
    else:  # legs of any length reach anywhere, but not within their ranges
        assert code == 3
    np.testing.assert_array_equal(left, -7.0)


@needs_compiler
@pytest.mark.parametrize(
    "name", by_day([*CLOSED_FORM, *BY_NEWTON], "warm_rails", "plain_turns", "coupled_rails")
)
def test_joint_ranges_are_kept(root_directory: Path, name: str) -> None:
    built = legged(root_directory, name)
    limited = [k for k, a in enumerate(built.machine.mechanism.actuators) if a.range]
    q = readings(built, 1, 4)[0]
    actuator = built.machine.mechanism.actuators[limited[-1]]
    assert actuator.range is not None
    for beyond, expected in ((-1e-4, 0), (1e-4, 3)):
        q[limited[-1]] = actuator.range[1] + beyond
        code, found = built.ik(built.pose(q), 0 * q)
        assert code == expected
        assert (found == -7.0).all() == (expected == 3)


def hostile(built: Legged, count: int) -> Array:
    """(count, 12) poses: reachable, out of reach, out of range, reflected, no rotation, no numbers."""
    poses = np.array([built.pose(q) for q in readings(built, count, 6)])
    poses[2::9, 3] += 1e5
    poses[4::9, 11] += 40.0
    poses[5::9, :] = 0.0
    poses[6::9, [0, 1, 2]] *= -1.0
    poses[7::9, 5] = np.nan
    poses[8::9, 3] = 1e300
    return poses


@needs_compiler
@pytest.mark.parametrize("flags", [(), ("-mavx2", "-mfma"), ("-DTRUEPOSE_SCALAR",)])
@pytest.mark.parametrize("name", ["warm_rails", "plain_turns"])
def test_many_poses_are_each_alone(root_directory: Path, name: str, flags: tuple[str, ...]) -> None:
    if "-mavx2" in flags and "avx2" not in Path("/proc/cpuinfo").read_text():
        pytest.skip(NO_AVX2)
    built = legged(root_directory, name, "double", flags)
    poses = hostile(built, 61)
    guess = readings(built, 61, 7)
    guess[10] = np.nan
    other = built.model.p_home * (1 + 1e-6)
    for p in (None, other):
        failed, found, codes = built.ik_n(poses, guess, p)
        alone = [built.ik(pose, start, p=p) for pose, start in zip(poses, guess, strict=True)]
        np.testing.assert_array_equal(codes, [code for code, _ in alone])
        # no contraction of products in one of them: a few roundings of readings of 20 mm and rods of 500 mm
        np.testing.assert_allclose(found, [q for _, q in alone], rtol=0, atol=1e-12)
        assert failed == np.count_nonzero(codes)
        assert {0, 4} < set(codes.tolist())
    broken = np.where(np.arange(len(other)) == 3, np.inf, other)
    assert built.ik_n(poses, guess, broken)[0] == len(poses)


@needs_compiler
@pytest.mark.parametrize("name", ["plain_rails", "plain_turns", "screw_rails"])
def test_single_precision(root_directory: Path, name: str) -> None:
    built = legged(root_directory, name, "float")
    for q in readings(built, 6, 3):
        pose = built.pose(q)
        code, found = built.ik(pose, 0 * q)
        assert code == 0
        gain = 75.0 if "turns" in name else 1.0
        np.testing.assert_allclose(found, q, rtol=0, atol=4e-6 * 600 / gain)
        assert built.ik_n(pose[None], 0 * q[None])[1] == pytest.approx(found[None], abs=1e-3)


@pytest.mark.parametrize("name", ["turns", "rails", "hybrid", "planar"])
def test_elimination_solves_what_numpy_solves(tmp_path: Path, name: str) -> None:
    machine = machine_of(tmp_path, name)
    model = symbolic_model(machine, machine.effects)
    layout = layout_of(model, "double")
    loops = LoopExpressions.of(model, layout, "double")
    legs = legs_of(model, layout, "double")
    ny, nq = len(model.readings) + len(model.home), len(model.readings)
    rng = np.random.default_rng(11)
    assert (legs is None) == (name != "turns")
    closure = range(6, 6 + model.closure.numel())
    systems = [(loops.loops, closure, nq), (loops.whole, loops.rows, 0)]
    for equations, rows, first in systems[:1] if name == "planar" else systems:
        assert equations is not None
        n = equations.factors.size
        row_of = {row: k for k, row in enumerate(rows)}
        places = [divmod(place, ny) for place in loops.places]
        at = [(row_of[i], j - first) for i, j in places if i in row_of and j >= first]
        pattern = np.zeros((n, n), dtype=bool)
        pattern[tuple(np.array(at).T)] = True
        samples = rng.standard_normal((20, n, n)) * pattern
        symbols = ca.SX.sym("J", len(at))
        matrix = ca.SX(n, n)
        for k, (i, j) in enumerate(at):
            matrix[i, j] = symbols[k]
        factors = factors_of(matrix, Pivots.of(samples, pattern))
        values = ca.Function("F", [symbols], [factors.values])
        solution = ca.Function("x", [symbols, factors.symbols, factors.right], [factors.solution])
        for sample in samples:
            b, entries = rng.standard_normal(n), [sample[i, j] for i, j in at]
            expected = np.linalg.solve(sample, b)
            found = np.array(solution(entries, values(entries), b)).ravel()
            # a fixed order of the pivots may grow rounding by some orders more than the best one
            allowed = 1e-10 * np.linalg.cond(sample) * np.abs(expected).max()
            np.testing.assert_allclose(found, expected, rtol=0, atol=allowed)


@pytest.mark.parametrize("name", ["hybrid", "planar"])
def test_turns_about_axes_of_the_tool_leave_the_pose_to_the_damped_search(tmp_path: Path, name: str) -> None:
    machine = machine_of(tmp_path, name)
    model = symbolic_model(machine, machine.effects)
    loops = LoopExpressions.of(model, layout_of(model, "double"), "double")
    own = [row for row in loops.rows if row < 6]
    assert own == ([] if name == "planar" else list(range(6)))  # planar: x, y and the turn about z


@needs_compiler
def test_a_row_does_not_depend_on_its_neighbours(root_directory: Path) -> None:
    built = legged(root_directory, "plain_rails")
    poses, guess = hostile(built, 40), readings(built, 40, 8)
    whole = built.ik_n(poses, guess)[1]
    for start, stop in ((0, 1), (1, 4), (3, 40), (17, 18)):
        np.testing.assert_array_equal(built.ik_n(poses[start:stop], guess[start:stop])[1], whole[start:stop])


_HOSTILE = """
#include "{name}_batch.h"
#include <math.h>

static unsigned long long state = 88172645463325252ULL;

static double draw(void)
{{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (double)(state >> 11) / 9007199254740992.0;
}}

static double odd(void)
{{
    static const double some[] = {{ 0.0, -0.0, 1e300, -1e300, 1e308, 1e-310, INFINITY, -INFINITY, NAN, 1.0 }};
    return draw() < 0.3 ? some[(int)(draw() * 10.0)] : 1000.0 * (draw() - 0.5);
}}

int main(void)
{{
    static double T[37][12], g[37][{name}_N], q[37][{name}_N], z[37][{name}_NZ], p[{name}_NP];
    double J[6 * {name}_N], F[12];
    int code[37], round, i, j, bad = 0;
    for (round = 0; round < {rounds}; ++round) {{
        for (i = 0; i < {name}_NP; ++i) {{
            p[i] = {name}_p0[i] * (1.0 + 1e-3 * draw());
            p[i] = draw() < 0.001 ? odd() : p[i];
        }}
        for (i = 0; i < 37; ++i) {{
            for (j = 0; j < {name}_N; ++j) {{
                g[i][j] = draw() < 0.8 ? draw() : odd();
                q[i][j] = -7.0;
            }}
            for (j = 0; j < {name}_NZ; ++j) {{
                z[i][j] = draw() < 0.9 ? {name}_z0[j] : odd();
            }}
            for (j = 0; j < 12; ++j) {{
                T[i][j] = draw() < 0.05 ? odd() : T[i][j];
            }}
            (void){name}_fk(0, 0, g[i], T[i]);
        }}
        (void){name}_ik_n(round % 2 ? p : 0, round % 4 == 2 ? z[0] : 0, 37, T[0], g[0], q[0], code);
        (void){name}_ik_n(0, 0, round % 37, T[0], g[0], g[0], 0);
        for (i = 0; i < 37; ++i) {{
            for (j = 0; j < {name}_N; ++j) {{
                bad |= code[i] ? q[i][j] != -7.0 : !(fabs(q[i][j]) < 1e300);
            }}
        }}
        (void){name}_fk_from(p, z[1], g[1], T[1], F);
        (void){name}_jac(p, 0, g[2], J);
        (void){name}_compensate(p, z[3], g[3], q[3]);
        (void){name}_ik(p, z[4], T[4], g[4], q[4]);
    }}
    return bad;
}}
"""


@pytest.mark.nightly
@needs_compiler
@pytest.mark.parametrize("name", ["plain_turns", "warm_rails", "coupled_rails", "weighed_rails"])
def test_nothing_hostile_does_harm(root_directory: Path, sanitizers: list[str], name: str) -> None:
    built = legged(root_directory, name)
    assert COMPILER is not None
    (built.directory / "hostile.c").write_text(_HOSTILE.format(name=name, rounds=4))
    flags = ["-std=c99", "-O0", "-g", *sanitizers]
    sources = ["hostile.c", f"{name}_kin.c", f"{name}_batch.c"]
    made = subprocess.run(
        [COMPILER, *flags, *sources, "-lm", "-o", "hostile"],
        cwd=built.directory,
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    ran = subprocess.run(
        ["./hostile"], cwd=built.directory, capture_output=True, text=True, timeout=600, check=False
    )
    assert ran.returncode == 0, ran.stderr


@pytest.mark.nightly
@needs_compiler
@pytest.mark.parametrize(("name", "real"), [("screw_rails", "double"), ("plain_turns", "float")])
def test_optimising_finds_nothing_to_warn_of(root_directory: Path, name: str, real: Real) -> None:
    built = legged(root_directory, name, real, ("-O3",))  # compiled with -Werror
    row = built.samples()[0]
    assert built.ik(row[built.n :], row[: built.n])[0] == 0
