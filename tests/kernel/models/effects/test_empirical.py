"""Laws of the effect without a name: what forms a recording supports, held by a file, and quiet where nothing was seen."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pandas as pd
import pytest
from numpy.polynomial.chebyshev import chebval2d

from support.calibrated_machines import SIX_AXES
from support.simulated import machine_from, observed, poses_of
from truepose.errors import InputError
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.write_machine import covariance_of, write_calibrated
from truepose.identification.prediction.predict import predict, predicted, predictor_for, simulate
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import empirical_forms
from truepose.models.effect_text import parse_effect
from truepose.models.effects.base import PlacedEffect, Settings
from truepose.models.effects.empirical import Empirical, largest_sizes
from truepose.models.effects.polynomials import seen_over
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

DRIVEN = SIX_AXES + "drivers: [payload, temperature.air]\n"
JOINTS = tuple(f"q{k}" for k in range(1, 7))
SEEN = 0.8
"""Joints move by so many rad to either side in the recordings of these tests."""
TRUE = (
    "empirical@q2:from.q3=-0.8,to.q3=0.8,c1=1e-3,c2=-6e-4,c3=2e-4,c4=1e-4",
    "empirical@q4:from.q2=-0.8,to.q2=0.8,from.q5=-0.8,to.q5=0.8,c=8e-4",
    "empirical@tool:from.temperature.air=18,to.temperature.air=26,x1=0.2,rz2=5e-4",
    "empirical@sensor:reach=1500,x.yz=0.1,z.xx=0.2",
)
Q3, Q4, Q5 = ({name: (-SEEN, SEEN)} for name in ("q3", "q4", "q5"))
TOLD = (
    "empirical@q2:from.q4=-0.8,to.q4=0.8,degree=2,spatial=1,x1=0.2,ry2=3e-4",
    "empirical@base:from.q4=-0.8,to.q4=0.8,from.q5=-0.8,to.q5=0.8,degree=2,x1.1=0.2",
    "empirical@sensor:from.seen.range=300,to.seen.range=1500,degree=2,c1=0.2",
)
STATED: dict[str, tuple[str, Settings, dict[str, float]]] = {
    "pair": ("q3", seen_over(Q3 | Q5, 2), {"c1.0": 4e-4, "c0.2": -6e-4, "c1.1": 8e-4}),
    "six motions": ("q2", seen_over(Q4, 2, spatial=True), {"x1": 0.2, "ry1": 5e-4, "rz2": -4e-4}),
    "mount": ("base", seen_over(Q4 | Q5, 2), {"x1.1": 0.2, "ry2.0": 4e-4}),
    "sight": ("sensor", seen_over({"seen.range": (300.0, 1500.0)}, 2), {"c1": 0.2, "c2": -0.3}),
}
"""Forms that a line of text has no words for: place, settings, and coefficients that are not zero."""


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return machine_from(tmp_path_factory.mktemp("empirical"), DRIVEN, "arm")


def rows(machine: Machine, n: int = 60, reach: float = SEEN, **columns: Any) -> Recording:
    """Random poses within ``reach`` (rad) of zero, logged drivers, no readings."""
    rng = np.random.default_rng(4)
    data = {f"{name} [rad]": rng.uniform(-reach, reach, n) for name in JOINTS}
    data["temperature.air"] = rng.uniform(18.0, 26.0, n)
    data["payload"] = rng.uniform(0.0, 3.0, n)
    return poses_of(machine, pd.DataFrame(data | columns))


def true_form(arm: Machine, name: str) -> PlacedEffect:
    """A form with its coefficients, by its text or by its name in ``STATED``."""
    if name not in STATED:
        return parse_effect(name, arm)
    place, settings, values = STATED[name]
    placed = PlacedEffect.at(Empirical(), arm, (place,), settings)
    assert set(values) <= {c.name for c in placed.coefficients}
    return placed.with_values([values.get(c.name, 0.0) for c in placed.coefficients])


def test_a_recording_supports_every_form_of_what_it_varied(arm: Machine) -> None:
    """Joints as lines and curves in each source, either way, and in their reading with the side that they arrived from; mounts
    as curves in each source; the sensor in what it reads itself, and its volume."""
    held = np.where(np.arange(60) >= 50, 2.0, 0.0)
    poses = rows(arm, role=np.where(held, "validation", "calibration"))
    recording = observed(arm, replace(poses, q=poses.q + held[:, None]), (), seed=None)
    forms = empirical_forms(arm, recording)
    told = {(*form.place, *Empirical().describe(form.settings_map)) for form in forms}
    sources = (*JOINTS, "payload", "temperature.air", "row")  # no clock was recorded
    curves = {(name, s, "curve") for name in (*JOINTS, "base", "tool") for s in sources}
    lines = {(joint, source, "line") for joint in JOINTS for source in sources}
    arrived = {(joint, f"approach.{joint} and {joint}", "product") for joint in JOINTS}
    sights = {("sensor", own, "curve") for own in ("seen.azimuth", "seen.elevation", "seen.range")}
    assert told == lines | curves | arrived | sights | {("sensor", "position", "warp")}
    spatial = [form for form in forms if "spatial" in form.settings_map]
    assert len(spatial) == len(JOINTS) * len(sources)
    assert len(forms) == len({form.label for form in forms})
    assert {len(form.coefficients) for form in spatial} == {12}
    low, high = (f(recording.q[~recording.validation, 2]) for f in (np.min, np.max))
    of_q3 = next(form.settings_map for form in forms if form.label == "empirical@q1,q3")
    assert (of_q3["from.q3"], of_q3["to.q3"]) == (low, high)
    q3 = np.array(recording.q)
    q3[:, 2] = 0.3
    still = replace(recording, q=q3)
    assert not any("q3" in Empirical().describe(f.settings_map)[0] for f in empirical_forms(arm, still))


@pytest.mark.parametrize("text", [*TRUE, *TOLD, *STATED])
def test_a_form_is_found_written_and_read_again(arm: Machine, tmp_path: Path, text: str) -> None:
    """Fitted with the form that was put in, the file predicts what was simulated."""
    true, poses = true_form(arm, text), rows(arm)
    recording = observed(arm, poses, (true,), seed=None)
    fit = estimate(arm, recording, (true.with_values([0.0] * len(true.coefficients)),))
    write_calibrated(tmp_path / "improved.yaml", fit, recording)
    again = load_machine(tmp_path / "improved.yaml")
    (placed,) = again.effects
    assert (placed.label, placed.settings, placed.drivers) == (true.label, true.settings, true.drivers)
    found, wanted = predict(again, poses), simulate(arm, poses, (true,), seed=None)
    without = simulate(arm, poses, (), seed=None)
    moved = float(np.sqrt(np.mean((without - wanted).to_numpy() ** 2)))
    left = (found[list(wanted)] - wanted).to_numpy()
    assert (
        np.sqrt(np.mean(left**2)) < 0.02 * moved
    )  # tolerances take a little, none of it beyond a few microns


@pytest.mark.parametrize("text", [*TRUE[:2], "pair"])
def test_beyond_its_range_a_form_stays_where_it_ended(arm: Machine, text: str) -> None:
    """What it adds at a source far out is what it adds at the end of the range; slopes stay finite."""
    effect = true_form(arm, text)
    at = [JOINTS.index(key.removeprefix("from.")) for key in effect.settings_map if key.startswith("from.")]
    poses = rows(arm, reach=1.04)
    inside = np.array(poses.q)
    inside[:, at] = np.clip(inside[:, at], -SEEN, SEEN)
    assert (inside != poses.q).any()
    model = symbolic_model(arm, (effect,))
    shift = model.values[f"{effect.place[0]}.displacement"]
    added = ca.Function("added", [model.q, model.p], [shift])
    slope = ca.Function("slope", [model.q, model.p], [ca.jacobian(shift, model.q)])
    for row, end in zip(poses.q, inside, strict=True):
        assert float(added(row, model.p_home)) == pytest.approx(float(added(end, model.p_home)), abs=1e-12)
        assert np.isfinite(slope(row, model.p_home).full()).all()


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("place: [q2], from.q3: 1", r"from\.q3: 1 and to\.q3: None, expected two numbers"),
        ("place: [q2], from.q3: 1, to.q3: -1", r"expected two numbers, the first smaller"),
        (
            "place: [q2], form: curve, from.q3: -1, to.q3: 1",
            r"effects\[0\]\.form: found 'curve', expected a number",
        ),
        ("place: [q2], degree: 2.5, from.q3: -1, to.q3: 1", r"degree: 2\.5, expected a whole number"),
        (
            "place: [base], from.load: 0, to.load: 1, from.q2: 0, to.q2: 1",
            r"sources load and q2, expected the load of a mount alone",
        ),
        ("place: [q2], from.moment: 0, to.moment: 1", r"found source moment, expected load"),
        ("place: [link2], from.q1: 0, to.q1: 1", r"place: found \['link2'\]"),
    ],
)
def test_what_cannot_be_meant_is_refused(tmp_path: Path, entry: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        machine_from(tmp_path, DRIVEN + f"effects: [{{effect: empirical, {entry}}}]\n")


# -- what it is ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [1, 2, 4])
def test_a_form_of_two_sources_is_every_polynomial_of_them_up_to_its_degree(
    arm: Machine, degree: int
) -> None:
    """Against the sum over a table of coefficients of Chebyshev products, each coefficient by its name."""
    form = PlacedEffect.at(
        Empirical(), arm, ("q2",), seen_over({"q3": (-0.8, 0.4), "q5": (-1.0, 1.0)}, degree)
    )
    pairs = [(j, k) for j in range(degree + 1) for k in range(degree + 1 - j) if j + k]
    assert {c.name for c in form.coefficients} == {f"c{j}.{k}" for j, k in pairs}
    assert form.label == f"empirical@q2,q3,q5{',line' if degree == 1 else f',{degree}'}"
    values = np.random.default_rng(degree).normal(0.0, 1e-3, len(pairs))
    placed = form.with_values(values.tolist())
    table = np.zeros((degree + 1, degree + 1))
    for c, value in zip(form.coefficients, placed.amplitudes, strict=True):
        j, k = map(int, c.name.removeprefix("c").split("."))
        table[j, k] = value
    model = symbolic_model(arm, (placed,))
    moved = ca.Function("moved", [model.q, model.p], [model.values["q2.displacement"]])
    poses, p = rows(arm, n=20), model.p_home.copy()
    p[len(arm.parameters) :] = placed.amplitudes
    for row in poses.q:
        t, u = np.clip((row[2] + 0.2) / 0.6, -1.0, 1.0), row[4]
        assert float(moved(row, p)) == pytest.approx(chebval2d(t, u, table), abs=1e-12)


def test_largest_sizes_are_a_hundred_sigmas_of_the_finest_length_a_tenth_of_a_metre_away(
    tmp_path: Path,
) -> None:
    """Divided by the square of the degree; of what a sensor reads itself from afar, and its volume by its sigma."""
    for sigma in (0.01, 0.3):
        text = DRIVEN.replace("xyz: 0.01, rot: 0.001", f"xyz: {sigma}, rot: 0.001")
        machine = machine_from(tmp_path, text, "arm")
        robot = {"mm": 100.0 * sigma, "rad": sigma}
        assert largest_sizes(machine) == pytest.approx(robot)
        q1, q3 = {"q1": (0.0, 1.0)}, {"q3": (0.0, 1.0)}
        for place, settings, largest in (
            ("q2", seen_over(q3, 3, spatial=True), robot),
            ("q2", seen_over(q1 | q3, 2), robot),
            ("base", seen_over(q1 | q3, 2), robot),
            ("sensor", seen_over({"seen.azimuth": (0.0, 1.0)}, 2) | {"reach": 2000.0}, {"rad": 0.05 * sigma}),
        ):
            made = Empirical().coefficients(machine, (place,), settings)
            order = [sum(map(int, c.name.lstrip("cxyzr").split("."))) for c in made]
            expected = [largest[c.unit] / k**2 for c, k in zip(made, order, strict=True)]
            assert [c.scale for c in made] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("place", "names", "kinds"),
    [
        ("q2", ("q2",), ("position",)),
        ("q2", ("q3",), ("coupling",)),
        ("q2", ("q2", "q3"), ("coupling",)),
        ("q2", ("q3", "payload"), ("load", "coupling")),
        ("q2", ("q2", "temperature.air", "load"), ("load", "temperature")),
        ("q2", ("approach.q2",), ("arrival",)),
        ("base", ("q1", "q2"), ("coupling",)),
        ("base", ("temperature.air", "q2"), ("temperature", "coupling")),
        ("sensor", ("seen.azimuth",), ("sensor",)),
        ("sensor", (), ("sensor",)),
    ],
)
def test_all_its_sources_drive_it(
    arm: Machine, place: str, names: tuple[str, ...], kinds: tuple[str, ...]
) -> None:
    """Columns and loads before other joints; the joint itself goes without saying beside them."""
    for order in permutations(names):
        settings = seen_over(dict.fromkeys(order, (0.0, 1.0)), 2) if names else {"reach": 900.0}
        found = Empirical().driver_kinds(arm, (place,), settings)
        assert found == kinds and Empirical().driver_kind(arm, (place,), settings) == kinds[0]


# -- how sure it is ------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", [*TRUE[:2], TRUE[3].replace("1500", "900"), "pair", "six motions"])
def test_it_is_less_sure_the_further_it_is_asked_beyond_what_was_seen(
    arm: Machine, tmp_path: Path, text: str
) -> None:
    """Inside the range nothing is added; beyond it what a random curve of its size would have changed, and no more."""
    true = true_form(arm, text)
    poses = rows(arm)
    fit = estimate(arm, observed(arm, poses, (true,), seed=5), (true,))
    write_calibrated(tmp_path / "improved.yaml", fit, poses)
    machine = load_machine(tmp_path / "improved.yaml")
    far = rows(machine, n=200, reach=1.04)
    predictor = predictor_for(machine, far)
    found = predicted(predictor)
    assert found.std is not None
    x, _ = predictor.assemble(predictor.model.p_home)
    names, values, slopes, _ = predictor.columns(predictor.model.p_home, x)
    effect = machine.effects[0]
    at = dict(zip(JOINTS, far.q.T, strict=True)) | dict(zip(names, values.T, strict=True))
    over = Empirical().overshoot(machine, effect.place, effect.settings_map, at)
    assert over is not None
    assert (over == 0.0).any()
    assert (over > 0.0).any()
    known = covariance_of(fit)
    order = [predictor.model.names.index(name) for name in known.names]
    scale = fit.prior.scale[fit.prior.free]
    plain = known.std(slopes[..., order], scale) ** 2
    own = slopes[..., -len(effect.amplitudes) :] * effect.amplitudes
    added = 2.0 * (1.0 - np.exp(-over))[:, None] * np.sum(own**2, axis=2)
    np.testing.assert_allclose(found.std**2, plain + added, rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(found.std[over == 0.0] ** 2, plain[over == 0.0], rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("degree", [2, 3, 5])
def test_a_polynomial_leaves_its_range_as_steeply_as_its_degree_squared(arm: Machine, degree: int) -> None:
    """T_k' = k^2 at the end of its range, with T_k Chebyshev's polynomial."""
    settings, at = {"from.q3": -0.8, "to.q3": 0.8}, {"q3": np.array([-1.0, 0.0, 0.9, 1.6])}
    line, curve = (Empirical().overshoot(arm, ("q2",), settings | {"degree": k}, at) for k in (1, degree))
    assert line is not None and curve is not None and (line > 0.0).tolist() == [True, False, True, True]
    np.testing.assert_allclose(curve, degree**2 * line, rtol=1e-12)
