"""What an estimate owes its data and its tolerances, on simulated recordings."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from support.telescope_legs import ENDS, leg_rows
from truepose.errors import ConvergenceError, InputError
from truepose.identification import estimate as estimating
from truepose.identification.align import aligned_start
from truepose.identification.diagnosis.summary import worst_allowed
from truepose.identification.estimate import FREE_TOLERANCE, FREE_WIDENING, Estimate, estimate, prior_of
from truepose.identification.leastsquares import minimise
from truepose.identification.load import load_recording
from truepose.identification.prediction import Predictor
from truepose.identification.recording import Recording
from truepose.models import lie
from truepose.models.load import load_machine
from truepose.models.machine import Machine
from truepose.models.sensors.pose import Pose

Array = NDArray[np.float64]

HEAD = "schema: truepose/machine/1\nname: {name}\n"
MADE = "tolerances: {length: 0.2, angle: 0.1}\n"
FRAMES = """
frames:
  base: {in: world, xyz: [10, -20, 30], rpy: [4, -3, 25], tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [5, -7, 60], rpy: [-8, 6, 12], tolerance: {xyz: 1, rpy: 1}}
"""
POSE = "sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.005}}\n"
ARM = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 128, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: 90, range: [-170, 170]}
    - {name: q3, kind: revolute, d: -612.7, range: [-170, 170]}
    - {name: q4, kind: revolute, d: -571.6, r: 163.9, range: [-170, 170]}
    - {name: q5, kind: revolute, alpha: 90, r: 115.7, range: [-170, 170]}
    - {name: q6, kind: revolute, alpha: -90, r: 92.2, range: [-170, 170]}
"""
HEXAPOD = "mechanism:\n  type: 6-pus\n  home: [0, 0, 440, 0, 0, 0]\n  legs:\n" + leg_rows(
    "length: 500, range: [-80, 80]"
)
TEXTS = {"arm": MADE + FRAMES + ARM + POSE, "hexapod": MADE + FRAMES + HEXAPOD + POSE}


def written(folder: Path, text: str, name: str = "m") -> Machine:
    path = folder / f"{name}.yaml"
    path.write_text(HEAD.format(name=name) + text)
    return load_machine(path)


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    folder = tmp_path_factory.mktemp("machines")
    return {name: written(folder, text, name) for name, text in TEXTS.items()}


def nominal(machine: Machine) -> Array:
    return np.array([p.nominal for p in machine.parameters])


def manufactured(machine: Machine, rng: np.random.Generator) -> Array:
    """Parameters as built: Gaussian in their tolerances where these are finite."""
    sigma = np.array([p.tolerance for p in machine.parameters])
    return nominal(machine) + np.where(np.isfinite(sigma), sigma, 0.0) * rng.standard_normal(len(sigma))


def record(machine: Machine, q: Array, columns: Mapping[str, Array] | None = None) -> Recording:
    n = len(q)
    return Recording(
        joints=machine.mechanism.readings,
        q=q,
        readings=columns or {},
        labels={},
        drivers={},
        files=("simulated.csv",),
        source_file=np.zeros(n, dtype=np.int64),
        source_row=np.arange(1, n + 1),
        session=np.ones(n, dtype=np.int64),
        session_recorded=np.zeros(n, dtype=bool),
        validation=np.zeros(n, dtype=bool),
    )


def configurations(machine: Machine, rng: np.random.Generator, n: int) -> Array:
    ranges = np.array([a.range for a in machine.mechanism.actuators], dtype=float)
    out: Array = ranges.mean(axis=1) + 0.45 * np.ptp(ranges, axis=1) * rng.uniform(-1, 1, (n, len(ranges)))
    return out


def simulated(
    machine: Machine, truth: Array, rng: np.random.Generator, n: int = 40, *, noise: bool = True
) -> Recording:
    """What the sensors read of the machine ``truth``, with their noise."""
    q = configurations(machine, rng, n)
    predictor = Predictor(machine, record(machine, q))
    x, good = predictor.assemble(truth)
    assert good.all()
    names, values, _, _ = predictor.columns(truth, x)
    (sensor,) = machine.sensors
    read = sensor.noisy(values, rng) if noise else values
    return record(machine, q, dict(zip(names, read.T, strict=True)))


