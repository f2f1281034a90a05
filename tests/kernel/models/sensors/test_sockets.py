"""A ball in a socket: the least squares it stands for, degrees of freedom, and what must not matter.

Recordings come from a plain numpy arm, which shares no code with the package."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from support.socket_arm import (
    NAMES,
    SEATS,
    SOCKET,
    as_built,
    ball_at,
    campaign,
    machine_of,
    read,
    residuals,
    table,
)
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.summary import rms_by_kind
from truepose.identification.prediction.predictor import Predictor
from truepose.models.machine.sensor import Rows
from truepose.models.sensors.socket import Seats, Socket

Array = NDArray[np.float64]


# -- what a socket stands for --------------------------------------------------------------------------


def seats(group: Sequence[int], pairs: tuple[tuple[int, int], ...], weight: Array | None = None) -> Seats:
    at = np.array(group)
    weight = np.ones(len(at)) if weight is None else weight
    return Seats(at, weight, np.ones(len(at), dtype=bool), np.ones(max(group) + 1, dtype=bool), pairs, 50.0)


def test_a_socket_stands_where_least_squares_puts_it() -> None:
    """The closed form against a solver that has the points among its unknowns; one pair far from its spacing."""
    rng = np.random.default_rng(1)
    group = [0, 0, 0, 1, 1, 1, 1, 2, 2, 3]
    raw = rng.normal(0, 3, (10, 3)) + 40.0 * np.array(group)[:, None] * [1, 0, 0]
    weight = rng.uniform(0.2, 1, 10)

    def explicit(t: Array) -> Array:
        along = t[6:9] / np.linalg.norm(t[6:9])
        points = np.array([t[:3], t[:3] + 50.0 * along, t[3:6], t[9:12]])
        out: Array = (np.sqrt(weight)[:, None] * (raw - points[group])).ravel()
        return out

    start = np.concatenate([raw[0], raw[7], [1, 0.1, 0], raw[9]])
    best = least_squares(explicit, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    found = seats(group, ((0, 1),), weight).values(raw)
    assert np.sum(weight[:, None] * found**2) == pytest.approx(2 * best.cost, rel=1e-12)
    np.testing.assert_allclose(np.sqrt(weight)[:, None] * found, best.fun.reshape(-1, 3), atol=1e-6)


def test_two_sockets_of_a_placement_are_a_pair_from_one_row_each_on() -> None:
    """A row in either socket and the known distance say something; a socket that no row is fitted in says nothing."""
    ball = Socket((), 0.01, 50.0)
    labels = {"placement": ("p", "p", "r", "r", "r"), "socket": ("a", "b", "a", "b", "b")}
    raw = np.array([[0.0, 0, 0], [53.0, 0, 0], [0, 0, 0], [0, 50.0, 0], [0, 50.0, 0]])
    found = ball.comparison(Rows(None, labels, np.ones(5)))
    assert isinstance(found, Seats) and found.pairs == ((0, 1), (2, 3)) and found.fitted.all()
    np.testing.assert_allclose(found.values(raw)[:, 0], [-1.5, 1.5, 0, 0, 0])
    lone = ball.comparison(Rows(None, labels, np.array([1.0, 0.0, 1.0, 1.0, 0.0])))
    assert isinstance(lone, Seats) and lone.pairs == ((2, 3),)
    assert lone.fitted.tolist() == [True, False, True, True]
    assert lone.weight.tolist() == [
        1.0,
        1.0,
        1.0,
        1.0,
        0.0,
    ]  # what no fitted row holds stands at its own rows


def test_unknowns_of_sockets_are_those_that_rows_determine() -> None:
    assert seats([0, 0, 1, 1], ()).unknowns == 6
    assert seats([0, 0, 1, 1], ((0, 1),)).unknowns == 5
    assert seats([0, 0, 1], ()).unknowns == 3  # one row alone says nothing
    assert seats([0, 1], ((0, 1),)).unknowns == 5  # but two sockets at a known distance do
    np.testing.assert_array_equal(
        seats([0, 0, 1], ()).values(np.random.default_rng(0).random((3, 3)))[2], 0.0
    )


def test_the_fit_is_the_one_with_the_sockets_as_unknowns(tmp_path: Path) -> None:
    """Every parameter of the arm under its tolerance, and all sockets: one plain problem for an outside solver."""
    machine, recording, _, _ = campaign(tmp_path, 7, each=6)
    fit = estimate(machine, recording)
    free = [machine.parameters[k].name for k in fit.prior.free]
    tolerance = fit.prior.sigma[fit.prior.free]
    start = np.array([fit.prior.mean[k] for k in fit.prior.free])
    group = np.repeat(np.arange(6), 6)

    def explicit(t: Array) -> Array:
        values = dict(zip(free, start + t[: len(free)] * tolerance, strict=True))
        rows = np.array([values[name] for name in NAMES]).reshape(6, 4)
        ball = np.array([values[f"ball.{axis}"] for axis in "xyz"])
        points = t[len(free) :].reshape(3, 2, 3).copy()
        points[:, 1] = points[:, 0] + 60.0 * points[:, 1] / np.linalg.norm(points[:, 1], axis=1)[:, None]
        off = ball_at(recording.q, rows, ball) - points.reshape(6, 3)[group]
        return np.concatenate([off.ravel() / 0.05, t[: len(free)]])

    guess = np.array([(a, np.subtract(b, a)) for a, b in SEATS.values()]).ravel()
    found = least_squares(
        explicit,
        np.concatenate([np.zeros(len(free)), guess]),
        x_scale="jac",
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-12,
    )
    assert 0.5 * (fit.chi2 + np.sum(fit.in_tolerances**2)) == pytest.approx(found.cost, rel=1e-8)
    # where the outside solver stops: its cost no longer falls
    np.testing.assert_allclose((fit.p[fit.prior.free] - start) / tolerance, found.x[: len(free)], atol=2e-3)


def test_degrees_of_freedom_count_the_sockets(tmp_path: Path) -> None:
    """Arms drawn from the tolerances: chi2 per degree of freedom is 1 on average.

    Four rows a socket: the 15 unknowns of the sockets are a third of the degrees of freedom that are left.
    """
    fits = [estimate(*campaign(tmp_path, seed)[:2]) for seed in range(24)]
    ratios = np.array([fit.chi2_per_dof for fit in fits])
    dof = np.mean([fit.n_observations - fit.effective_parameters for fit in fits])
    assert fits[0].levels == 15
    assert fits[0].n_observations == 72 - 15
    assert np.mean(ratios) == pytest.approx(
        1.0, abs=4 * np.sqrt(2 / dof / len(fits))
    )  # 4 sigma of chi2's mean
    blind = np.mean([fit.chi2 / (72 - fit.effective_parameters) for fit in fits])
    assert blind < 1 - 4 * np.sqrt(2 / dof / len(fits))  # without them it would not be


# -- invariances ---------------------------------------------------------------------------------------


def test_rows_may_stand_in_any_order_and_the_base_anywhere(tmp_path: Path) -> None:
    machine, recording, _, _ = campaign(tmp_path, 13)
    fit = estimate(machine, recording)
    frame = pd.read_csv(tmp_path / "rows.csv").sample(frac=1.0, random_state=4)
    shuffled = estimate(machine, read(tmp_path, machine, frame))
    np.testing.assert_allclose(shuffled.p, fit.p, atol=1e-9)
    assert shuffled.chi2 == pytest.approx(fit.chi2, rel=1e-9)
    frames = "frames: {base: {in: world, xyz: [500, -300, 200], rpy: [10, 20, 130], tolerance: {xyz: 0, rpy: 0}}}\n"
    moved = estimate(machine_of(tmp_path, SOCKET, more=frames), recording)
    same = [k for k, name in enumerate(fit.prior.names) if not name.startswith("base.")]
    np.testing.assert_allclose(moved.p[same], fit.p[same], atol=1e-7)


def test_rows_that_are_not_fitted_move_no_socket(tmp_path: Path) -> None:
    machine, recording, _, _ = campaign(tmp_path, 17, each=6)
    out = np.zeros(len(recording), dtype=bool)
    out[::6] = True
    fit = estimate(machine, recording, exclude=out)
    fewer = estimate(machine, recording.subset(~out))
    np.testing.assert_allclose(fit.p, fewer.p, atol=1e-9)
    held = replace(recording, validation=out)
    assert estimate(machine, held).chi2 == pytest.approx(fit.chi2, rel=1e-9)
    np.testing.assert_allclose(estimate(machine, held).residual, fit.residual, atol=1e-7)


def test_sets_may_have_balls_of_their_own(tmp_path: Path) -> None:
    rng = np.random.default_rng(23)
    rows, short, long = as_built(rng), np.array([5.0, -10.0, 80.0]), np.array([4.0, -12.0, 120.0])
    parts = [table(rng, rows, ball, 6).assign(set=name) for name, ball in (("short", short), ("long", long))]
    one = SOCKET.replace("{", "{sets: [short], ", 1)
    other = (
        SOCKET.replace("{", "{sets: [long], name: long, ", 1)
        .replace("80]", "115]")
        .replace("ball: 1", "ball: 10")
    )
    machine = machine_of(tmp_path, one, other)
    recording = read(tmp_path, machine, pd.concat(parts))
    fit = estimate(machine, recording)
    at = {name: k for k, name in enumerate(fit.prior.names)}
    found = [fit.p[[at[f"{prefix}ball.{axis}"] for axis in "xyz"]] for prefix in ("", "long.")]
    np.testing.assert_allclose(found[1] - found[0], long - short, atol=0.2)  # 5 sigma of the readings' part
    assert fit.levels == 30
    assert fit.n_observations == 3 * 72 - 30
    assert 0.6 < fit.chi2_per_dof < 1.4
    channels = [c for sensor in machine.sensors for c in sensor.channels]
    # each row has one ball: the two sensors share the rows, and the rms is that of 72 balls
    assert rms_by_kind(fit.residual, channels)["position"] == pytest.approx(0.05 * np.sqrt(3 * 0.75), rel=0.2)


def test_one_ball_over_several_sets_is_told(tmp_path: Path) -> None:
    rng = np.random.default_rng(23)
    rows, ball = as_built(rng), np.array([5.0, -10.0, 80.0])
    parts = [table(rng, rows, ball, 6).assign(set=name) for name in ("first", "second")]
    machine = machine_of(tmp_path, SOCKET)
    notes = calibrate(machine, read(tmp_path, machine, pd.concat(parts))).notes
    assert any("sets first, second are taken to have one ball" in note for note in notes)
    assert not any("one ball" in note for note in calibrate(machine, read(tmp_path, machine, parts[0])).notes)


def machine_truth(fit: Estimate, rows: Array, ball: Array) -> Array:
    p = fit.prior.mean.copy()
    at = {name: k for k, name in enumerate(fit.prior.names)}
    p[[at[name] for name in NAMES]] = rows.ravel()
    p[[at[f"ball.{axis}"] for axis in "xyz"]] = ball
    return p


def test_what_the_sockets_see_is_recovered(tmp_path: Path) -> None:
    """Distances between new poses of the ball, within what the fit says it knows; far better than the drawing."""
    machine, recording, rows, ball = campaign(tmp_path, 11, each=12)
    fit = estimate(machine, recording)
    rng = np.random.default_rng(2)
    fresh = table(rng, rows, ball, 2, sigma=0.0)
    new = Predictor(machine, read(tmp_path, machine, fresh))
    truth = machine_truth(fit, rows, ball)
    jacobian = np.concatenate([b.jacobian for b in new.blocks(fit.p, new.assemble(fit.p)[0])])
    seen = jacobian.reshape(-1, len(fit.p))[:, fit.prior.free]
    off = (residuals(new, fit.p) - residuals(new, truth)).ravel()
    std = np.sqrt(np.einsum("ij,jk,ik->i", seen, fit.covariance, seen))
    before = (residuals(new, new.model.p_home) - residuals(new, truth)).ravel()
    assert np.sqrt(np.mean(off**2)) < 0.2 * np.sqrt(np.mean(before**2))
    assert np.sqrt(np.mean((off / std) ** 2)) < 1.6  # 36 numbers of 20 or so independent ones
    assert np.abs(residuals(new, truth)).max() < 1e-6  # the two models of the arm are one


def test_a_bad_row_is_told_from_its_socket(tmp_path: Path) -> None:
    """A robust fit weighs the row down and moves its socket back to the others."""
    machine, recording, _, _ = campaign(tmp_path, 19, each=8)
    clean = estimate(machine, recording)
    q = recording.q.copy()
    q[3, 1] += 0.02  # about 10 mm
    broken = replace(recording, q=q)
    fit, plain = estimate(machine, broken, loss="huber"), estimate(machine, broken)
    assert fit.weights[3] < 0.05
    assert np.min(np.delete(fit.weights, 3)) > 0.2
    off, worse = (np.abs(f.in_tolerances - clean.in_tolerances).max() for f in (fit, plain))
    assert off < 0.3 * worse
