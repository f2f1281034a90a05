"""Frames nobody measured: which directions of them no reading tells, and where the search for them starts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from support.built_machines import ARM, MADE, POSE, UNKNOWN, manufactured, nominal, simulated
from support.moving_machines import written
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.estimate import estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.models import lie

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


def test_what_is_exactly_known_of_a_frame_stays_where_it_is_aligned(tmp_path: Path) -> None:
    """A base that may be anywhere and turn about two axes: the third is that of the file, whatever the readings say."""
    known = UNKNOWN.replace("rpy: .inf", "rpy: [.inf, .inf, 0]", 1)
    assert known != UNKNOWN
    machine = written(tmp_path, known + ARM + POSE)
    recording = simulated(machine, nominal(machine), np.random.default_rng(3))
    predictor = Predictor(machine, recording)
    p = aligned_start(predictor)
    fixed = [k for k, parameter in enumerate(machine.parameters) if not parameter.free]
    assert machine.parameters[predictor.model.names.index("base.rz")].tolerance == 0.0
    np.testing.assert_array_equal(p[fixed], predictor.model.p_home[fixed])