def departures(fit: Estimate, truth: Array) -> Array:
    """How far the estimate is from the truth, in posterior stds."""
    free = fit.prior.free
    out: Array = (fit.p - truth)[free] / fit.std[free]
    return out


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("name", TEXTS)
def test_the_truth_lies_within_the_posterior(machines: Mapping[str, Machine], name: str, seed: int) -> None:
    machine, rng = machines[name], np.random.default_rng(seed)
    truth = manufactured(machine, rng)
    fit = estimate(machine, simulated(machine, truth, rng))
    off = departures(fit, truth)
    assert np.abs(off).max() < 4.5
    assert 0.5 < np.mean(off**2) < 2.0
    assert fit.chi2_per_dof == pytest.approx(1.0, abs=0.25)
    assert np.all(fit.std <= fit.prior.sigma * (1 + 1e-9))


@pytest.mark.parametrize("name", TEXTS)
def test_the_order_of_rows_does_not_matter(machines: Mapping[str, Machine], name: str) -> None:
    machine, rng = machines[name], np.random.default_rng(3)
    recording = simulated(machine, manufactured(machine, rng), rng)
    one, other = (
        estimate(machine, r) for r in (recording, recording.subset(rng.permutation(len(recording))))
    )
    assert other.chi2 == pytest.approx(one.chi2, rel=1e-9)
    assert np.abs(departures(other, one.p)).max() < 1e-3
    np.testing.assert_allclose(other.std, one.std, rtol=1e-6)


@pytest.mark.parametrize("name", TEXTS)
def test_rows_that_say_nothing_new_shrink_the_std_only(machines: Mapping[str, Machine], name: str) -> None:
    """Every row four times is every row once with half the sigma."""
    machine, rng = machines[name], np.random.default_rng(4)
    recording = simulated(machine, manufactured(machine, rng), rng)
    (sensor,) = machine.sensors
    assert isinstance(sensor, Pose)
    finer = Pose(0.5 * sensor.sigma_xyz, 0.5 * sensor.sigma_rot)
    fourfold = estimate(machine, recording.subset(np.tile(np.arange(len(recording)), 4)))
    sharp = estimate(replace(machine, sensors=(finer,)), recording)
    np.testing.assert_allclose(fourfold.std, sharp.std, rtol=1e-5)
    assert np.abs(departures(fourfold, sharp.p)).max() < 1e-3


@pytest.mark.parametrize("unit", ["um", "m", "inch"])
def test_the_unit_of_the_file_does_not_matter(tmp_path: Path, unit: str) -> None:
    factor = {"um": 1e3, "m": 1e-3, "inch": 1 / 25.4}[unit]

    def text(k: float) -> str:
        ends = [(_times(a, k), _times(b, k)) for a, b in ENDS]
        legs = leg_rows(f"length: {500 * k}", ends)
        return (
            f"tolerances: {{length: {0.2 * k}, angle: 0.1}}\nframes:\n"
            f"  base: {{xyz: {[5 * k, 6 * k, 7 * k]}, rpy: [1, 2, 3], tolerance: {{xyz: {k}, rpy: 1}}}}\n"
            f"mechanism:\n  type: 6-pus\n  home: {[0, 0, 440 * k, 0, 0, 0]}\n  legs:\n{legs}"
            f"sensor: {{type: position, sigma: {{xyz: {0.01 * k}}}}}\n"
        )

    plain = written(tmp_path, text(1.0))
    other = written(tmp_path, f"units: {{length: {unit}}}\n" + text(factor), "other")
    rng = np.random.default_rng(5)
    q = rng.uniform(-50, 50, (30, 6))
    truth = manufactured(plain, rng)
    predictor = Predictor(plain, record(plain, q))
    _, values, _, _ = predictor.columns(truth, predictor.assemble(truth)[0])
    rows = np.hstack([q, plain.sensors[0].noisy(values, rng)])
    header = ",".join([*plain.mechanism.readings, "x", "y", "z"])
    fits = []
    for machine, k in ((plain, 1.0), (other, factor)):
        path = tmp_path / f"{machine.name}.csv"
        np.savetxt(path, rows * k, delimiter=",", header=header, comments="", fmt="%.17g")
        fits.append(estimate(machine, load_recording(machine, [path])))
    assert fits[1].chi2 == pytest.approx(fits[0].chi2, rel=1e-7)
    np.testing.assert_allclose(fits[1].std, fits[0].std, rtol=1e-6)
    assert np.abs(departures(fits[1], fits[0].p)).max() < 1e-3


