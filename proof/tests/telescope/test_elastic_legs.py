"""The telescope's elastic legs against independent beam elements: energy, balance, and the whole machine. mm, N, rad."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from challenge.simulator.telescope_ring import beams
from support.telescope_models import (
    LENGTH,
    MODELS,
    TRAVEL,
    apart,
    machine_of,
    model_text,
    number,
    poses_of,
    recording_of,
)
from truepose.identification.prediction.predictor import Predictor
from truepose.models import lie
from truepose.models.machine.mechanism import ElasticChain, Rod
from truepose.models.machine.near_home import Stance, strain_energy

Array = NDArray[np.float64]
simulator, campaigns = import_module("telescope_simulator"), import_module("telescope_models.campaign")


def chain_stiffness(lengths: list[float], sections: list[Any]) -> Array:
    """(12, 12) of a chain along x, its inner nodes condensed (eqs. 20 to 27), by independent elements."""
    n = len(lengths) + 1
    k = np.zeros((6 * n, 6 * n))
    for i, (length, section) in enumerate(zip(lengths, sections, strict=True)):
        at = slice(6 * i, 6 * i + 12)
        k[at, at] += beams.element_stiffness(section, length)
    ends = np.r_[0:6, 6 * n - 6 : 6 * n]
    inner = np.setdiff1d(np.arange(6 * n), ends)
    inside = np.linalg.solve(k[np.ix_(inner, inner)], k[np.ix_(inner, ends)])
    return np.asarray(k[np.ix_(ends, ends)] - k[np.ix_(ends, inner)] @ inside)


FLEXURE = beams.Section.round_bar(6.2, 110e3)
BAR = beams.Section.round_bar(40.0, 200e3)
NAMES = ("flexure.bending", "flexure.tension", "flexure.torsion", "rod.bending", "rod.tension", "rod.torsion")
VALUES = {
    name: ca.SX(value)
    for name, value in zip(
        NAMES, (FLEXURE.ei_y, FLEXURE.ea, FLEXURE.gj, BAR.ei_y, BAR.ea, BAR.gj), strict=True
    )
} | {"leg.flexure": ca.SX(LENGTH)}
CHAIN = ElasticChain("leg.flexure", (NAMES[0], NAMES[1], NAMES[2]), (NAMES[3], NAMES[4], NAMES[5]), 1e4)
ROD = Rod("leg", "a", None, "b", None, "leg.length", 500.0, elastic=CHAIN)


def frame(turn: Array, at: Array) -> ca.SX:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = lie.exp_so3(turn), at
    return ca.SX(ca.DM(out))


def test_the_energy_of_a_rod_is_that_of_its_condensed_elements() -> None:
    """Both ends displaced and turned at random; stiffness 20 to 27 from the simulator's own elements."""
    rng = np.random.default_rng(11)
    start, along = np.array([10.0, -20.0, 30.0]), np.array([0.3, -0.2, 0.9])
    along /= np.linalg.norm(along)
    far = start + 500.0 * along
    frames = frame(rng.normal(size=3), start), frame(rng.normal(size=3), far)
    k = chain_stiffness([LENGTH, 500.0 - LENGTH, LENGTH], [FLEXURE, BAR, FLEXURE])
    local = np.kron(np.eye(4), beams.beam_frame(start, far, np.array([0.0, 0.0, 1.0])))
    for _ in range(5):
        shifts, turns = rng.normal(size=(2, 3)), 0.01 * rng.normal(size=(2, 3))
        rotations = lie.exp_so3(turns)
        moved = [turned(f, r, s) for f, r, s in zip(frames, rotations, shifts, strict=True)]
        # the nodes lie half a flexure beyond the centres; small rotations are the skew part's vector
        beyond = LENGTH / 2 * np.outer((-1, 1), along)
        nodes = shifts + np.einsum("kij,kj->ki", rotations - np.eye(3), beyond)
        small = [np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2 for r in rotations]
        u = local.T @ np.concatenate([nodes[0], small[0], nodes[1], small[1]])
        energy = number(strain_energy(ROD, placed(frames, 500.0), placed(moved, 500.0)))
        assert energy == pytest.approx(0.5 * u @ k @ u, rel=1e-9)
        # a rod that grew is as strained as one whose far end came nearer by as much
        nodes[1] -= 0.3 * along
        u = local.T @ np.concatenate([nodes[0], small[0], nodes[1], small[1]])
        energy = number(strain_energy(ROD, placed(frames, 500.0), placed(moved, 500.3)))
        assert energy == pytest.approx(0.5 * u @ k @ u, rel=1e-9)


