"""Every solver on every machine: one estimate, exact derivatives, outcomes that are told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.built_machines import FRAMES, manufactured, nominal
from support.moving_machines import record, written
from support.solvers import GRAPHS, MACHINES, MADE, SAME, apart, bounded, hexapod, simulated
from truepose.errors import ConvergenceError
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.problem import Problem, prior_of
from truepose.identification.leaves.ipopt.solving import OPTIONS, Program
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine


def built(machines: Mapping[str, Machine], name: str, seed: int, **more: int) -> tuple[Machine, Recording]:
    """Return a machine, and a recording of it as it was made."""
    machine, rng = machines[name], np.random.default_rng(seed)
    return machine, simulated(machine, manufactured(machine, rng), rng, **more)


# ------------------------------------------------------------------------------------ one minimum


@pytest.mark.parametrize("name", [*MACHINES, *GRAPHS])
def test_all_solvers_find_one_minimum(machines: Mapping[str, Machine], name: str) -> None:
    machine, recording = built(machines, name, 1)
    gn, lm = (estimate(machine, recording, damping=damping, tolerance=1e-13) for damping in (0.0, 1e-4))
    ipopt = bounded(machine, recording)
    assert gn.chi2_per_dof == pytest.approx(1.0, abs=0.4)
    assert apart(lm, gn) < SAME
    assert apart(ipopt, gn) < SAME
    np.testing.assert_allclose(ipopt.std, gn.std, rtol=1e-5)
    np.testing.assert_allclose(ipopt.x, gn.x, atol=1e-5)
    assert type(ipopt) is type(gn) and ipopt.factor.shape == gn.factor.shape
    assert ipopt.solution.iterations < 30


def test_robust_fits_agree_too(machines: Mapping[str, Machine]) -> None:
    machine, clean = built(machines, "6-ups", 2)
    wild = {name: values.copy() for name, values in clean.observations.items()}
    wild["x"][::10] += 1.0
    recording = replace(clean, observations=wild)
    gn, ipopt = estimate(machine, recording, loss="huber"), bounded(machine, recording, loss="huber")
    assert gn.weights.min() < 0.1
    # weights settle to 3e-3, and each solver's own end decides where
    assert apart(ipopt, gn) < 1e-4
    np.testing.assert_allclose(ipopt.weights, gn.weights, atol=1e-3)


@pytest.mark.parametrize("name", MACHINES)
def test_the_programs_derivatives(machines: Mapping[str, Machine], name: str) -> None:
    """Readings and equations by every unknown, along random directions, against differences."""
    machine, recording = built(machines, name, 3, n=5)
    prior, rng = prior_of(machine), np.random.default_rng(15)
    problem = Problem(Predictor(machine, recording), prior, nominal(machine), ~recording.validation)
    program = Program(problem, np.zeros(len(prior.free)))
    v = np.append(rng.standard_normal(program.n), 0.1 * rng.standard_normal(program.size - program.n))
    v[: program.n] /= program.step  # one tolerance
    for function in (program.observations, program.equations):
        _, slopes = function(v)
        for _ in range(4):
            way = rng.standard_normal(program.size)
            ends = [function(v + sign * 1e-4 * way)[0] for sign in (-1, 1)]
            slope = slopes @ way
            scale = 1.0 + np.max(np.abs(slope), initial=0.0)
            np.testing.assert_allclose((ends[1] - ends[0]) / 2e-4, slope, atol=1e-6 * scale)


# ------------------------------------------------------------------------------------ outcomes


@pytest.mark.parametrize("name", ["arm", "6-ups"])
def test_an_end_that_is_no_minimum_names_what_still_moves(
    machines: Mapping[str, Machine], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = machines[name]
    truth = nominal(machine)
    truth[[p.name for p in machine.parameters].index("tool.x")] += 20.0
    recording = simulated(machine, truth, np.random.default_rng(9))
    monkeypatch.setitem(OPTIONS, "ipopt.max_iter", 0)
    with pytest.raises(ConvergenceError, match=r"iteration limit.*responsible: .*tool\.x"):
        bounded(machine, recording)


def test_rows_that_cannot_be_assembled_are_left_out(machines: Mapping[str, Machine]) -> None:
    machine, recording = built(machines, "6-ups", 10)
    q = recording.q.copy()
    q[5, 2] = 5000.0
    fit = bounded(machine, replace(recording, q=q))
    rest = estimate(machine, recording.subset(np.arange(len(q)) != 5))
    assert fit.unassembled == (5,)
    assert apart(fit, rest) < SAME


def test_lost_readings_are_left_out(machines: Mapping[str, Machine]) -> None:
    machine, recording = built(machines, "6-pus", 14)
    gaps = np.where(np.arange(len(recording)) % 5 == 0, np.nan, recording.observations["x"])
    lost = replace(recording, observations={**recording.observations, "x": gaps})
    assert apart(bounded(machine, lost), estimate(machine, lost)) < SAME


def test_validation_rows_are_not_fitted(machines: Mapping[str, Machine]) -> None:
    machine, recording = built(machines, "6-pus", 11)
    out = np.arange(len(recording)) % 4 == 0
    spoiled = {name: np.where(out, values + 1.0, values) for name, values in recording.observations.items()}
    fit = bounded(machine, replace(recording, observations=spoiled, validation=out))
    assert apart(fit, estimate(machine, recording.subset(~out))) < SAME


def test_readings_that_compare_rows(tmp_path: Path) -> None:
    """A cavity's change between two rows of a machine with loops couples the rows' coordinates."""
    sensor = (
        "sensor: [{type: position, sigma: {xyz: 0.05}}, {type: distance, sigma: {distance: 0.001}, "
        "beam: {xyz: [0, 0, 900]}, mirror: {in: tool, z: 2, rx: 3, ry: -4}}]\n"
    )
    machine = written(tmp_path, MADE + FRAMES + hexapod("6-ups", "range: [480, 560]") + sensor)
    rng = np.random.default_rng(12)
    truth, n = manufactured(machine, rng), 25
    q = 500.0 + rng.uniform(-15, 15, (n, 6))
    poses = record(machine, q)
    origin = np.maximum(np.arange(n) - 1, 0)
    poses = replace(poses, from_row=origin)
    predictor = Predictor(machine, poses)
    names, values, _, _ = predictor.columns(truth, predictor.assemble(truth)[0])
    noise = np.array([0.05, 0.05, 0.05, 0.001]) * rng.standard_normal(values.shape)
    recording = replace(poses, observations=dict(zip(names, (values + noise).T, strict=True)))
    assert apart(bounded(machine, recording), estimate(machine, recording)) < SAME
