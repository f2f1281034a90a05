"""The benchmark of inverse kinematics beside peers: its arms, its independent forward model, its driver. No peer needed."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from support.generated_c import needs_compiler
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import symbolic_model

arms = import_module("inverse_kinematics.arms")
branches = import_module("inverse_kinematics.branches")
forward = import_module("inverse_kinematics.forward")
generated = import_module("inverse_kinematics.generated")
hexapod = import_module("inverse_kinematics.hexapod")
outcome = import_module("inverse_kinematics.outcome")
problems = import_module("inverse_kinematics.problems")
tables = import_module("inverse_kinematics.tables")
closed_form = import_module("inverse_kinematics.peer_scripts.numba_hexapod").closed_form

ROUNDING = 1e-10
"""mm: some dozen products of numbers up to 10^3 mm, in double."""
STUB_HEADER = """typedef double stub_real;
#define stub_N 2
#define stub_BRANCHES 3
int stub_ik(const double *p, const double *z, const double *T, const double *guess, double *q);
int stub_ik_all(const double *p, const double *z, const double *T, double *q, int *count);
"""
STUB = """#include "stub_kin.h"
int stub_ik(const double *p, const double *z, const double *T, const double *guess, double *q)
{
    (void)p; (void)z;
    q[0] = guess[0] + T[0]; q[1] = guess[1] + T[11];
    return 2;
}
int stub_ik_all(const double *p, const double *z, const double *T, double *q, int *count)
{
    (void)p; (void)z;
    q[0] = T[0]; q[1] = T[1]; q[2] = T[2]; q[3] = T[3]; *count = 2;
    return 0;
}
"""
STUB_BATCH_HEADER = """int stub_ik_n(const double *p, const double *z, int n, const double *T, const double *guess, double *q,
    int *code);
