"""A ball in a socket and a ball bar: derivatives, the least squares they stand for, degrees of freedom, diagnosis.

Recordings come from the plain numpy arm below, which shares no code with the package.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares, root

from truepose.errors import InputError
from truepose.identification.calibrate import calibrate
from truepose.identification.diagnosis.engine import diagnose
from truepose.identification.diagnosis.summary import rms_by_kind
from truepose.identification.estimate import Estimate, estimate
from truepose.identification.load import load_recording
from truepose.identification.predict import predict
from truepose.identification.prediction import Predictor
from truepose.identification.recording import Recording
from truepose.identification.simulate import simulate
from truepose.identification.write_machine import write_calibrated
from truepose.models.load import load_machine
from truepose.models.machine import Machine
from truepose.models.sensors.socket import Seats

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROWS = np.array(  # alpha, d, theta, r of each joint: deg and mm
    [[0, 0, 0, 300], [90, 50, 10, 0], [0, 400, 0, 20], [90, 30, 0, 350], [-90, 0, 0, 10], [90, 0, -20, 90]]
)
ARM = "schema: truepose/machine/1\nname: arm\nmechanism:\n  type: serial\n  joints:\n" + "".join(
    f"    - {{name: q{k}, kind: revolute, alpha: {a}, d: {d}, theta: {t}, r: {r}, range: [-170, 170]}}\n"
    for k, (a, d, t, r) in enumerate(ROWS, 1)
)
TOLERANCES = "tolerances: {length: 0.2, angle: 0.1, beta: 0}\n"
SOCKET = "{type: socket, ball: [5, -10, 80], spacing: 60, sigma: {xyz: 0.05}, tolerance: {ball: 1}}"
BAR = (
    "{type: ballbar, name: bar, centre: [400, 100, 50], ball: [0, 20, 60], sigma: {distance: 0.02}, "
    "tolerance: {centre: 2, ball: [1, 1, 0.5]}}"
)
POSITION = "{type: position, sigma: {xyz: 0.05}}"
SEATS = {  # placement: its two sockets, 60 mm apart
    "front": ((480.0, 60.0, 420.0), (480.0, 120.0, 420.0)),
    "left": ((150.0, 500.0, 380.0), (198.0, 536.0, 380.0)),
    "low": ((380.0, -280.0, 200.0), (380.0, -244.0, 248.0)),
}
NAMES = [f"q{k}.{field}" for k in range(1, 7) for field in ("alpha", "d", "theta", "r")]


def arm(q: Array, rows: Array) -> tuple[Array, Array]:
    """Rotations (n, 3, 3) and positions (n, 3) of the flange: RotX(alpha) TransX(d) RotZ(theta + q) TransZ(r)."""
    turn, at = np.tile(np.eye(3), (len(q), 1, 1)), np.zeros((len(q), 3))
    for k, (alpha, d, theta, r) in enumerate(rows):
        ca, sa = np.cos(alpha), np.sin(alpha)
        c, s = np.cos(theta + q[:, k]), np.sin(theta + q[:, k])
        step = np.zeros((len(q), 3, 3))
        step[:, 0, 0], step[:, 0, 1] = c, -s
        step[:, 1, 0], step[:, 1, 1], step[:, 1, 2] = ca * s, ca * c, -sa
        step[:, 2, 0], step[:, 2, 1], step[:, 2, 2] = sa * s, sa * c, ca
        move = np.column_stack([np.full(len(q), d), np.full(len(q), -sa * r), np.full(len(q), ca * r)])
        at = at + np.einsum("nij,nj->ni", turn, move)
        turn = turn @ step
    return turn, at


def ball_at(q: Array, rows: Array, ball: Array) -> Array:
    """(n, 3) position of a point of the flange."""
    turn, at = arm(q, rows)
    return np.asarray(at + turn @ ball)


def nominal() -> Array:
    rows = ROWS.astype(float)
    rows[:, [0, 2]] = np.radians(rows[:, [0, 2]])
    return rows


def as_built(rng: np.random.Generator) -> Array:
    """Rows drawn from the tolerances of the machine file."""
    size = np.array([np.radians(0.1), 0.2, np.radians(0.1), 0.2])
    return np.asarray(nominal() + size * rng.standard_normal((6, 4)))


def seated(rng: np.random.Generator, rows: Array, ball: Array, point: Array) -> Array:
    """(6,) random joints that put the ball on a point: the last three at random, the first three solved for."""
    for _ in range(200):
        wrist = rng.uniform(-2.0, 2.0, 3)
        start = rng.uniform(-1.5, 1.5, 3)

        def off(first: Array, wrist: Array = wrist) -> Array:
            gap: Array = ball_at(np.concatenate([first, wrist])[None], rows, ball)[0] - point
            return gap

        found = root(off, start, tol=1e-12)
        if found.success and np.max(np.abs(found.x)) < 2.9:
            return np.concatenate([found.x, wrist])
    raise AssertionError("the arm does not reach the socket")


def table(rng: np.random.Generator, rows: Array, ball: Array, each: int, sigma: float = 0.05) -> pd.DataFrame:
    """``each`` rows in every socket, with noise of the seat."""
    out = []
    for placement, sockets in SEATS.items():
        for k, point in enumerate(sockets):
            for _ in range(each):
                q = seated(rng, rows, ball, np.array(point) + sigma * rng.standard_normal(3))
                out.append(
                    {"placement": placement, "socket": k}
                    | {f"q{j + 1}": a for j, a in enumerate(np.degrees(q))}
                )
    return pd.DataFrame(out)


def machine_of(folder: Path, *sensors: str, more: str = "") -> Machine:
    path = folder / "arm.yaml"
    listed = "sensor:\n" + "".join(f"  - {sensor}\n" for sensor in sensors)
    path.write_text(ARM + listed + TOLERANCES + more, encoding="utf-8")
    return load_machine(path)


def read(folder: Path, machine: Machine, frame: pd.DataFrame) -> Recording:
    frame.to_csv(folder / "rows.csv", index=False)
    return load_recording(machine, [folder / "rows.csv"])


def campaign(folder: Path, seed: int, each: int = 4) -> tuple[Machine, Recording, Array, Array]:
    """A machine with a socket, rows of an arm drawn from its tolerances, and that arm: rows, ball."""
    rng = np.random.default_rng(seed)
    rows, ball = as_built(rng), np.array([5.0, -10.0, 80.0]) + rng.standard_normal(3)
    machine = machine_of(folder, SOCKET)
    return machine, read(folder, machine, table(rng, rows, ball, each)), rows, ball


def residuals(predictor: Predictor, p: Array, weight: Array | Mask | None = None) -> Array:
    x, _ = predictor.assemble(p)
    return np.concatenate([block.residual for block in predictor.blocks(p, x, weight)])


def slopes(function: Callable[[Array], Array], p: Array, steps: Array) -> Array:
    """Derivative (..., np) by central differences of fourth order, whose error is that of rounding."""
    columns = []
    for k, h in enumerate(steps):
        e = np.zeros(len(p))
        e[k] = h
        near, far = function(p + e) - function(p - e), function(p + 2 * e) - function(p - 2 * e)
        columns.append((8 * near - far) / (12 * h))
    return np.stack(columns, axis=-1)


# -- derivatives ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "sensors", [(SOCKET,), (BAR,), (SOCKET, BAR, POSITION)], ids=["socket", "bar", "all"]
)
def test_jacobians_are_those_of_the_residuals(tmp_path: Path, sensors: Sequence[str]) -> None:
    rng = np.random.default_rng(3)
    machine = machine_of(tmp_path, *sensors)
    frame = table(rng, nominal(), np.array([5.0, -10.0, 80.0]), 3)
    frame[["x", "y", "z"]] = rng.uniform(-500, 500, (len(frame), 3))
    frame["bar.length"] = 300.0
    predictor = Predictor(machine, read(tmp_path, machine, frame))
    unit = np.array([1.0 if p.unit == "mm" else 1e-3 for p in machine.parameters])
    p = predictor.model.p_home + rng.standard_normal(len(unit)) * unit
    weight = rng.uniform(0.2, 1.0, len(frame)) * (rng.random(len(frame)) > 0.2)
    x, _ = predictor.assemble(p)
    exact = np.concatenate([block.jacobian for block in predictor.blocks(p, x, weight)])
    differences = slopes(lambda v: residuals(predictor, v, weight), p, 1e-1 * unit)
    # residuals of 1e4 sigma lose 1e-16 of it to rounding, divided by steps of 1e-4 rad; some columns are not seen
    scale = np.max(np.abs(exact), axis=(0, 1))
    scale = np.maximum(scale, 1e-3 * np.max(scale))
    np.testing.assert_allclose(differences / scale, exact / scale, atol=1e-7)


def test_a_bar_reads_the_distance_of_its_balls(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    machine = machine_of(tmp_path, BAR)
    q = rng.uniform(-2, 2, (12, 6))
    frame = pd.DataFrame(np.degrees(q), columns=[f"q{k}" for k in range(1, 7)])
    frame["bar.length [um]"] = 0.0
    found = predict(machine, read(tmp_path, machine, frame))
    at = ball_at(q, nominal(), np.array([0.0, 20.0, 60.0]))
    expected = np.linalg.norm(at - [400, 100, 50], axis=1)
    np.testing.assert_allclose(found["bar.length"], expected, rtol=1e-12)
    names = [p.name for p in machine.sensors[0].parameters]
    assert names == [f"bar.{end}.{axis}" for end in ("centre", "ball") for axis in "xyz"]
    assert [p.tolerance for p in machine.sensors[0].parameters] == [2, 2, 2, 1, 1, 0.5]
    alone = machine_of(tmp_path, BAR.replace("name: bar, ", ""))
    assert list(alone.sensors[0].columns) == ["length"]
    assert [p.name for p in alone.sensors[0].parameters] == [name.removeprefix("bar.") for name in names]


# -- what a socket stands for ---------------------------------------------------------------------------


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
    dof = np.mean([fit.readings - fit.effective_parameters for fit in fits])
    assert fits[0].levels == 15
    assert fits[0].readings == 72 - 15
    assert np.mean(ratios) == pytest.approx(
        1.0, abs=4 * np.sqrt(2 / dof / len(fits))
    )  # 4 sigma of chi2's mean
    blind = np.mean([fit.chi2 / (72 - fit.effective_parameters) for fit in fits])
    assert blind < 1 - 4 * np.sqrt(2 / dof / len(fits))  # without them it would not be


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


def machine_truth(fit: Estimate, rows: Array, ball: Array) -> Array:
    p = fit.prior.mean.copy()
    at = {name: k for k, name in enumerate(fit.prior.names)}
    p[[at[name] for name in NAMES]] = rows.ravel()
    p[[at[f"ball.{axis}"] for axis in "xyz"]] = ball
    return p


# -- invariances ----------------------------------------------------------------------------------------


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
    assert fit.readings == 3 * 72 - 30
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


# -- several sensors, commands --------------------------------------------------------------------------


def test_sockets_add_up_with_other_sensors(tmp_path: Path) -> None:
    rng = np.random.default_rng(29)
    rows, ball = as_built(rng), np.array([5.0, -10.0, 80.0])
    machine = machine_of(tmp_path, SOCKET, BAR, POSITION)
    frame = table(rng, rows, ball, 8)
    q = np.radians(frame[[f"q{k}" for k in range(1, 7)]].to_numpy())
    frame[["x", "y", "z"]] = arm(q, rows)[1] + 0.05 * rng.standard_normal((len(q), 3))
    tip = ball_at(q, rows, np.array([0.3, 20.5, 60.0]))
    frame["bar.length"] = np.linalg.norm(tip - [401, 99, 50.5], axis=1) + 0.02 * rng.standard_normal(len(q))
    recording = read(tmp_path, machine, frame)
    fit = estimate(machine, recording)
    at = {name: k for k, name in enumerate(fit.prior.names)}
    centre = [at[f"bar.centre.{axis}"] for axis in "xyz"]
    assert np.all(np.abs(fit.p[centre] - [401, 99, 50.5]) < 5 * fit.std[centre])
    assert np.all(fit.std[centre] < 0.3)
    assert fit.readings == 48 * 7 - 15
    assert 0.75 < fit.chi2_per_dof < 1.25  # 3 sigma of 280 degrees of freedom
    assert list(predict(machine, recording).columns[:2]) == ["bar.length", "bar.length.std"]
    write_calibrated(tmp_path / "calibrated.yaml", fit, recording)
    again = load_machine(tmp_path / "calibrated.yaml")
    np.testing.assert_allclose([p.nominal for p in again.parameters], fit.p, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("sensors", [(SOCKET,), (BAR, POSITION)], ids=["socket", "bar"])
def test_nothing_is_found_where_nothing_is_missing(tmp_path: Path, sensors: Sequence[str]) -> None:
    rng = np.random.default_rng(31)
    rows, ball = as_built(rng), np.array([5.0, -10.0, 80.0])
    machine = machine_of(tmp_path, *sensors, more="gravity: [0, 0, -9.80665]\n")
    frame = table(rng, rows, ball, 10)
    q = np.radians(frame[[f"q{k}" for k in range(1, 7)]].to_numpy())
    frame[["x", "y", "z"]] = arm(q, rows)[1] + 0.05 * rng.standard_normal((len(q), 3))
    tip = ball_at(q, rows, np.array([0.0, 20.0, 60.0]))
    frame["bar.length"] = np.linalg.norm(tip - [400, 100, 50], axis=1) + 0.02 * rng.standard_normal(len(q))
    found = diagnose(machine, read(tmp_path, machine, frame))
    assert found.verdict == "adequate"
    assert not any(alarm.raised for alarm in found.alarms.values())


def test_a_scale_is_found_in_sockets(tmp_path: Path) -> None:
    rng = np.random.default_rng(37)
    rows, ball = as_built(rng), np.array([5.0, -10.0, 80.0])
    machine = machine_of(tmp_path, SOCKET)
    frame = table(rng, rows, ball, 8)
    frame["q2"] /= 1 + 5e-3  # the joint turns more than its reading says
    found = diagnose(machine, read(tmp_path, machine, frame))
    assert found.verdict == "missing-physics"
    first = found.findings[0]
    members = {(first.effect, first.place), *((e.effect, e.place) for e in first.equivalents)}
    assert ("actuator-scale", ("q2",)) in members


def test_commands_without_readings(tmp_path: Path) -> None:
    machine, recording, _, _ = campaign(tmp_path, 41)
    assert all(str(name).startswith("pose.") for name in predict(machine, recording))
    joints = pd.read_csv(tmp_path / "rows.csv").drop(columns=["placement", "socket"])
    joints.to_csv(tmp_path / "joints.csv", index=False)
    plain = load_recording(machine, [tmp_path / "joints.csv"], need_readings=False)
    assert len(predict(machine, plain)) == len(joints)
    assert simulate(machine, recording).empty
    with pytest.raises(
        InputError, match=r"joints\.csv: missing column 'placement', which the sensor socket needs"
    ):
        simulate(machine, plain)
    with pytest.raises(InputError, match="missing column 'placement'"):
        estimate(machine, plain)
    with pytest.raises(InputError, match=r"joints\.csv: missing column 'placement'"):
        load_recording(machine, [tmp_path / "joints.csv"])


def test_labels_are_checked(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, SOCKET)
    frame = table(np.random.default_rng(1), nominal(), np.array([5.0, -10.0, 80.0]), 2)
    many = frame.assign(socket=np.arange(len(frame)) % 3)
    with pytest.raises(
        InputError, match=r"rows\.csv: column 'socket': found the sockets 0, 1, 2 of placement 'front'"
    ):
        estimate(machine, read(tmp_path, machine, many))
    empty = frame.assign(socket=frame["socket"].astype(str).where(frame.index != 3, ""))
    with pytest.raises(InputError, match=r"row 4, column 'socket': found an empty cell"):
        read(tmp_path, machine, empty)


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        (SOCKET.replace("60", "-60"), r"sensor\[0\]\.spacing"),
        (SOCKET.replace("sigma: {xyz: 0.05}, ", ""), r"sensor\[0\]\.sigma: missing field"),
        (SOCKET.replace("ball:", "bal:"), r"sensor\[0\]\.bal: unknown field; did you mean 'ball'"),
        (BAR.replace("[400, 100, 50]", "[400, 100]"), r"sensor\[0\]\.centre: expected 3 finite numbers"),
        (BAR.replace("distance:", "xyz:"), r"sensor\[0\]\.sigma\.xyz: unknown field"),
    ],
)
def test_fields_are_checked(tmp_path: Path, sensor: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        machine_of(tmp_path, sensor)


def test_two_balls_need_two_names(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"found parameter 'ball\.x' twice"):
        machine_of(tmp_path, SOCKET, BAR.replace("name: bar, ", ""))
