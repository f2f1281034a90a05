"""The polishing robot: bundled files, an independent simulator against the library, and the study's figures. mm, rad."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from proof_support import BENCHMARKS
from support import ROOT
from support.examples import one_in
from support.texts import assert_same_to_the_last_digit
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.effect_text import parse_effect
from truepose.models.load import load_machine

BUNDLE = ROOT / "models" / "machines" / "polisher"
Array = npt.NDArray[np.float64]
ws, regression, robot, bundle = (
    import_module(f"polisher.{name}") for name in ("workspace", "regression", "robot", "bundle")
)
ranks, montecarlo, layers, errors_model = (
    import_module(f"polisher.{name}") for name in ("ranks", "montecarlo", "layers", "errors_model")
)


# --- the bundled files -----------------------------------------------------------------------------------------


def test_bundled_files_are_what_the_simulator_writes(tmp_path: Path) -> None:
    written = bundle.write(tmp_path)
    assert {*(file.name for file in written), "machine.yaml"} == {path.name for path in BUNDLE.iterdir()}
    for file in written:
        assert_same_to_the_last_digit(file.read_text("utf-8"), (BUNDLE / file.name).read_text("utf-8"))


@pytest.mark.parametrize("name", ["workspace", "motions", "robot", "physics", "bundle"])
def test_the_simulator_shares_no_code_with_the_library(name: str) -> None:
    source = (BENCHMARKS / "polisher" / f"{name}.py").read_text(encoding="utf-8")
    imported = [line for line in source.splitlines() if line.startswith(("import ", "from "))]
    assert imported
    assert not [
        line for line in imported if "truepose" in line or "source_errors" in line or "regression" in line
    ]


def test_machine_file_is_table_1_under_the_tilted_base() -> None:
    """The nominal machine file stands where the simulator's nominal robot does, by another closure of its loops."""
    machine = load_machine(BUNDLE / "machine.yaml")
    recording = load_recording(machine, [BUNDLE / "recording.csv"])
    predictor = Predictor(machine, recording)
    poses, good = predictor.poses(predictor.model.p_home)
    assert good.all()
    np.testing.assert_allclose(poses, robot.Robot().tool_poses(recording.q), rtol=0, atol=1e-6)


def test_workspace_fits_the_stroke_and_its_inverse_is_right() -> None:
    """All nodes of the 500 x 500 x 120 mm workspace lie within the limbs' lengths of Table 1."""
    wanted = ws.tool_poses(ws.layers(7, "lower", "middle", "upper"))
    q = ws.joints(wanted)
    assert np.all((q[:, :3] > ws.LIMB_RANGE[0]) & (q[:, :3] < ws.LIMB_RANGE[1]))
    np.testing.assert_allclose(robot.Robot().tool_poses(q), wanted, rtol=0, atol=1e-9)


def test_truth_in_the_machines_own_parameters_is_the_robot() -> None:
    """To second order in errors of some 0.1 mm; the axes inside the balls have no parameter and are left out."""
    machine = load_machine(BUNDLE / "machine.yaml")
    true, rows, _ = bundle.demo()
    errors = {
        key: 0 * twist if key[0] in (4, 5) and key[1] < 4 else twist for key, twist in true.errors.items()
    }
    predictor = Predictor(machine, load_recording(machine, [BUNDLE / "recording.csv"]))
    stated = json.loads((BUNDLE / "truth.json").read_text(encoding="utf-8"))["parameters"]
    p = predictor.model.p_home.copy()
    for k, name in enumerate(predictor.model.names):
        if name in stated:
            assert p[k] == pytest.approx(stated[name]["nominal"], abs=1e-6)
            p[k] = stated[name]["value"]
    poses, _ = predictor.poses(p)
    real = robot.Robot(errors, true.offsets).tool_poses(rows.q)
    assert np.max(np.linalg.norm((poses - real)[:, :3, 3], axis=1)) < 1e-3


