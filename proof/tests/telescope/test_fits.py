"""The telescope calibrated in every model, on recordings of one simulated campaign. mm, N, rad."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.telescope_models import MODELS, TRAVEL, machine_of, recording_of
from truepose.errors import InputError
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models import lie
from truepose.models.load import load_machine

simulator = import_module("telescope_simulator")
campaigns, fits = import_module("telescope_models.campaign"), import_module("telescope_models.fits")
ClosurePredictor = import_module("telescope_models.implicit").ClosurePredictor


@pytest.fixture(scope="module")
def campaign() -> Iterator[Any]:
    with campaigns.measured(7) as measured:
        yield measured


@cache
def _outcome(campaign: Any, model: str, platform: str) -> Any:
    return fits.calibrated(campaign, model, platform)


@pytest.mark.parametrize("platform", ["rigid", "linear", "matrix"])
@pytest.mark.parametrize("model", ["spherical", "linear", "beam", "stiffness"])
def test_all_twelve_calibrate(campaign: Any, model: str, platform: str) -> None:
    """Data from beam elements. Six parameters a leg are found, the report's; a few um are left in every case."""
    outcome = _outcome(campaign, model, platform)
    last = ".u." if platform == "rigid" else "K["
    kinds = (".a.x", ".a.y", ".b.x", ".b.y", ".length", last)
    for kind in kinds:
        assert sum(kind in name for name in outcome.deviation) == 6
    assert len(outcome.deviation) == 36
    assert np.mean(outcome.position) < 8.0


def test_the_matrix_brings_parameters_back(campaign: Any) -> None:
    """Millimetres off the drawing where the platform is rigid or bends leg by leg; tenths with the measured K."""
    size = {
        platform: np.sqrt(np.mean(_outcome(campaign, "spherical", platform).points ** 2))
        for platform in ("rigid", "linear", "matrix")
    }
    assert size["rigid"] > 1.5 and size["linear"] > 1.5
    assert size["matrix"] < 0.4 * size["rigid"]
    # u and kappa are one parameter: exchanging them changes nothing else
    assert size["linear"] == pytest.approx(size["rigid"], rel=0.02)


def test_what_can_be_told_is_the_truth() -> None:
    """A rigid platform on ball joints: the 36 parameters, with what those left out show through them, within noise."""
    with campaigns.measured(8, ring_stiffness=np.inf) as measured:
        outcome = fits.calibrated(measured, "spherical", "rigid")
        truth, drawn = measured.truth.parameters, simulator.nominal_machine().parameters
    found = outcome.estimate
    kept = list(found.subset.kept)
    expected = np.array([truth[name] - drawn[name] for name in kept])
    for left, shown in found.subset.relations.items():
        if left in truth:
            for name, share in shown.items():
                expected[kept.index(name)] += share * (truth[left] - drawn[left])
    free = [found.fit.prior.names[k] for k in found.fit.prior.free]
    error = np.array([outcome.deviation[name] - expected[kept.index(name)] for name in free])
    chi2 = error @ np.linalg.solve(found.fit.covariance, error)
    # chi2 of 36 degrees of freedom: 5 sigmas of it; the relations are first order
    assert chi2 < 36 + 5 * np.sqrt(72)


# -- gaps of the loops ---------------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
def test_gaps_vanish_at_exact_poses_and_their_slopes_are_exact(tmp_path: Path, model: str) -> None:
    machine = machine_of(tmp_path, model, ("tolerance: {xyz: 0, rpy: 0}", "tolerance: {xyz: 1, rpy: 1}"))
    predictor = Predictor(machine, recording_of(tmp_path, machine, TRAVEL[:4]))
    poses, _ = predictor.poses(predictor.model.p_home)
    vectors = np.degrees(lie.log_so3(poses[:, :3, :3]))
    rows = np.hstack([TRAVEL[:4], poses[:, :3, 3], vectors])
    head = ",".join([*machine.mechanism.readings, "x", "y", "z", "rx", "ry", "rz"])
    (tmp_path / "exact.csv").write_text(
        head + "\n" + "\n".join(",".join(f"{v:.15g}" for v in r) for r in rows) + "\n"
    )
    gaps = ClosurePredictor(machine, load_recording(machine, [tmp_path / "exact.csv"]), whitened=False)
    p = gaps.model.p_home
    x, good = gaps.assemble(p)
    (block,) = gaps.blocks(p, x)
    assert good.all() and np.abs(block.residual).max() < 1e-6  # sigmas of 1.5 um
    rng = np.random.default_rng(2)
    scale = np.array([q.scale for q in machine.parameters])
    for _ in range(3):
        step = 1e-4 * scale * rng.standard_normal(len(p))
        ends = []
        for sign in (1, -1):
            shifted = p + sign * step
            (moved,) = gaps.blocks(shifted, gaps.assemble(shifted)[0])
            ends.append(moved.residual)
        change = block.jacobian @ (2 * step)
        assert np.allclose(ends[0] - ends[1], change, rtol=0, atol=1e-5 * np.abs(change).max())


def test_gaps_need_measured_poses(tmp_path: Path) -> None:
    (tmp_path / "targets.yaml").write_text(campaigns.model_text("spherical", "targets"))
    machine = load_machine(tmp_path / "targets.yaml")
    with pytest.raises(InputError, match="found targets, expected one of type pose"):
        ClosurePredictor(machine, recording_of(tmp_path, machine, TRAVEL[:4]))


@pytest.mark.parametrize("model", MODELS[:3])
def test_gaps_and_readings_agree_on_the_poses(campaign: Any, model: str) -> None:
    """Weighted by the poses' noise, the gaps of the loops are the residuals of the readings to first order."""
    readings = _outcome(campaign, model, "matrix")
    gaps = fits.calibrated(campaign, model, "matrix", "whitened")
    difference = np.abs(readings.position - gaps.position)
    assert np.max(difference) < 1.5  # um, where the errors themselves are 2 to 8
