"""One Newton closes loops: whoever asks gets the same assembly, and is told where there is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from support import MACHINES
from support.simulated import machine_from
from truepose.codegen.layout import layout_of
from truepose.codegen.reference import Reference
from truepose.errors import InputError
from truepose.identification.compensation.inverse import PoseSolver
from truepose.identification.prediction.loops import Loops
from truepose.models.file.machine_file import read_machine
from truepose.models.load import build_machine, load_machine
from truepose.models.machine.closure import CoordinateScale, closed, solved
from truepose.models.machine.kinematics import symbolic_model

Array = NDArray[np.float64]


@pytest.mark.parametrize("name", ["delta", "hybrid", "planar", "pus", "ups"])
def test_fit_inverse_and_test_vectors_take_the_same_assembly(name: str) -> None:
    machine = load_machine(MACHINES / f"{name}.yaml")
    model = symbolic_model(machine)
    rng = np.random.default_rng(3)
    ranges = np.array([a.range or (-0.2, 0.2) for a in machine.mechanism.actuators])
    q = model.q_home + 0.3 * (rng.uniform(ranges[:, 0], ranges[:, 1], (12, len(ranges))) - model.q_home)
    loops = Loops(model)
    z = np.tile(model.z_home, (len(q), 1))
    x, good = loops.assemble(q, z, model.p_home)
    gap = loops.closure(x, q, z, model.p_home)[2]
    strain = loops.scale.gap if np.isfinite(loops.scale.gap) else 1e-9
    assert good.all() and np.max(np.abs(gap)) < strain
    poses, assembled = PoseSolver(machine).forward(q)
    assert assembled.all()
    world = ca.Function("world", [model.x, model.q, model.z, model.p], [model.world])
    reference = Reference(model)
    for k, row in enumerate(q):
        found = reference.passive(row)
        assert found is not None
        np.testing.assert_allclose(found, x[k], rtol=0, atol=1e-9)
        pose = np.array(world(found, row, z[k], model.p_home))
        np.testing.assert_allclose(pose, poses[k], rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["pus", "ups"])
def test_readings_that_no_assembly_has_are_told(name: str) -> None:
    machine = load_machine(MACHINES / f"{name}.yaml")
    model = symbolic_model(machine)
    q = np.array([model.q_home, model.q_home])
    q[1, 0] += 1e4
    _, good = PoseSolver(machine).forward(q)
    assert good.tolist() == [True, False]


def test_rows_out_of_newtons_reach_are_followed_along_a_way() -> None:
    """A way of two hundred short steps ends in the same assembly."""
    machine = load_machine(MACHINES / "planar.yaml")
    model = symbolic_model(machine)
    loops, z = Loops(model), model.z_home[None]
    away = np.random.default_rng(7).uniform(-0.8, 0.8, (60, len(model.q_home)))
    followed = 0
    for step in away:
        q = (model.q_home + step)[None]
        x, good = loops.assemble(q, z, model.p_home)
        if not good[0] or loops.assemble(q, z, model.p_home, follow=False)[1][0]:
            continue
        at = model.home[None]
        for part in np.linspace(0.0, 1.0, 201):
            there = model.q_home + part * (q - model.q_home)
            at, near = loops.assemble(there, z, model.p_home, at, follow=False)
            assert near[0]
        np.testing.assert_allclose(x, at, rtol=0, atol=1e-8)
        followed += 1
    assert followed > 3


def test_places_to_stand_at_are_given_up_where_none_of_the_first_will_do() -> None:
    """A range of a kilometre in place of millimetres: each of ten times as many places would take Newton's longest."""
    tried = []

    class Counted(Reference):
        def forward(self, q: Array, near: Array | None = None) -> Array | None:
            tried.append(q)
            return super().forward(q, near)

    reference = Counted(symbolic_model(load_machine(MACHINES / "pus.yaml")))
    near, wide = reference.model.q_home, np.eye(6)[0] * 1e6
    assert not list(reference.samples(near + wide, near + 2 * wide, near, 3))
    assert len({tuple(q) for q in tried}) == 3 * 4
    # from home on all of them will do
    assert len(list(reference.samples(near - 1e-3, near + 1e-3, near, 3))) == 3