def test_the_recording_is_explained_by_the_effects_that_were_simulated() -> None:
    """Heat spreads and the balls are not perfect: chi2 is a little above 1; amplitudes are the physical ones."""
    machine = load_machine(BUNDLE / "machine.yaml")
    recording = load_recording(machine, [BUNDLE / "recording.csv"])
    texts = ("thermal-expansion@leg1+leg2+leg3:alpha=0", "joint-compliance@q5:c=0")
    fit = estimate(machine, recording, [parse_effect(text, machine) for text in texts])
    assert fit.chi2_per_dof < 1.15
    truth = json.loads((BUNDLE / "truth.json").read_text(encoding="utf-8"))
    for effect, stated in zip(fit.fitted_effects(), truth["effects"], strict=True):
        ((name, entry),) = stated["parameters"].items()
        assert effect.values[name] == pytest.approx(entry["value"], rel=0.05)
    assert estimate(machine, recording).chi2_per_dof > 10


# --- error model -----------------------------------------------------------------------------------------------


def test_there_are_150_source_errors() -> None:
    """6 encoders, 3 (6 + 6 x 5) in the UPS limbs, 6 + 3 x 5 in the UP limb, 3 x 5 in the wrist."""
    errors = regression.errors()
    assert len(errors) == len({e.parameter for e in errors}) == 6 + 3 * 36 + 21 + 15 == 150
    assert {p.name for p in regression.machine().parameters if p.free} == {e.parameter for e in errors}


@pytest.mark.parametrize("name", ["bundled", "all 150"])
def test_screw_theory_equals_differentiation(name: str) -> None:
    machine = layers.machines(montecarlo.Size(0.05, 0.02))[name]
    assert errors_model.agreement(machine, 20) < 1e-9


def test_every_source_error_moves_the_simulator_alike() -> None:
    """Central differences of products of exponentials against the exact Jacobian of the closed loops."""
    q = ws.joints(ws.tool_poses(ws.nodes(2, "lower")))
    predictor = Predictor(regression.machine(), regression.recording(q))
    p = predictor.model.p_home
    _, exact = predictor.twists(p, predictor.assemble(p)[0])
    for error in regression.errors():
        step = 1e-4 if error.turns else 1e-2
        one, other = (_with(error, sign * step).tool_poses(q)[:, :3, 3] for sign in (1, -1))
        column = exact[:, :3, predictor.model.names.index(error.parameter)]
        # third-order terms of a step of 1e-4 rad (1e-2 mm) over some 2000 mm
        np.testing.assert_allclose((one - other) / (2 * step), column, rtol=0, atol=2e-4, err_msg=error.name)


def _with(error: Any, size: float) -> Any:
    """A robot with one error, told in the graph's axes: those of ends stand in base and platform, not in the joint."""
    if error.component == "offset":
        return robot.Robot(offsets=size * np.eye(6)[int(error.parameter[1]) - 1])
    twist = size * np.eye(6)[("x", "y", "z", "rx", "ry", "rz").index(error.component)]
    if error.limb != robot.MIDDLE and error.link in (0, 6):
        angle = (error.limb - 1) * 2 * np.pi / 3
        c, s = np.cos(angle), np.sin(angle)
        twist[:3] = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ twist[:3]
        twist = (
            -twist if error.link == 6 else twist
        )  # the graph places the ball in the platform, not the reverse
    return robot.Robot({(error.link, error.limb): twist})


# --- identifiability -------------------------------------------------------------------------------------------


def test_54_errors_can_be_told_when_the_tool_turns_at_all_and_51_when_it_does_not() -> None:
    """The gap after the last singular value is wide: the count does not hang on the tolerance."""
    for turned, rank in ((0.0, 51), (1e-3, 54)):
        s = ranks.singular_values(turned)
        assert int(np.sum(s > 1e-9 * s[0])) == int(np.sum(s > 1e-14 * s[0])) == rank
        assert ranks.spectral_rank(turned) == len(ranks.kept(turned)) == rank


def test_limbs_2_and_3_keep_the_same_errors_as_in_table_2() -> None:
    """They are mirror images; limb 1 and the middle limb lie in the plane of symmetry. Encoders come first."""
    kept = ranks.chosen()
    of = {limb: [(e.link, e.component) for e in kept if e.limb == limb] for limb in (1, 2, 3)}
    assert of[2] == of[3] != of[1]
    assert [e.component for e in kept[:6]] == ["offset"] * 6
    assert {limb: len(of[limb]) for limb in (1, 2, 3)} == {1: 7, 2: 11, 3: 11}