def placed(frames: Sequence[ca.SX], length: float) -> tuple[Stance, Any]:
    """A stance of the rod's values and its length, and the frames of the two bodies that clamp it."""
    values = VALUES | {"leg.length": ca.SX(length)}
    return Stance(values, {}, ca.SX(0, 1), ()), SimpleNamespace(bodies=dict(zip("ab", frames, strict=True)))


def turned(home: ca.SX, rotation: Array, shift: Array) -> ca.SX:
    out = np.array(ca.evalf(home), dtype=float)
    out[:3, :3], out[:3, 3] = rotation @ out[:3, :3], out[:3, 3] + shift
    return ca.SX(ca.DM(out))


def test_the_printed_stiffness_matrix_holds_a_rod_against_turning_freely() -> None:
    """Equation 21 as printed: rows 5 and 6 of K12 and K21 have the wrong sign, so that a rigid turn costs force."""
    length, ei = LENGTH, FLEXURE.ei_y
    right = beams.element_stiffness(FLEXURE, length)
    printed = right.copy()
    for row, column in ((4, 2), (5, 1)):
        printed[row, 6 + column] *= -1
        printed[6 + row, column] *= -1
    turn = np.zeros(12)
    turn[5] = turn[11] = 1.0
    turn[7] = length  # about z at the near end: the far end moves along y
    assert np.abs(right @ turn).max() < 1e-9 * ei
    assert np.abs(printed @ turn).max() > ei / length
    assert np.allclose(right, right.T, rtol=1e-12) and not np.allclose(printed, printed.T, rtol=1e-3)


def test_elastic_legs_meet_the_finite_element_simulator(tmp_path: Path) -> None:
    """Co-rotating elements and shortening there, small rotations here; ball joints are 1.7 um away."""
    truth = simulator.simulate(
        simulator.nominal_machine(), TRAVEL, ring_stiffness=np.inf, joints="flexure"
    ).pose_world_tool
    away = {model: apart(poses_of(tmp_path, machine_of(tmp_path, model), TRAVEL), truth) for model in MODELS}
    assert away["elastic"] < 0.8e-3
    assert 1.2e-3 < away["spherical"] < 2.5e-3
    assert away["stiffness"] > 5e-3  # the directions kept at home cost more than the flexures do


def rotation_of(mrp: Array) -> Array:
    return np.asarray(ca.evalf(lie.mrp_rotation(ca.SX(ca.DM(mrp)))), dtype=float)


def test_the_platform_is_in_balance(tmp_path: Path) -> None:
    """Equation 19: loads at b' from the condensed stiffness, moments carried to the platform's centre, add to zero."""
    machine = machine_of(tmp_path, "stiffness")
    predictor = Predictor(machine, recording_of(tmp_path, machine, TRAVEL))
    x, _ = predictor.assemble(predictor.model.p_home)
    drawn = simulator.nominal_machine()
    k = chain_stiffness([LENGTH, 500.0 - LENGTH, LENGTH], [FLEXURE, BAR, FLEXURE])
    home, at_home = x[0, 6:9], rotation_of(x[0, 9:])
    a, b = drawn.lower_centres(np.zeros(6)), drawn.upper_centres @ at_home.T
    for row, rho in zip(x, TRAVEL, strict=True):
        turn = rotation_of(row[3:6]) @ at_home.T
        forces, moments = [], []
        for i in range(6):
            axes = beams.beam_frame(a[i], home + b[i], np.array([0.0, 0.0, 1.0]))
            node = b[i] + LENGTH / 2 * axes[:, 0]
            u = np.zeros((4, 3))
            u[0] = rho[i] * drawn.directions[i]
            u[2] = row[:3] + turn @ node - home - node
            u[3] = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
            load = (k @ (u @ axes).ravel()).reshape(4, 3) @ axes.T
            forces.append(load[2])
            moments.append(np.cross(turn @ node, load[2]) + load[3])
        # sections are written with 6 digits; moments of the clamped ends are taken to first order in the turn (9 mrad)
        assert np.linalg.norm(np.sum(forces, axis=0)) < 1e-5 * np.sum(np.linalg.norm(forces, axis=1))
        assert np.linalg.norm(np.sum(moments, axis=0)) < 1e-3 * np.sum(np.linalg.norm(moments, axis=1))


@pytest.mark.parametrize("model", MODELS)
def test_the_products_tests_know_the_same_telescope(model: str) -> None:
    assert model_text(model).split() == campaigns.model_text(model, "pose").split()
    assert np.array_equal(TRAVEL, simulator.paper_poses()[1][: len(TRAVEL)])