def _times(vector: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    x, y, z = vector
    return factor * x, factor * y, factor * z


UNKNOWN = re.sub(r"xyz: [15], rpy: 1\}", "xyz: .inf, rpy: .inf}", FRAMES)
GAUGE = "tolerances: {length: 0, angle: 0, " + ", ".join(
    f"{joint}.{key}: .inf" for joint in ("q1", "q6") for key in ("theta", "r")
)
GAUGES = {
    # base, first joint, last joint, tool: along and about each of the two axes one of two is enough
    "pose": (POSE, 4),
    # a point alone says nothing of the tool's rotation either
    "position": ("sensor: {type: position, sigma: {xyz: 0.01}}\n", 4 + 3),
}


@pytest.mark.parametrize("sensor", GAUGES)
def test_rank_and_null_space_of_frames_and_end_joints(tmp_path: Path, sensor: str) -> None:
    text, null = GAUGES[sensor]
    machine = written(tmp_path, GAUGE + "}\n" + UNKNOWN + ARM + text)
    rng = np.random.default_rng(6)
    recording = simulated(machine, nominal(machine), rng)
    fit = estimate(machine, recording)
    assert len(fit.prior.free) == 16
    assert fit.rank == 16 - null
    assert fit.null_space.shape == (null, 16)
    predictor = Predictor(machine, recording)
    for direction in fit.null_space:
        moved = fit.p.copy()
        moved[fit.prior.free] += 1e-6 * fit.prior.scale[fit.prior.free] * direction
        ends = [predictor.columns(p, predictor.assemble(p)[0])[1][:, :3] for p in (fit.p, moved)]
        np.testing.assert_allclose(ends[1], ends[0], atol=1e-8)
    assert fit.effective_parameters == pytest.approx(16 - null, abs=1e-6)


def test_what_has_no_part_in_a_gauge_keeps_its_std(tmp_path: Path) -> None:
    """Directions nobody can see are of infinite variance, and no other parameter hears of them."""
    upright = UNKNOWN.replace("rpy: [4, -3, 25]", "rpy: [0, 0, 25]") + ARM + POSE
    rng = np.random.default_rng(18)
    gauged = written(tmp_path, GAUGE + "}\n" + upright)
    settled = written(tmp_path, "tolerances: {length: 0, angle: 0}\n" + upright, "settled")
    recording = simulated(gauged, nominal(gauged), rng, noise=False)  # axes exactly upright
    loose, firm = estimate(gauged, recording), estimate(settled, recording)
    for k, parameter in enumerate(gauged.parameters):
        if parameter.name in ("base.x", "base.y", "base.rx", "base.ry"):
            assert loose.std[k] == pytest.approx(firm.std[k], rel=1e-3)
        elif parameter.name in ("base.z", "base.rz", "q1.theta", "q1.r", "q6.theta", "q6.r"):
            assert loose.std[k] > 1e10


@pytest.mark.parametrize("name", TEXTS)
def test_freedom_fits_better_and_strays_further(machines: Mapping[str, Machine], name: str) -> None:
    machine, rng = machines[name], np.random.default_rng(7)
    recording = simulated(machine, manufactured(machine, rng), rng)
    fits = [estimate(machine, recording, widen=factor) for factor in (1.0, 10.0, 100.0)]
    stated = prior_of(machine).sigma
    for tight, loose in pairwise(fits):
        # the free fit stops when half the sum of squares has less than that share of the readings to gain
        assert loose.chi2 <= tight.chi2 + 2 * FREE_TOLERANCE * loose.readings
        assert loose.effective_parameters >= tight.effective_parameters
        # only an independent set of tolerances is widened, a larger one where more of it shows
        assert np.sum(loose.prior.sigma > stated) >= np.sum(tight.prior.sigma > stated)
    assert np.any(fits[1].prior.sigma > stated)


@pytest.mark.parametrize("name", TEXTS)
def test_widening_an_independent_set_is_as_free_as_widening_all(
    machines: Mapping[str, Machine], name: str
) -> None:
    machine, rng = machines[name], np.random.default_rng(7)
    recording = simulated(machine, manufactured(machine, rng), rng)
    fit = estimate(machine, recording, widen=FREE_WIDENING)
    h = fit.factor[:, : len(fit.prior.free)]
    stated = prior_of(machine)
    wide = np.array([1.0 if part == "frame" else FREE_WIDENING for part in stated.parts]) * stated.sigma
    gains = []
    for sigma in (fit.prior.sigma, wide):
        weight = np.diag(stated.scale[fit.prior.free] / sigma[fit.prior.free])
        stacked = np.vstack([h, weight])
        gains.append(np.trace(np.linalg.lstsq(stacked.T @ stacked, h.T @ h, rcond=None)[0]))
    # effective parameters: what is left out moves the readings by a tenth of a sigma at most, each
    assert gains[0] <= gains[1] + 1e-6
    assert gains[0] == pytest.approx(gains[1], abs=0.5)


def test_huber_resists_outliers_that_draw_least_squares_away(machines: Mapping[str, Machine]) -> None:
    machine, rng = machines["hexapod"], np.random.default_rng(8)
    truth = manufactured(machine, rng)
    clean = simulated(machine, truth, rng, 60)
    wild = {name: values.copy() for name, values in clean.readings.items()}
    wild["x"][::12] += 2.0
    wild["rz"][3::20] += 0.01
    recording = replace(clean, readings=wild)
    plain, robust = (estimate(machine, recording, loss=loss) for loss in ("gauss", "huber"))
    assert np.abs(departures(plain, truth)).max() > 10.0
    assert np.abs(departures(robust, truth)).max() < 5.0
    assert np.all(robust.weights[::12] < 0.1)
    assert np.median(robust.weights) == 1.0


def test_huber_and_least_squares_agree_without_outliers(machines: Mapping[str, Machine]) -> None:
    machine, rng = machines["arm"], np.random.default_rng(9)
    recording = simulated(machine, manufactured(machine, rng), rng)
    plain, robust = (estimate(machine, recording, loss=loss) for loss in ("gauss", "huber"))
    assert np.abs(departures(robust, plain.p)).max() < 1.5


def test_validation_rows_and_excluded_rows_are_not_fitted(machines: Mapping[str, Machine]) -> None:
    machine, rng = machines["arm"], np.random.default_rng(10)
    recording = simulated(machine, manufactured(machine, rng), rng)
    out = np.arange(len(recording)) % 4 == 0
    spoiled = {name: np.where(out, values + 1.0, values) for name, values in recording.readings.items()}
    fits = [
        estimate(machine, recording.subset(~out)),
        estimate(machine, replace(recording, readings=spoiled), exclude=out),
        estimate(machine, replace(recording, readings=spoiled, validation=out)),
    ]
    for fit in fits[1:]:
        assert np.abs(departures(fit, fits[0].p)).max() < 1e-3
        assert fit.chi2 == pytest.approx(fits[0].chi2, rel=1e-6)
        np.testing.assert_array_equal(fit.used, ~out)


def test_rows_that_cannot_be_assembled_are_left_out_and_listed(machines: Mapping[str, Machine]) -> None:
    machine, rng = machines["hexapod"], np.random.default_rng(11)
    recording = simulated(machine, manufactured(machine, rng), rng)
    q = recording.q.copy()
    q[5, 2] = 5000.0
    fit = estimate(machine, replace(recording, q=q))
    rest = estimate(machine, recording.subset(np.arange(len(q)) != 5))
    assert fit.unassembled == (5,)
    assert np.abs(departures(fit, rest.p)).max() < 1e-3


def test_too_few_rows_are_refused(tmp_path: Path) -> None:
    machine = written(tmp_path, "tolerances: {length: .inf, angle: .inf}\n" + UNKNOWN + ARM + POSE)
    recording = simulated(machine, nominal(machine), np.random.default_rng(12), 6)
    with pytest.raises(
        InputError, match=r"simulated\.csv: found 6 usable rows \(36 readings\).* 42 parameters"
    ):
        estimate(machine, recording)


def test_damped_steps_take_over_where_full_ones_find_no_minimum(
    machines: Mapping[str, Machine], monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, rng = machines["arm"], np.random.default_rng(14)
    recording = simulated(machine, manufactured(machine, rng), rng)
    usual = estimate(machine, recording)
    monkeypatch.setattr(estimating, "TRIES", ((0.0, 1), *estimating.TRIES[1:]))
    damped = estimate(machine, recording)
    assert damped.chi2 == pytest.approx(usual.chi2, rel=1e-9)
    monkeypatch.setattr(estimating, "TRIES", ((0.0, 1),))
    with pytest.raises(ConvergenceError):
        estimate(machine, recording)


def test_a_fit_that_does_not_converge_names_what_still_moves(
    machines: Mapping[str, Machine], monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, rng = machines["arm"], np.random.default_rng(13)
    truth = nominal(machine)
    truth[[p.name for p in machine.parameters].index("tool.x")] += 20.0
    recording = simulated(machine, truth, rng)
    monkeypatch.setattr(
        "truepose.identification.estimate.minimise", lambda *a, **k: minimise(*a, **(k | {"limit": 1}))
    )
    with pytest.raises(ConvergenceError, match=r"iteration limit.*responsible: .*tool\.x"):
        estimate(machine, recording)


def test_readings_of_another_machine_are_no_estimate(machines: Mapping[str, Machine]) -> None:
    """Nonsense is fitted badly or not at all, never called good."""
    machine, rng = machines["hexapod"], np.random.default_rng(14)
    recording = simulated(machine, nominal(machine), rng)
    scrambled = {name: rng.permutation(values) for name, values in recording.readings.items()}
    try:
        fit = estimate(machine, replace(recording, readings=scrambled))
    except ConvergenceError as error:
        assert "responsible" in str(error)
    else:
        assert fit.chi2_per_dof > 100.0


@pytest.mark.parametrize("axis", [[0.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.3, -1.0, 0.2]])
def test_frames_nobody_measured_are_found(tmp_path: Path, axis: list[float]) -> None:
    machine = written(tmp_path, MADE + UNKNOWN + ARM + POSE)
    rng = np.random.default_rng(15)
    truth = manufactured(machine, rng)
    at = {p.name: k for k, p in enumerate(machine.parameters)}
    turn = lie.exp_so3(np.radians(120) * np.array(axis) / np.linalg.norm(axis))
    base, tool = ([at[f"{frame}.r{a}"] for a in "xyz"] for frame in ("base", "tool"))
    truth[base] = lie.rpy_of(turn @ lie.rpy_matrix(truth[base]))
    truth[[at[f"base.{a}"] for a in "xyz"]] += [800.0, -2000.0, 300.0]
    truth[tool] = lie.rpy_of(lie.exp_so3(np.array([1.5, -1.0, 0.8])))
    recording = simulated(machine, truth, rng)
    start = aligned_start(Predictor(machine, recording))
    for where in (base, tool):
        apart = lie.rpy_matrix(truth[where]).T @ lie.rpy_matrix(start[where])
        assert np.degrees(np.linalg.norm(lie.log_so3(apart))) < 5.0
    fit = estimate(machine, recording, start=start)
    assert fit.chi2_per_dof == pytest.approx(1.0, abs=0.3)


def test_known_frames_stay_where_the_file_has_them(machines: Mapping[str, Machine]) -> None:
    machine, rng = machines["arm"], np.random.default_rng(16)
    recording = simulated(machine, manufactured(machine, rng), rng)
    np.testing.assert_array_equal(aligned_start(Predictor(machine, recording)), nominal(machine))


@pytest.mark.parametrize("name", TEXTS)
def test_the_worst_departure_allowed_is_that_of_machines_as_made(
    machines: Mapping[str, Machine], name: str
) -> None:
    """Against machines drawn from the tolerances, measured with noise and estimated."""
    machine, rng = machines[name], np.random.default_rng(17)
    fit = estimate(machine, simulated(machine, nominal(machine), rng, 25))
    n = len(fit.prior.free)
    r, tolerance = fit.factor[:n, :n], fit.prior.sigma[fit.prior.free] / fit.prior.scale[fit.prior.free]
    made = tolerance[:, None] * rng.standard_normal((n, 4000))
    seen = r.T @ (r @ made + rng.standard_normal(made.shape))
    found = np.linalg.solve(r.T @ r + np.diag(tolerance**-2.0), seen)
    worst = np.max(np.abs(found) / tolerance[:, None], axis=0)
    assert worst_allowed(fit, draws=4000) == pytest.approx(float(np.quantile(worst, 0.99)), rel=0.05)