"""
STUB_BATCH = """#include "stub_kin.h"
#include "stub_batch.h"
int stub_ik_n(const double *p, const double *z, int n, const double *T, const double *guess, double *q, int *code)
{
    int i;
    for (i = 0; i < n; ++i) {
        (void)stub_ik(p, z, T + 12 * i, guess + 2 * i, q + 2 * i);
        code[i] = 5;
    }
    return n;
}
"""


@pytest.mark.parametrize("name", ["ur10", "puma"])
def test_forward_model_is_that_of_the_machine_file(name: str, tmp_path: Path) -> None:
    drawing = arms.DRAWINGS[name]
    machine = load_machine(arms.write(drawing, tmp_path))
    model = symbolic_model(machine, machine.effects)
    arm = arms.arm_of(drawing, arms.specimen(drawing))
    pose = ca.Function("pose", [model.q, model.z, model.p, model.x], [model.pose])
    q = np.random.default_rng(5).uniform(arm.ranges[:, 0], arm.ranges[:, 1], (20, 6))
    expected = [np.array(pose(row, model.z_home, model.p_home, model.home))[:3] for row in q]
    np.testing.assert_allclose(forward.poses(arm, q)[:, :3], expected, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("name", ["ur10", "puma"])
def test_every_constant_is_off_its_drawing_by_at_most_the_stated_error(name: str, tmp_path: Path) -> None:
    machine = load_machine(arms.write(arms.DRAWINGS[name], tmp_path))
    assert machine.file is not None
    free = {p.name: p for p in machine.parameters if p.free}
    assert set(machine.file.nominal) == set(free)
    for parameter, drawn in machine.file.nominal.items():
        off = abs(free[parameter].nominal - drawn)
        assert 0 < off <= (arms.LENGTH if free[parameter].unit == "mm" else np.radians(arms.ANGLE))


def test_placements_are_the_chain_between_turns() -> None:
    arm = arms.arm_of(arms.PUMA, arms.specimen(arms.PUMA))
    at_zero = np.linalg.multi_dot(list(forward.placements(arm)))
    np.testing.assert_allclose(at_zero, forward.poses(arm, np.zeros((1, 6)))[0], rtol=0, atol=ROUNDING)


def test_errors_are_the_motion_between_poses() -> None:
    arm = arms.arm_of(arms.UR10, arms.specimen(arms.UR10))
    turn = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1]])
    q = np.random.default_rng(1).uniform(-1, 1, (5, 6))
    there = forward.poses(arm, q)
    distance, angle = forward.errors(arm, q, there)
    assert np.max(distance) <= ROUNDING and np.max(angle) <= 1e-14
    there[:, :3, :3], there[:, :3, 3] = turn @ there[:, :3, :3], there[:, :3, 3] + [3.0, 0.0, 4.0]
    distance, angle = forward.errors(arm, q, there)
    np.testing.assert_allclose(distance, 5.0, rtol=1e-12)
    np.testing.assert_allclose(angle, 0.3, rtol=1e-12)
    assert not forward.solved(arm, np.full((5, 6), np.nan), there).any()


@needs_compiler
def test_driver_times_the_generated_inverse(tmp_path: Path) -> None:
    arm = arms.arm_of(arms.PUMA, arms.specimen(arms.PUMA))
    source = generated.write(arms.write(arms.PUMA, tmp_path), tmp_path, "double")
    given = problems.near(arm, 50)
    files = problems.save(given, tmp_path, "near")
    timing = generated.timed(generated.build(source, ("-O1",)), "one", files, 2, None)
    assert timing.seconds > 0 and np.all(timing.output[:, 0] == 0)
    assert forward.solved(arm, timing.output[:, 1:], given.targets).all()


@needs_compiler
def test_driver_calls_what_is_declared(tmp_path: Path) -> None:
    texts = {"kin.h": STUB_HEADER, "kin.c": STUB, "batch.h": STUB_BATCH_HEADER, "batch.c": STUB_BATCH}
    for part, text in texts.items():
        (tmp_path / f"stub_{part}").write_text(text)
    program = generated.build(
        generated.Source("stub", tmp_path, "double", 2, 3, True), ("-O1", "-Wall", "-Werror")
    )
    targets = np.arange(48.0).reshape(3, 4, 4)
    guesses = np.arange(6.0).reshape(3, 2)
    files = problems.save(problems.Problems(targets, guesses), tmp_path, "stub")
    joints = guesses + targets[:, [0, 2], [0, 3]]
    for mode, code in (("one", 2), ("batch", 5)):
        timing = generated.timed(program, mode, files, 1, None)
        np.testing.assert_array_equal(timing.output, np.column_stack([np.full(3, code), joints]))
    every = generated.timed(program, "all", files, 1, None).output
    np.testing.assert_array_equal(every, np.column_stack([[0] * 3, [2] * 3, targets[:, 0], np.zeros((3, 2))]))


def test_branches_are_compared_modulo_turns() -> None:
    arm = arms.arm_of(arms.UR10, arms.specimen(arms.UR10))
    q = np.random.default_rng(2).uniform(-3, 3, (2, 6))
    targets = forward.poses(arm, q)
    listed = np.hstack([q + 2 * np.pi, q + 0.1])  # a solution, turned round, and a wrong one
    found = branches.kept(arm, np.array([2, 1]), listed, targets)
    assert found.wrong == 1 and found.pose.tolist() == [0, 1]
    np.testing.assert_allclose(found.joints, q, rtol=0, atol=1e-14)
    one = branches.kept(arm, np.array([1, 0]), listed, targets)
    assert branches.unmatched(found, found) == 0
    assert branches.unmatched(found, one) == 1 and branches.unmatched(one, found) == 0


def test_hexapods_closed_form_gives_every_leg_its_length(tmp_path: Path) -> None:
    machine = hexapod.specimen()
    vectors, matrices = hexapod.poses(20)
    readings = np.empty((20, 6))
    closed_form(machine.rows(), vectors, readings)
    assert np.max(np.abs(machine.gaps(matrices, readings))) <= ROUNDING
    assert np.max(np.abs(readings)) < hexapod.STROKE
    path = tmp_path / "hexapod.yaml"
    hexapod.write_machine(path, hexapod.document(machine))
    loaded = {p.name: p.nominal for p in load_machine(path).parameters}
    assert loaded["leg3.length"] == machine.length[2]
    # a direction is made of length one again when it is read: a few roundings, other ones on another processor
    assert loaded["leg5.u.x"] == pytest.approx(machine.u[4, 0], rel=1e-14)


def test_ratios_are_to_the_same_flags_and_the_quietest_round_counts() -> None:
    kind, row = outcome.Kind, outcome.Row
    rounds = iter([[row("a", 3.0), row("b", 1.0)], [row("a", 2.0), row("b", 4.0)]])
    assert [r.seconds for r in outcome.quietest(lambda: next(rounds), 2)] == [2.0, 1.0]
    rows = [row("c", 1e-6, 1.0, kind.OURS, "-O3"), row("c", 2e-6, 0.5, kind.OURS, "-O2")]
    text = tables.timings([*rows, row("peer", 8e-6, flags="-O2"), row("other", 8e-3)])
    assert "| peer, -O2 | 8 us | 4.00 |" in text and "| other | 8 ms | 8000.00 |" in text
    assert "| 100 % |" in text and "| 50.000 % |" in text
