"""The diagnosis on small recordings: what is adequate, what is named, what nothing explains, and what changes nothing.

Play is a state carried through the sequence, and no formula of the catalogue.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binom, kstest

from support.reports import diagnosis_lines
from support.shifting_bench import Bench, clock, the_only
from support.simulated import machine_from
from truepose.api import diagnose
from truepose.arrays import Array
from truepose.identification.diagnosis import alarms
from truepose.identification.diagnosis.alarms import conflict_with_tolerances
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimate import FREE_WIDENING, estimate
from truepose.identification.fit.problem import prior_of
from truepose.identification.recording.load import load_recording
from truepose.identification.report.finding_words import form_words
from truepose.identification.report.results import diagnosis_json
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.signatures import Signatures

Benches = Callable[[str, int], Bench]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Benches:
    folder = tmp_path_factory.mktemp("benches")
    return lambda name, seed: Bench(folder, name, seed)


# -- nothing missing ------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [1, 2])
def test_where_nothing_is_missing_the_model_is_adequate(bench: Benches, seed: int) -> None:
    table = bench("table", seed)
    found = table.diagnose(table.frame(table.readings(50), time=clock(50)))
    assert found.verdict == "adequate"
    assert not found.findings
    assert not found.concealed
    assert found.remainder is None
    assert not found.terms
    assert not any(alarm.raised for alarm in found.alarms.values())
    assert found.fits["after"].chi2_per_dof == pytest.approx(1.0, abs=0.35)


def test_alarms_are_uniform_where_nothing_is_missing(bench: Benches) -> None:
    """p-values over recordings with parameters drawn from their tolerances and noise as stated."""
    drawn: dict[str, list[float]] = {"residual": [], "prior_conflict": [], "structure": []}
    for seed in range(30):
        table = bench("table", 100 + seed)
        prior = prior_of(table.machine)
        table.true = prior.mean + prior.sigma * table.rng.standard_normal(len(prior.mean))
        frame = table.frame(table.readings(15), time=clock(15))
        recording = load_recording(table.machine, [table.csv(frame)])
        before = estimate(table.machine, recording)
        free = estimate(table.machine, recording, start=before.p, widen=FREE_WIDENING)
        lin = Signatures(table.machine, recording, ()).linearise(before)
        drawn["residual"].append(alarms.residual_alarm(free, recording).p)
        drawn["prior_conflict"].append(conflict_with_tolerances(lin, 1.0).p)
        drawn["structure"].append(alarms.structure_alarm(before, recording).p)
    for name in ("residual", "structure"):
        assert kstest(drawn[name], "uniform").pvalue > 1e-3, name
    for name, values in drawn.items():  # the smaller of two, doubled, is uniform at its small end only
        for level in (0.05, 0.1, 0.2):
            count = int(np.sum(np.array(values) <= level))
            assert binom.sf(count - 1, len(values), level) > 1e-3, (name, level, count)
            assert binom.cdf(count, len(values), 0.7 * level) > 1e-3, (name, level, count)


# -- what is missing ------------------------------------------------------------------------------------


def play(q: Array, width: float) -> Array:
    """The play operator: the driven side stays where it is until the gap is used up (n,)."""
    out, here = np.empty(len(q)), q[0] - width / 2
    for k, driver in enumerate(q):
        here = float(np.clip(here, driver - width / 2, driver + width / 2))
        out[k] = here
    return out


@pytest.fixture(scope="module")
def backlash(bench: Benches) -> tuple[Bench, pd.DataFrame, Diagnosis]:
    """A revolute joint with 0.5 mrad of play, visited in random order."""
    table, width = bench("table", 5), 5e-4
    q = table.readings(60)
    way = np.concatenate([[q[0, 1] - 1.0], q[:, 1]])
    stands = np.column_stack([q[:, 0], play(way, width)[1:]])
    sides: dict[str, Any] = {
        f"approach.{n}": np.sign(np.diff(q[:, k], prepend=q[0, k] - 1)) for k, n in enumerate("sq")
    }
    frame = table.frame(q, stands, time=clock(60), **sides)
    return table, frame, table.diagnose(frame)


def test_play_is_named_backlash_where_it_is(backlash: tuple[Bench, pd.DataFrame, Diagnosis]) -> None:
    found = backlash[2]
    # strokes are thousands of widths long: play, and friction whose pre-sliding is as short, leave the same trace
    finding = the_only(found, "backlash", "q", alike=("friction-hysteresis",))
    width = finding.parameters["b"]
    assert width.unit == "rad"
    assert width.value == pytest.approx(5e-4, abs=4 * width.std)
    assert width.std < 5e-5
    assert not finding.prior_dependent
    assert not found.concealed
    assert found.alarms["residual"].raised
    assert max(found.evidence_map, key=lambda place: found.evidence_map[place]) == "q"
    proof = found.proof
    assert proof is not None
    assert proof.ratio < 0.8
    assert proof.injected_recovered
    assert proof.placebo_gain is not None
    assert proof.placebo_gain < 3.0
    assert found.fits["after"].chi2_per_dof == pytest.approx(1.0, abs=0.35)


def test_what_cannot_be_tested_is_listed_with_its_reason(
    backlash: tuple[Bench, pd.DataFrame, Diagnosis],
) -> None:
    why = {u.effect: u.why for u in backlash[2].untestable}
    assert "no `gravity:` in the machine file; add" in why["joint-compliance"]
    assert "no temperature" in why["thermal-expansion"]
    assert "one session" in why["zero-shift"]
    assert "backlash" not in why
    table, frame, _ = backlash
    bare = frame[[c for c in map(str, frame) if not c.startswith(("approach", "time"))]]
    in_order = table.recording(bare)
    why = {u.effect: u.why for u in catalogue(table.machine, in_order).untestable}
    assert not {"backlash", "mount-drift"} & set(why)  # the order of the rows tells both
    shuffled = replace(in_order, shuffled=True)
    why = {u.effect: u.why for u in catalogue(table.machine, shuffled).untestable}
    assert "no approach" in why["backlash"] and "shuffled" in why["backlash"]
    assert "no time column" in why["mount-drift"]


def test_a_misread_drawing_is_concealed_by_the_free_fit(bench: Benches) -> None:
    """An offset of 3 mm where 0.1 mm is the tolerance: the ordinary fit swallows it whole."""
    table = bench("table", 10)
    names = [p.name for p in table.machine.parameters]
    table.true[names.index("q.d")] += 3.0
    found = table.diagnose(table.frame(table.readings(40)))
    assert found.concealed
    assert found.verdict == "missing-physics"
    assert not found.alarms["residual"].raised
    assert found.alarms["prior_conflict"].raised
    (finding,) = found.findings
    explanations = {(finding.effect, finding.place), *((e.effect, e.place) for e in finding.equivalents)}
    assert ("wrong-constant", ("q.d",)) in explanations
    assert finding.prior_dependent
    assert finding.flip_lambda is not None
    assert finding.flip_lambda > 2


def test_rows_that_are_no_readings_are_told_apart_from_physics(bench: Benches) -> None:
    table = bench("table", 11)
    frame = table.frame(table.readings(60))
    frame.loc[[7, 30], "x [mm]"] += 1.0
    found = table.diagnose(frame)
    assert found.outlier_rows == (8, 31)
    assert found.verdict == "adequate"


def test_what_no_effect_explains_is_unknown(bench: Benches) -> None:
    """The slide's error follows the product of both joints' positions."""
    table = bench("table", 12)
    q = table.readings(60)
    error = 0.2 * np.sin(3 * q[:, 1]) * np.cos(q[:, 0] / 15)
    found = table.diagnose(table.frame(q, q + np.outer(error, [1, 0])))
    assert found.verdict == "unknown"
    assert not found.findings
    left: Any = found.remainder
    assert left is not None
    assert left.driver
    assert "hypothesised" in form_words(left)


def test_a_body_that_lags_its_thermometer_is_thermal_expansion(bench: Benches) -> None:
    """The column follows the air with a lag that the catalogue does not have; its length is 400 mm."""
    arm, rows, lag, alpha = bench("arm", 7), 60, 1300.0, 2.0e-5
    seconds = clock(rows, 90.0)
    air = 20 + 6 * np.sin(seconds / 1500) + 4 * (seconds > 3000)
    body = np.empty(rows)
    body[0] = air[0]
    for k in range(1, rows):  # small explicit steps between the rows
        fine, here = np.linspace(air[k - 1], air[k], 50), body[k - 1]
        for outside in fine:
            here += (90.0 / 50) / lag * (outside - here)
        body[k] = here
    frame = arm.frame(
        arm.readings(rows),
        shifts={"q1.r": 400 * alpha * (body - 20)},
        time=seconds,
        **{"temperature.base": air},
    )
    finding = the_only(arm.diagnose(frame), "thermal-expansion", "base")
    assert finding.parameters["alpha"].value == pytest.approx(alpha, rel=0.25)
    assert finding.settings[0]["lag"] > 0


def test_a_gear_that_stiffens_is_a_compliant_joint(bench: Benches) -> None:
    """Torque winds the joint up, less and less as it grows."""
    arm, rows = bench("arm", 8), 60
    q, kg = arm.readings(rows), np.tile([0.0, 4.0, 8.0], rows // 3)
    torque = -9.80665 * kg * 0.5 * np.cos(q[:, 1])
    yields = 8e-6 * torque / (1 + np.abs(torque) / 150)
    frame = arm.frame(q, q + np.outer(yields, [0, 1]), payload=kg)
    # the load hangs at the end of the one link that the joint carries, whose far half is the tool
    finding = the_only(arm.diagnose(frame), "joint-compliance", "q2", alike=("link-bending", "gravity-sag"))
    c = finding.parameters["c"]
    assert c.unit == "rad/(N*m)"
    assert 5e-6 < c.value < 8e-6


@pytest.mark.nightly
def test_slack_that_weight_takes_up_is_not_surely_a_compliant_joint(
    bench: Benches,
) -> None:
    """Bends of the compliance follow it, but they carry so much of it that the form is another."""
    arm, rows = bench("arm", 8), 60
    q, kg = arm.readings(rows), np.tile([0.0, 4.0, 8.0], rows // 3)
    torque = -9.80665 * kg * 0.5 * np.cos(q[:, 1])
    frame = arm.frame(q, q + np.outer(3e-4 * np.tanh(torque / 5.0), [0, 1]), payload=kg)
    found = arm.diagnose(frame)
    assert found.verdict != "adequate"
    assert all(f.probability < 0.9 for f in found.findings if f.effect == "joint-compliance")


@pytest.mark.nightly
def test_a_sigma_that_is_stated_too_small_takes_no_name_away(bench: Benches) -> None:
    """Most of the misfit is noise then, which no effect explains; it speaks against none."""
    arm, rows = bench("arm", 11), 240
    q, kg = arm.readings(rows), np.tile([0.0, 4.0, 8.0], rows // 3)
    torque = -9.80665 * kg * 0.5 * np.cos(q[:, 1])
    frame = arm.frame(q, q + np.outer(5e-6 * torque, [0, 1]), payload=kg)
    frame[["x [mm]", "y [mm]", "z [mm]"]] += arm.rng.normal(0.0, 0.023, (rows, 3))
    found = arm.diagnose(frame)
    after, before = (found.fits[stage].chi2_per_dof for stage in ("after", "before"))
    assert after > 4.0 and before - after < 0.5 * (before - 1.0)
    (finding,) = found.findings
    names = {finding.effect, *(other.effect for other in finding.equivalents)}
    assert "joint-compliance" in names
    assert finding.certainty > 0.45


@pytest.mark.nightly
def test_a_platform_that_bends_like_a_beam_is_named(bench: Benches) -> None:
    """Each leg lifts its own end; the others follow with the squared cosine of the angle between them."""
    hexapod, rows = bench("hexapod", 9), 40
    q = hexapod.readings(rows)
    ends = [hexapod.machine.geometry[f"leg{k}.b.{c}"].nominal for k in range(1, 7) for c in "xy"]
    x, y = np.reshape(ends, (6, 2)).T
    angle = np.arctan2(y, x)
    follow = np.cos(angle[:, None] - angle) ** 2 - 0.4
    lift = 0.01 * q @ follow.T
    frame = hexapod.frame(q, shifts={f"leg{k + 1}.b.z": lift[:, k] for k in range(6)})
    found = hexapod.diagnose(frame)
    finding = the_only(found, "platform-deformation", "platform")
    own = [v.value for name, v in finding.parameters.items() if name in ("kappa", "K[1,1]")]
    assert own[0] > 0
    assert found.evidence_map["platform"] == max(found.evidence_map.values())


ARM = """
schema: truepose/machine/1
name: wrist
gravity: [0, 0, -9.80665]
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, range: [-180, 180]}
    - {name: q2, kind: revolute, alpha: -90, range: [-180, 180]}
    - {name: q3, kind: revolute, alpha: 90, range: [-180, 180]}
