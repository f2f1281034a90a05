"""What is applied: bounds that hold, and a tool that is no worse than plain calibration's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from support.searched_arm import ARM, PLAY, SCALE, WRONG_SIGN, Case, held, searched
from support.simulated import machine_from, readings_of
from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.diagnosis.holdout import Comparison
from truepose.identification.diagnosis.null_fits import Fits
from truepose.identification.diagnosis.posterior_summary import SURE
from truepose.identification.diagnosis.refit import (
    Choice,
    Model,
    chosen_model,
    determined_directions,
    refit,
)
from truepose.identification.diagnosis.result import WHOLE, Applied, BlockProof, PoseError
from truepose.identification.fit.bounds import beyond, coefficient_bounds, within_bounds
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.summary import worst_allowed
from truepose.identification.fit.tool_pose import ToolPoints, tool_points
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.report.applied_words import check_applicable, expected_pose
from truepose.models import lie
from truepose.models.effects.empirical import Empirical
from truepose.models.load import load_machine

# -- bounds hold in what is written -------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_play_is_never_negative(tmp_path: Path, sign: float) -> None:
    """Readings that want play the wrong way round get none of it; those that want it right are left as they are."""
    case = Case.of(tmp_path, f"backlash@q2:b={0.05 * sign}[deg]")
    terms = [c for c in case.cat.candidates if c.label == "backlash@q2"]
    machine, recording = case.signatures.machine, case.signatures.recording
    fit = estimate(machine, recording, terms)
    kept = within_bounds(fit, recording, case.exclude)
    assert bool(beyond(fit).any()) is (sign < 0)
    assert not beyond(kept).any()
    assert kept is fit or kept.chi2 >= fit.chi2
    assert np.all(kept.std[kept.prior.free] > 0.0)  # what stands at its bound is not known exactly


@given(seed=st.integers(0, 10**6))
@hypothesis_settings(max_examples=5, deadline=None)
def test_the_bounded_minimum_is_the_best_within_bounds(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    """No feasible step nearby lowers the sum of squares of readings and prior."""
    case = Case.of(tmp_path_factory.mktemp("bounded"), "backlash@q2:b=-0.05[deg]", "backlash@q1:b=0.02[deg]")
    terms = [c for c in case.cat.candidates if c.effect.slug in ("backlash", "friction-hysteresis")]
    machine, recording = case.signatures.machine, case.signatures.recording
    kept = within_bounds(estimate(machine, recording, terms), recording, case.exclude)
    low, high = coefficient_bounds(machine, kept.effects)
    n, free, rng = len(kept.prior.free), kept.prior.free, np.random.default_rng(seed)
    step = 1e-3 * rng.standard_normal(n)
    moved = np.clip(kept.p[free] + step * kept.prior.scale[free], low[free], high[free])
    t = (moved - kept.p[free]) / kept.prior.scale[free]
    prior = kept.prior_weight * (kept.p - kept.prior.mean)[free] / kept.prior.scale[free]

    def cost(at: Array) -> float:
        left = kept.factor[:, :n] @ at + kept.factor[:, n]
        pull = prior + kept.prior_weight * at
        return float(left @ left + pull @ pull)

    assert cost(t) >= cost(np.zeros(n)) - 1e-6


def test_what_bounds_leave_nothing_of_is_no_part_of_the_model() -> None:
    case, found = searched(WRONG_SIGN, SCALE)
    wanted = [i for i, c in enumerate(case.cat.candidates) if c.label in ("backlash@q2", "actuator-scale@q1")]
    model = refit(found, dict.fromkeys(wanted, 1.0), case.exclude)
    assert model is not None
    assert [e.label for e in model.fit.effects] == ["actuator-scale@q1"]


# -- the tool's position ------------------------------------------------------------------------------------------


@given(seed=st.integers(0, 10**6))
@hypothesis_settings(max_examples=20, deadline=None)
def test_the_tool_is_judged_whatever_frame_it_is_read_in(seed: int) -> None:
    rng = np.random.default_rng(seed)
    read = rng.normal(size=(30, 2, 3)) * 500.0
    off = 0.1 * rng.standard_normal(read.shape)
    fitted = np.arange(30) < 20
    turn, shift = lie.exp_so3(rng.normal(size=3)), 1e3 * rng.normal(size=3)
    plain = ToolPoints(read + off, read).squares(fitted, ~fitted)
    moved = ToolPoints((read + off) @ turn.T + shift, read).squares(fitted, ~fitted)
    np.testing.assert_allclose(moved, plain, rtol=1e-6)
    assert ToolPoints(read, read).squares(fitted, ~fitted) == pytest.approx(np.zeros(10), abs=1e-12)


def test_what_a_sensor_does_moves_no_tool(tmp_path: Path) -> None:
    """A warped volume that is silent leaves the points where the robot has them."""
    case = Case.of(tmp_path)
    machine, recording = case.signatures.machine, case.signatures.recording
    warp = next(c for c in case.cat.candidates if c.effect.slug == "empirical" and c.kind == "sensor")
    bent = warp.with_values([3.0] * len(warp.coefficients))
    predictor = Predictor(machine, recording, [bent])
    p = predictor.model.p_home.copy()
    p[len(machine.parameters) :] = bent.amplitudes
    x, _ = predictor.assemble(p)
    poses, _ = predictor.poses(p, x)
    silent = tool_points(predictor, p, x, {bent.label}).predicted[:, 0]
    np.testing.assert_allclose(silent, poses[:, :3, 3], atol=1e-9)
    assert np.max(np.abs(tool_points(predictor, p, x).predicted[:, 0] - silent)) > 1.0


def test_a_volume_warps_by_no_more_than_its_makers_sigma(tmp_path: Path) -> None:
    for sigma in (0.01, 0.3):
        machine = machine_from(tmp_path, ARM.replace("{xyz: 0.01}", f"{{xyz: {sigma}}}"), "arm")
        made = Empirical().coefficients(machine, ("sensor",), {})
        assert {c.scale for c in made} == {sigma}


# -- which model is applied ---------------------------------------------------------------------------------------


def comparison(ratio: float, pose: float) -> Comparison:
    ones = np.ones(10)
    return Comparison("role", ones, ratio**2 * ones, (), PoseError(1.0, pose))


def test_improved_predicts_the_tool_no_worse_than_plain_calibration(tmp_path: Path) -> None:
    """A sensor that warps by thirty sigma: the tool that is applied is no worse on rows that were not fitted."""
    machine = machine_from(tmp_path, ARM, "arm")
    rng = np.random.default_rng(2)
    table = pd.DataFrame(rng.uniform(-1, 1, (60, 2)) * [160, 95], columns=["q1 [deg]", "q2 [deg]"])
    table["role"] = np.where(np.arange(60) % 3 == 0, "validation", "calibration")
    read = readings_of(machine, table)
    read["z"] += 0.3 * (read["x"] / 350.0) ** 2  # bent where the point is, as a volume or an arm may be
    recording = load_recording(machine, read)
    found = diagnose(machine, recording)
    plain, improved = (tool_error(fit, recording) for fit in (found.before, found.after))
    assert improved <= 1.02 * plain
    assert found.applied is not None and found.applied.pose is not None
    assert found.applied.pose.plain == pytest.approx(plain, rel=1e-6)
    # the sensor is known to warp, so that the readings are what is wrong by as much
    assert any(f.place == ("sensor",) and f.levels.place > SURE for f in found.findings)
    corrected = tool_error(found.after, recording, as_read=True)
    assert found.applied.pose.model == pytest.approx(corrected, rel=1e-6)


def tool_error(fit: Estimate, recording: Recording, *, as_read: bool = False) -> float:
    """Rms error of the tool's origin on validation rows, as poses have it, moved rigidly onto the fitted rows (mm).

    ``as_read``: with what the model says of its sensor.
    """
    predictor = Predictor(fit.nominal, recording, fit.effects)
    _, values, poses = predictor.values(fit.p, fit.x)
    at, read = poses[:, :3, 3], np.column_stack([recording.observations[axis] for axis in "xyz"])
    at = values if as_read else at
    own, onto = at[fit.used], read[fit.used]
    turn, _ = Rotation.align_vectors(onto - onto.mean(axis=0), own - own.mean(axis=0))
    off = turn.apply(at - own.mean(axis=0)) + onto.mean(axis=0) - read
    return float(np.sqrt(np.mean(np.sum(off[recording.validation] ** 2, axis=1))))


# -- what is said of it -------------------------------------------------------------------------------------------


def test_a_file_that_leaves_the_tool_worse_is_refused(tmp_path: Path) -> None:
    case = Case.of(tmp_path)
    worse = Applied(WHOLE, "role", PoseError(0.07, 0.26), 0.5, PoseError(0.07, 0.26), 0.5)
    for told, refused in ((worse, True), (replace(worse, pose=PoseError(0.26, 0.07)), False)):
        path = tmp_path / f"{refused}.yaml"
        write_calibrated(path, case.null, case.signatures.recording, expected_pose(told))
        machine = load_machine(path)
        assert machine.file is not None and machine.file.pose_error == expected_pose(told)
        if refused:
            with pytest.raises(InputError, match=r"found 0.26 mm .* expected no more than the 0.07 mm"):
                check_applicable(machine)
        else:
            check_applicable(machine)


# -- sure names, and constants that leave their tolerances --------------------------------------------------------


@pytest.fixture(scope="module")
def choice() -> Choice:
    case, found = held(PLAY, SCALE)
    return Choice.of(found, Fits(case.null, case.null, case.exclude))


@pytest.fixture(scope="module")
def models() -> tuple[dict[str, int], Model, Model]:
    """What may be applied: candidates by what they are, all of them and the names alone."""
    case, found = held(PLAY, SCALE)
    number = {c.label: i for i, c in enumerate(case.cat.candidates)}
    forms = [(i, c) for i, c in enumerate(case.cat.candidates) if not case.cat.named(i)]
    parts = {"play": number["backlash@q2"], "scale": number["actuator-scale@q1"]}
    whole = parts | {
        "line": next(i for i, c in forms if c.place == ("q1",)),
        "warp": next(i for i, c in forms if c.kind == "sensor"),
    }
    everything, names = (refit(found, dict.fromkeys(p.values(), 1.0), case.exclude) for p in (whole, parts))
    assert (
        everything is not None
        and names is not None
        and all(found.catalogue.named(i) for i in names.held(found))
    )
    return whole, everything, names


@pytest.mark.parametrize(
    ("good", "sure", "told"),
    [
        ("play scale line warp", "", WHOLE),
        ("play scale line", "", "robot"),
        ("play scale", "", "names"),
        ("play", "play", "sure-names"),
        ("play", "", "plain"),  # where all are sure, or none is, there is nothing smaller
        ("play", "play scale", "plain"),
        ("play", "scale", "plain"),  # it does no better
        ("", "", "plain"),
    ],
)
def test_a_model_that_leaves_the_tool_worse_gives_way_to_a_smaller_one(
    choice: Choice, models: tuple[dict[str, int], Model, Model], monkeypatch: pytest.MonkeyPatch,
    good: str, sure: str, told: str,
) -> None:  # fmt: skip
    """Without what the sensor is said to do, names alone, those whose place and driver are known, plain calibration."""
    number, everything, names = models
    fine = {choice.found.catalogue.candidates[number[name]].label for name in good.split()}

    def compared(_: Choice, fit: Estimate) -> Comparison:
        return comparison(0.5, 0.5) if {e.label for e in fit.effects} <= fine else comparison(2.0, 2.0)

    for name, instead in (("strays", lambda *_: False), ("compared", compared), ("beside_drawing", compared)):
        monkeypatch.setattr(Choice, name, instead)
    known = tuple(number[name] for name in sure.split())
    label, model, applied = chosen_model(choice, everything, names, known, compared(choice, everything.fit))
    assert label == told and (model is None) is (told == "plain")
    assert model is None or ({e.label for e in model.fit.effects} == fine and applied.ratio < 1.0)


@pytest.mark.parametrize(
    ("whole", "alone", "expected"), [(0.9, 0.5, "names"), (0.5, 0.498, WHOLE), (0.5, 0.9, WHOLE)]
)
def test_the_best_of_what_was_found_is_deployed(
    choice: Choice, models: tuple[dict[str, int], Model, Model], monkeypatch: pytest.MonkeyPatch,
    whole: float, alone: float, expected: str,
) -> None:  # fmt: skip
    """Not the largest model that is no worse than plain calibration; of models as good, the largest."""
    _, everything, names = models
    monkeypatch.setattr(Choice, "strays", lambda *_: False)
    monkeypatch.setattr(
        Choice, "compared", lambda _, fit: comparison(*[alone if fit is names.fit else 1.5] * 2)
    )
    assert chosen_model(choice, everything, names, (), comparison(whole, whole))[0] == expected


def test_gains_are_told_against_the_better_plain_calibration_and_the_one_held_to_the_drawing_is_applied() -> (
    None
):
    """The ordinary fit may lead on rows held out, and leave the drawing by hundreds of tolerances where readings say little."""
    case, found = searched(PLAY)
    play = next(i for i, c in enumerate(case.cat.candidates) if c.label == "backlash@q2")
    better = refit(found, {play: 1.0}, case.exclude)
    assert better is not None
    choice = Choice.of(found, Fits(better.fit, case.null, case.exclude))
    assert choice.drawing is case.null
    assert choice.compared(better.fit).ratio == pytest.approx(1.0)
    assert choice.drawing_alone.ratio > 1.5 and choice.beside_drawing(better.fit).ratio < 0.7
    assert choice.may_be_applied(better, better, choice.beside_drawing(better.fit))


@pytest.mark.parametrize(("share", "strays"), [(0.9, False), (1.1, True)])
def test_geometry_strays_that_forms_move_as_far_as_a_true_model_never_leaves_it(
    choice: Choice, share: float, strays: bool
) -> None:
    """Beyond where plain calibration has it; not where names alone move it as far."""
    moved = shifted(choice.drawing, determined_directions(choice.drawing)[0], share)
    model = Model({}, moved)
    assert choice.strays(model, None) is strays
    assert not choice.strays(model, Model({}, moved))
    assert not choice.strays(Model({}, choice.drawing), None)


def test_constants_that_share_what_no_reading_tells_apart_do_not_stray(choice: Choice) -> None:
    """A joint's length and the tool's along the same axis: one longer and one shorter by ten thousand tolerances."""
    seen = determined_directions(choice.drawing)
    _, _, unseen = np.linalg.svd(seen)
    free = np.array([0.0 < p.tolerance < np.inf for p in choice.drawing.nominal.parameters])
    direction = next(v for v in unseen[len(seen) :] if np.sum(v[free] ** 2) > 0.999)
    far = shifted(choice.drawing, direction, 1e4)
    assert far.worst_parameter_sigma > worst_allowed(far)
    assert not choice.strays(Model({}, far), None)


def shifted(fit: Estimate, direction: Array, share: float) -> Estimate:
    """Return a fit whose constants are moved along a direction, so far as ``share`` of what a true model allows."""
    tolerance = np.array([p.tolerance if np.isfinite(p.tolerance) else 0.0 for p in fit.nominal.parameters])
    nominal = np.array([p.nominal for p in fit.nominal.parameters])
    p = fit.p.copy()
    p[: len(nominal)] = np.where(tolerance > 0.0, nominal, p[: len(nominal)])
    p[: len(nominal)] += share * worst_allowed(fit) * direction * tolerance
    return replace(fit, p=p)


def test_forms_must_make_nothing_worse_at_the_ends_and_names_may(choice: Choice) -> None:
    """A model without forms is judged where it counts alone."""
    case, found = held(PLAY, SCALE)
    line = next(i for i, c in enumerate(case.cat.candidates) if c.place == ("q1",) and not case.cat.named(i))
    names = Model(dict(found.accepted), found.fit)
    with_form = refit(found, {line: 1.0}, case.exclude)
    assert with_form is not None and [i for i in with_form.held(found) if not found.catalogue.named(i)] == [
        line
    ]
    end = BlockProof("outermost poses", 10, 2.0, 2.0, extrapolates=True)
    harmful, harmless = replace(comparison(0.5, 0.5), blocks=(end,)), comparison(0.5, 0.5)
    assert choice.may_be_applied(names, names, harmful)
    assert not choice.may_be_applied(names, names, comparison(2.0, 0.5))
    assert not choice.may_be_applied(with_form, None, harmful)
    assert choice.may_be_applied(with_form, None, harmless) is not choice.strays(with_form, None)


@pytest.mark.parametrize(
    ("ratio", "pose", "worse"),
    [(0.5, 0.5, False), (1.0, 1.0, False), (0.5, 1.03, True), (1.03, 0.5, True), (1.01, 1.01, False)],
)
def test_neither_readings_nor_the_tool_may_get_worse(ratio: float, pose: float, worse: bool) -> None:
    assert comparison(ratio, pose).worse is worse


def test_sure_names_are_applied_where_others_may_not(choice: Choice, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those whose place and driver are known; where all are sure, or none is, there is nothing smaller."""
    case, found = held(PLAY, SCALE)
    number = {c.label: i for i, c in enumerate(case.cat.candidates)}
    play, scale = number["backlash@q2"], number["actuator-scale@q1"]
    names = refit(found, {play: 1.0, scale: 1.0}, case.exclude)
    assert names is not None and all(found.catalogue.named(i) for i in names.held(found))
    good, bad = comparison(0.5, 0.5), comparison(2.0, 2.0)

    def compared(_: Choice, fit: Estimate) -> Comparison:
        return good if {e.label for e in fit.effects} == {"backlash@q2"} else bad

    monkeypatch.setattr(Choice, "compared", compared)
    monkeypatch.setattr(Choice, "beside_drawing", compared)
    label, model, applied = chosen_model(choice, names, names, (play,), bad)
    assert label == "sure-names" and model is not None and list(model.accepted) == [play] and applied is good
    for sure in ((), (play, scale)):
        assert chosen_model(choice, names, names, sure, bad)[:2] == ("plain", None)
    assert chosen_model(choice, names, names, (scale,), bad)[:2] == ("plain", None)  # it does no better