def test_table_2_as_printed_is_not_independent() -> None:
    """By appendix A some of its errors have no effect at all, and four lie along a joint's own axis."""
    found = ranks.table_two()
    assert found.count == 54
    assert found.rank < 45
    assert found.excluded == ("z_3,1", "z_3,2", "z_3,3", "z_3,4")


# --- estimators ------------------------------------------------------------------------------------------------


def _eta(size: float) -> float:
    here = montecarlo.Size(size, size)
    y = montecarlo.draws(here, 1, 400)
    ols, liu = (montecarlo.Spread.of(scheme, y) for scheme in montecarlo.schemes(here)[:2])
    return float(montecarlo.eta(liu, ols)[0])


def test_the_papers_gain_of_liu_depends_on_how_far_the_robot_is_from_linear() -> None:
    """Small errors: d follows the noise alone. Large ones: what linearisation leaves counts as noise (eq. 13)."""
    assert 30 < _eta(0.01) < 45
    assert _eta(0.5) > 80
    assert abs(_eta(0.3) - 63.9) < 10


def test_the_estimate_under_tolerances_beats_liu_where_nothing_was_measured() -> None:
    size = montecarlo.Size(0.05, 0.02)
    y = montecarlo.draws(size, 1, 50)
    real = montecarlo.robot_of(size, 1)
    left = {}
    for scheme in montecarlo.schemes(size):
        chi, _ = scheme.estimate(montecarlo.field("calibration").nodes.H, y)
        here = montecarlo.field("tilted")
        away = np.einsum("nij,jk->nik", here.nodes.B, chi) - here.errors(real)[:, :, None]
        left[scheme.name] = float(np.mean(np.linalg.norm(away[:, :3], axis=1)))
    assert left["MAP"] < 0.7 * left["LE, eq. (14)"] < left["OLS"]


# --- calibration and compensation ------------------------------------------------------------------------------


def test_coarse_then_fine_calibration_brings_the_real_machine_onto_its_path() -> None:
    """Fig. 4: mm before, tenths of a millimetre after the encoders, some um after the fine calibration."""
    size = montecarlo.Size(0.05, 0.02)
    real = layers.cell(size, 1)
    offsets, increments = layers.coarse(real)
    assert len(increments) <= 3
    here = layers.fields()["middle"]
    nodes = montecarlo.field("calibration").nodes
    readings = real.measured(nodes.q - offsets)
    machine = layers.calibrated(layers.machines(size)["bundled"], nodes.q - offsets, readings)
    commands = {
        "nominal": here.nodes.q,
        "coarse": here.nodes.q - offsets,
        "exact": layers.followed(machine, here.wanted, "exact"),
    }
    left = {name: layers.Left.of(real.errors(q, here.wanted)).position[1] for name, q in commands.items()}
    assert left["nominal"] > 1000 > left["coarse"] > 20
    assert left["exact"] < 5


@pytest.mark.parametrize(("estimator", "rows"), [("ols", one_in(4)), ("liu", 1)])
def test_readings_alone_hold_what_they_cannot_tell_apart(estimator: str, rows: int, tmp_path: Path) -> None:
    """Least squares of every fourth row has as much to hold, and takes a fraction of the time."""
    machine = load_machine(BUNDLE / "machine.yaml")
    title, header, *poses = (BUNDLE / "recording.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "recording.csv").write_text("".join((title, header, *poses[::rows])), encoding="utf-8")
    found = calibrate(machine, load_recording(machine, [tmp_path / "recording.csv"]), estimator=estimator)
    held = [p.name for p in machine.parameters if p.free and p.name not in _free_names(found.fit)]
    assert any(f"{len(held)} of them were held" in note for note in found.notes)
    nominal = {p.name: p.nominal for p in machine.parameters}
    values = dict(zip(found.fit.prior.names, found.fit.p, strict=True))
    assert all(values[name] == nominal[name] for name in held)
    assert found.fit.rank == len(found.fit.prior.free)  # what is left is told apart
    assert found.free is not None  # a full set of joint frames has a free fit, too
    if rows == 1:
        assert found.fit.chi2_per_dof == pytest.approx(found.free.chi2_per_dof, rel=0.05)


def _free_names(fit: Estimate) -> set[str]:
    return {fit.prior.names[k] for k in fit.prior.free}