frames: {tool: {in: flange, xyz: [400, 30, 60], tolerance: {xyz: 1}}}
sensor: {type: position, sigma: {xyz: 0.01}}
tolerances: {length: 0.2, angle: 0.05}
masses: {tip: {kg: 8, com: [20, -10, 5], in: tool}}
"""
SIGMA, SAG = 0.01, 1e-5


def recorded(n: int, seed: int = 2) -> pd.DataFrame:
    """An arm whose mount turns by SAG (rad/(N m)) times the weight's moment, plain numpy."""
    rng, rows = np.random.default_rng(seed), []
    for time in range(n):
        q = rng.uniform(-2.5, 2.5, 3)
        turned = Rotation.identity()
        for alpha, angle in zip((0.0, -90.0, 90.0), q, strict=True):
            turned = turned * Rotation.from_euler("XZ", [np.radians(alpha), angle])
        tip, centre = turned.apply([[400.0, 30.0, 60.0], [420.0, 20.0, 65.0]])
        moment = np.cross(centre, [0.0, 0.0, -8 * 9.80665]) / 1000.0
        seen = Rotation.from_rotvec(SAG * moment).apply(tip) + SIGMA * rng.standard_normal(3)
        rows.append([60.0 * time, *np.degrees(q), *seen])
    return pd.DataFrame(rows, columns=["time", "q1", "q2", "q3", "x", "y", "z"])


def test_twins_are_known_together(tmp_path: Path) -> None:
    """An upright first joint's bearings and the floor below it yield alike; that one of them does is certain."""
    found = diagnose(machine_from(tmp_path, ARM), recorded(60))
    assert not any(f.probability > 0.9 for f in found.findings)
    (one,) = [t for t in found.together if t.driver == "load"]
    assert {"base", "link1"} <= set(one.places)
    assert one.probability > 0.95
    told = diagnosis_json(found)["together"]
    assert {"driver": "load", "places": list(one.places), "probability": one.probability} in told
    assert any(line.strip().startswith("together:") for line in diagnosis_lines(found, Path("out")))