def test_rows_are_judged_one_by_one() -> None:
    """x^2 = c: closed from the right where c > 0; nothing closes where c < 0, or where a gap stays."""
    c = np.array([4.0, -1.0, 9.0, 1e-2])

    def equations(x: Array, rows: NDArray[np.intp]) -> tuple[Array, Array, Array]:
        g = (x**2 - c[rows, None])[..., None]
        return g, 2 * x[..., None], np.where(rows == 2, 1.0, 0.0)[:, None, None]

    scale = CoordinateScale(np.ones(1), np.full(1, 0.5), 0.5)
    x, good = closed(equations, np.full((4, 1), 1.0), scale)
    assert good.tolist() == [True, False, False, True]
    np.testing.assert_allclose(x[[0, 3], 0], [2.0, 0.1], rtol=1e-12)


@pytest.mark.parametrize("equations", [3, 5])
@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan])
@pytest.mark.parametrize("of", ["matrix", "right side"])
def test_a_row_that_is_not_finite_has_no_solution_and_spoils_no_other(
    equations: int, value: float, of: str
) -> None:
    rng = np.random.default_rng(4)
    a, b = rng.standard_normal((4, equations, 3)), rng.standard_normal((4, equations, 2))
    others = solved(np.delete(a, 1, axis=0), np.delete(b, 1, axis=0))
    (a if of == "matrix" else b)[1, 2, 0] = value
    found = solved(a, b)
    assert np.isnan(found[1]).all()
    np.testing.assert_array_equal(np.delete(found, 1, axis=0), others)


@given(home=st.tuples(*[st.floats(-0.2, 0.2)] * 2, st.floats(0.8, 1.2), *[st.floats(-20.0, 20.0)] * 3))
def test_legs_without_ranges_read_at_home_what_their_lengths_are_there(home: tuple[float, ...]) -> None:
    """Absolute lengths as well as lengths from an offset: the file's home is the assembly."""
    file = read_machine(MACHINES / "ups.yaml")
    legs = [{key: value for key, value in leg.items() if key != "range"} for leg in file.mechanism["legs"]]
    legs = [leg | {"offset": offset} for leg, offset in zip(legs, (0, 300, -100, 250, 0, 20), strict=True)]
    placed = [*(260.0 * value for value in home[:3]), *home[3:]]
    model = symbolic_model(
        build_machine(replace(file, mechanism={**file.mechanism, "legs": legs, "home": placed}))
    )
    platform = model.machine.mechanism.unknown[0]
    np.testing.assert_allclose(model.home, platform.home, rtol=0, atol=1e-9)


FIVE_BAR = """
schema: truepose/machine/1
name: fivebar
mechanism:
  type: graph
  bodies: [world, c1, r1, pen, c2, r2]
  flange: pen
  joints:
    - {name: a1, kind: revolute, parent: world, child: c1, xyz: [-100, 0, 0], axis: [0, 0, 1], actuated: true}
    - {name: e1, kind: revolute, parent: c1, child: r1, xyz: [150, 0, 0], axis: [0, 0, 1]}
    - {name: pen_joint, kind: fixed, parent: r1, child: pen, xyz: [450, 0, 0]}
    - {name: a2, kind: revolute, parent: world, child: c2, xyz: [100, 0, 0], axis: [0, 0, 1], actuated: true}
    - {name: e2, kind: revolute, parent: c2, child: r2, xyz: [150, 0, 0], axis: [0, 0, 1]}
    - {name: tie, kind: spherical, parent: r2, child: pen, xyz: [250, 0, 0]}
  home: HOME
"""


@pytest.mark.parametrize("side", [1, -1])
def test_vectors_of_the_c_are_in_the_assembly_of_the_file_s_home(tmp_path: Path, side: int) -> None:
    """Joints without ranges: the readings at home are the file's, not zeros, at which no loop closes."""
    degrees = {"a1": 150 * side, "e1": -118 * side, "a2": 30 * side, "e2": 78 * side}
    machine = machine_from(tmp_path, FIVE_BAR.replace("HOME", str(degrees).replace("'", "")))
    vectors = layout_of(symbolic_model(machine), "double").vectors
    poses, good = PoseSolver(machine).forward(np.array([q for q, _ in vectors]))
    assert good.all()
    np.testing.assert_allclose(poses, [pose for _, pose in vectors], rtol=0, atol=1e-6)


def test_no_c_is_written_of_a_home_where_assemblies_meet(tmp_path: Path) -> None:
    """Stretched out along a line, the elbow may turn to either side."""
    machine = machine_from(tmp_path, FIVE_BAR.replace("HOME", "{a1: 0, a2: 0}"))
    with pytest.raises(
        InputError, match=r"fivebar: mechanism\.home: found a singular pose, .* expected a home off it"
    ):
        layout_of(symbolic_model(machine), "double")
