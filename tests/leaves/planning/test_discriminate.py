"""Plans that tell explanations apart: what a row is worth and would tell, what a plan promises, what it varies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from support import MACHINES
from support.examples import examples
from support.experiments import BENT, COMPLIANT, UNEVEN, YIELDING, arm, planned, planned_on, poses, telescope
from truepose.arrays import Array
from truepose.identification.fit.estimate import estimate
from truepose.identification.leaves.planning.discriminate.experiment import discriminate
from truepose.identification.leaves.planning.discriminate.factors import (
    EXPECTED,
    Class,
    explanation,
    factors,
    read_offer,
)
from truepose.identification.leaves.planning.discriminate.race import Contest, Race, chosen
from truepose.identification.leaves.planning.discriminate.rows import Rows, recording_of, signals
from truepose.identification.leaves.planning.information import PoseInformation
from truepose.identification.leaves.planning.showing import experiment_table, sentences
from truepose.identification.prediction.predict import simulate, with_inputs
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.table import read_table
from truepose.identification.report.notes import worded
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effect_text import parse_effect
from truepose.models.effects.base import PlacedEffect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.sensors.targets import Targets

example_seeds = given(st.integers(0, 10**6))


def contest(seed: int, rows: int = 12, readings: int = 2, nuisance: int = 5) -> Contest:
    """Random rows; the nuisance's last columns come close to the signal."""
    rng = np.random.default_rng(seed)
    seen, signal = rng.standard_normal((rows, readings, nuisance)), rng.standard_normal((rows, readings, 2))
    seen[:, :, -1] = signal[:, :, 0] + 0.1 * seen[:, :, -1]
    earlier = rng.standard_normal((3, nuisance + 2))
    return Contest(seen, signal, np.array([1.0, 1.0, 0.1, 0.01, 1e-4]), earlier.T @ earlier, np.array([0, 1]))


def dense(c: Contest, design: list[int]) -> Array:
    """a' [V^-1 - V^-1 N (N' V^-1 N)^- N' V^-1] a by matrices as large as the readings; V holds all that has a prior."""
    k = len(c.precision)
    root = np.linalg.cholesky(c.base + 1e-12 * np.eye(len(c.base))).T
    nuisance = np.concatenate([root[:, :k], c.nuisance[design].reshape(-1, k)])
    signal = np.concatenate([root[:, k:], c.signal[design].reshape(-1, c.signal.shape[2])])
    covariance = np.eye(len(nuisance)) + (nuisance / c.precision) @ nuisance.T
    return np.asarray(np.diag(signal.T @ np.linalg.solve(covariance, signal)))


@example_seeds
def test_missed_is_the_signal_that_the_rival_and_geometry_cannot_reproduce(seed: int) -> None:
    c = contest(seed)
    design = np.random.default_rng(seed).permutation(12)[:5].tolist()
    assert c.missed(design) == pytest.approx(dense(c, design), rel=1e-6, abs=1e-8)


@example_seeds
def test_a_row_more_never_says_less(seed: int) -> None:
    c = contest(seed)
    values = [c.missed(list(range(k))) for k in range(12)]
    assert np.all(np.diff(values, axis=0) >= -1e-9 * np.max(values))


@example_seeds
def test_updates_are_what_the_changed_design_is_worth(seed: int) -> None:
    c = contest(seed)
    every, design = np.arange(12), [0, 3, 7, 8]
    added = [c.missed([*design, row]) for row in range(12)]
    removed = [c.missed([r for r in design if r != row]) for row in design]
    # rows are ranked in single precision
    assert c.after_adding(design, every) == pytest.approx(np.array(added), rel=1e-3, abs=1e-4)
    assert c.after_removing(design) == pytest.approx(np.array(removed), rel=1e-2, abs=1e-3)


@example_seeds
def test_order_of_rows_and_rescaled_geometry_change_nothing(seed: int) -> None:
    c, rng = contest(seed), np.random.default_rng(seed)
    design = rng.permutation(12)[:6].tolist()
    size = np.append(rng.uniform(0.1, 10.0, 5), np.ones(2))
    other = replace(c, nuisance=c.nuisance * size[:5], precision=c.precision * size[:5] ** 2)
    other = replace(other, base=c.base * np.outer(size, size))
    assert c.missed(design[::-1]) == pytest.approx(c.missed(design), rel=1e-9)
    assert other.missed(design) == pytest.approx(c.missed(design), rel=1e-6)


@hypothesis_settings(max_examples=examples(25))
@example_seeds
def test_chosen_rows_are_distinct_and_beat_random_ones(seed: int) -> None:
    race = Race((contest(seed),), 2, np.ones(2, dtype=bool))
    rng = np.random.default_rng(seed)
    design = chosen(race, 4)
    drawn = [float(race.judged(race.values(rng.permutation(12)[:4].tolist()))) for _ in range(10)]
    assert len(set(design)) == 4
    # greedy with exchange is no exhaustive search: the median of random sets it beats always
    assert float(race.judged(race.values(design))) >= np.median(drawn)


def test_the_worst_pair_is_the_same_whichever_is_named_first() -> None:
    one, other = (planned("arm", *texts, payload="0,5") for texts in ((YIELDING, UNEVEN), (UNEVEN, YIELDING)))
    by_names = {(p.true.name, p.rival.name): p.expected for p in other.pairs}
    for pair in one.pairs:
        assert pair.expected == pytest.approx(by_names[pair.true.name, pair.rival.name], rel=0.05)
    assert one.expected == pytest.approx(other.expected, rel=0.05)


@pytest.mark.parametrize(
    ("machine", "texts"),
    [("arm", (YIELDING, UNEVEN)), ("telescope", (COMPLIANT, BENT))],
)
def test_a_payload_step_tells_what_yields_from_what_does_not(machine: str, texts: tuple[str, str]) -> None:
    still, stepped = planned(machine, *texts), planned(machine, *texts, payload="0,2.5,5")
    first = {p.true.slug: p.expected for p in still.pairs}, {p.true.slug: p.expected for p in stepped.pairs}
    yields = texts[0].partition("@")[0]
    assert first[1][yields] > 10.0 * first[0][yields]
    assert still.held == ("payload",) and not stepped.held


def test_the_plan_beats_every_random_set_of_as_many_rows() -> None:
    found = planned("telescope", COMPLIANT, BENT, payload="0,5")
    assert found.expected > np.max(found.random)
    assert {float(v) for v in found.rows.drivers["payload"]} == {0.0, 5.0}


def test_rows_that_exist_count_and_more_rows_help() -> None:
    machine = arm()
    wanted = Class(tuple(explanation(text, machine) for text in (YIELDING, UNEVEN)))
    rows = Rows(poses(machine, 12, 5), {"payload": np.repeat([0.0, 5.0], 6)})
    recorded = recording_of(machine, rows, PoseInformation(machine).home)
    offer, given = read_offer(machine, "0,5"), poses(machine, 30)
    alone, both = (
        discriminate(machine, 6, wanted, offer=offer, recorded=seen, candidates=given)
        for seen in (None, recorded)
    )
    assert alone.already is None
    assert both.already is not None and 0.0 < both.already < both.expected
    assert both.expected > alone.expected


def test_the_promise_is_what_the_diagnosis_computes_from_a_recording(tmp_path: Path) -> None:
    """At stated noise and tolerances: what the rival and geometry cannot reproduce of the effect as it was put in."""
    machine = arm()
    found = planned(
        "arm", "joint-compliance@q2:c=2e-6", "friction-hysteresis@q2:width=0", n=24, payload="0,5"
    )
    frame = experiment_table(found)
    frame.to_csv(tmp_path / "rows.csv", index=False)
    rows = load_recording(machine, [tmp_path / "rows.csv"], need_observations=False)
    true, rival = (e.forms[0][0] for e in found.explanations)
    missing = parse_effect("joint-compliance@q2:c=2e-6", machine)
    read = with_inputs(read_table(tmp_path / "rows.csv"), simulate(machine, rows, [missing], seed=None))
    read.to_csv(tmp_path / "recording.csv", index=False)
    recording = load_recording(machine, [tmp_path / "recording.csv"])
    lin = Signatures(machine, recording, (true, rival)).linearise(estimate(machine, recording))
    signal = lin.free + np.array(lin.indices([0]))
    nuisance = np.concatenate([np.arange(lin.free), lin.free + np.array(lin.indices([1]))])
    inside = lin.gram[np.ix_(nuisance, nuisance)] + np.diag(np.append(lin.weight**2, 0.0))
    across = lin.gram[np.ix_(nuisance, signal)]
    left = lin.gram[np.ix_(signal, signal)] - across.T @ np.linalg.solve(inside, across)
    missed = float((2e-6 / true.coefficients[0].scale) ** 2 * left[0, 0])
    (pair,) = [p for p in found.pairs if p.true.slug == "joint-compliance"]
    # the fit has moved the expansion point
    assert 0.5 * missed == pytest.approx(pair.expected, rel=0.1)


def test_twins_are_said_to_be_twins_and_are_worth_nothing() -> None:
    found = planned("arm", "transmission-error@q2:order=1", "encoder-eccentricity@q2:order=1")
    assert found.expected == 0.0 and found.hopeless and not found.splits
    assert all(pair.identical for pair in found.pairs)
    assert "no plan splits them" in sentences(found)[0] and "second head" in sentences(found)[0]
    series = planned("arm", "transmission-error@q2:orders=60", "encoder-eccentricity@q2:order=1")
    assert all(pair.twins for pair in series.pairs) and series.expected == 0.0


def test_a_driver_that_was_not_offered_is_named() -> None:
    found = planned("arm", "thermal-expansion@link2", "friction-hysteresis@q3:width=0")
    assert {name for name in found.rows.drivers if name.startswith("approach")} == {"approach.q3"}
    assert "temperature.link2 was left at its nominal value: offer levels of it" in " ".join(sentences(found))
    offer = ("temperature.link2=15,20,30",)
    warm = planned("arm", "thermal-expansion@link2:alpha=1e-5", "friction-hysteresis@q3:width=0", vary=offer)
    assert set(warm.rows.drivers["temperature.link2"]) <= {15.0, 20.0, 30.0}
    assert not warm.stuck and warm.expected > 0.0


def test_sides_time_and_sessions_come_by_themselves() -> None:
    found = planned("arm", "mount-drift@base", "frame-shift@base", "backlash@q1", n=12)
    frame = experiment_table(found)
    assert set(frame["session"]) == {1, 2} and set(frame["approach.q1"]) == {-1.0, 1.0}
    assert frame["time"].max() >= 3600.0 and (frame.groupby("session")["time"].diff().dropna() > 0.0).all()


def test_what_a_way_leaves_behind_is_varied_by_the_side() -> None:
    found = planned("arm", "friction-hysteresis@q2", "actuator-scale@q2")
    assert set(found.rows.drivers) == {"approach.q2"} and found.expected > 0.0
    assert any("strokes that shrink are not planned" in note for note in worded(found.notes))
    backlash = planned("arm", "friction-hysteresis@q2", "backlash@q2")
    assert backlash.hopeless


def test_amplitudes_default_to_what_is_expected_or_imitates() -> None:
    machine = arm()
    assert explanation("backlash@q2", machine).amplitude is None
    stated = explanation("backlash@q2:b=1e-4", machine).amplitude
    assert stated is not None and stated == pytest.approx([1e-4 / 3e-3])
    small, large = (planned("arm", text, "backlash@q3") for text in ("backlash@q2", "backlash@q2:b=3e-5"))
    # the expected size is a hundredth of 3e-3 rad: stating it changes nothing for the one it is stated of
    assert pytest.approx(3e-5) == EXPECTED * 3e-3
    first = [next(p for p in e.pairs if p.true.place == ("q2",)).expected for e in (small, large)]
    assert first[0] == pytest.approx(first[1], rel=0.05)


def test_one_thermometer_in_the_air_serves_every_place() -> None:
    machine = arm()
    parts = explanation("thermal-expansion@link2", machine).forms[0]
    (factor,) = factors(machine, parts, read_offer(machine, named=["temperature.air=18,24"]))
    assert factor.driver == "temperature.air" and factor.nominal == 18.0 and len(factor.levels) == 2


def test_changes_of_length_count_from_one_reference_row(tmp_path: Path) -> None:
    machine = load_machine(MACHINES / "distance.yaml")
    joint = machine.mechanism.readings[0]
    found = planned_on(machine, f"actuator-scale@{joint}:s=1e-2", f"backlash@{joint}", n=6)
    frame = experiment_table(found)
    assert len(frame) == 7 and set(frame["from"]) == {1} and list(frame["pose"]) == list(range(1, 8))
    frame.to_csv(tmp_path / "rows.csv", index=False)
    assert len(load_recording(machine, [tmp_path / "rows.csv"], need_observations=False)) == 7


def part(text: str, machine: Machine) -> PlacedEffect:
    return explanation(text, machine).forms[0][0]


def gram(columns: Array) -> Array:
    """(c, k, k) information of each row."""
    return np.asarray(np.einsum("cmi,cmj->cij", columns, columns))


def rows_of(machine: Machine, q: Array) -> Rows:
    rng = np.random.default_rng(5)
    return Rows(q, {"payload": rng.uniform(1, 5, len(q)), "approach.q2": rng.choice([-1.0, 1.0], len(q))})


def exact() -> Machine:
    """A telescope whose three points are known exactly: nine readings, which tell of six motions of the mirror."""
    (sensor,) = telescope().sensors
    assert isinstance(sensor, Targets)
    points = tuple(replace(point, tolerance=0.0) for point in sensor.parameters)
    return replace(telescope(), sensors=(replace(sensor, parameters=points),))


@pytest.mark.parametrize(("name", "readings"), [("serial", 3), ("ups", 6), ("pus", 9), ("exact", 6)])
def test_rows_say_of_constants_what_planned_poses_say(name: str, readings: int) -> None:
    machine = exact() if name == "exact" else load_machine(MACHINES / f"{name}.yaml")
    information = PoseInformation(machine)
    q = poses(machine, 7)
    found = signals(machine, recording_of(machine, Rows(q, {}), information.home), ())
    assert found.names == information.names
    np.testing.assert_allclose(found.precision, information.weight**2)
    expected = gram(information.at(np.vstack([information.home, q])).signature)
    assert found.geometry.shape[1] == readings
    size = np.sqrt(np.einsum("cii->ci", expected)) + 1e-9
    shown = gram(found.geometry) / size[:, :, None] / size[:, None]
    np.testing.assert_allclose(shown, expected / size[:, :, None] / size[:, None], atol=1e-6)


def test_rows_say_of_effects_what_simulated_readings_say() -> None:
    """Readings with a thousandth of each coefficient's scale, without noise, in sigmas."""
    machine = arm()
    texts = ("joint-compliance@q2", "backlash@q2", "transmission-error@q3:order=2")
    parts = [part(text, machine) for text in texts]
    recording = recording_of(machine, rows_of(machine, poses(machine, 6)), PoseInformation(machine).home)
    found, none = signals(machine, recording, parts), simulate(machine, recording, seed=None).to_numpy()
    assert found.columns == (slice(0, 1), slice(1, 2), slice(2, 4))
    for effect, columns in zip(parts, found.columns, strict=True):
        for k, coefficient in enumerate(effect.coefficients):
            values = [0.0] * len(effect.coefficients)
            values[k] = 1e-3 * coefficient.scale
            read = simulate(machine, recording, [effect.with_values(values)], seed=None).to_numpy()
            moved = 1e3 * (read - none) / machine.channels[0].sigma
            shift = found.effects[:, :, columns.start + k]
            np.testing.assert_allclose(shift, moved, atol=2e-2 * np.max(np.abs(moved)))


def test_an_effect_of_the_file_that_is_in_question_is_asked_anew() -> None:
    machine = arm()
    own = part("joint-compliance@q2", machine)
    filed = machine.with_effects((own.with_values([3e-5]), part("backlash@q3", machine)))
    rows = recording_of(machine, rows_of(machine, poses(machine, 4)), PoseInformation(machine).home)
    assert signals(machine, rows, [own]).names == signals(filed, rows, [own]).names[:-1]
    assert signals(filed, rows, [own]).names[-1] == "backlash@q3:b"


def test_rows_that_cannot_be_assembled_and_those_held_back_tell_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also where a whole block of rows is none."""
    machine = exact()
    q = poses(machine, 9)
    far = q.copy()
    far[:4] = 1e5
    home = PoseInformation(machine).home
    whole = signals(machine, recording_of(machine, Rows(q, {}), home), ())
    monkeypatch.setattr("truepose.identification.prediction.predictor.BLOCK", 5)
    recording = recording_of(machine, Rows(far, {}), far[0])
    found = signals(machine, recording, ())
    assert not found.geometry[:5].any() and found.geometry.shape == whole.geometry.shape
    np.testing.assert_allclose(gram(found.geometry[5:]), gram(whole.geometry[5:]), rtol=1e-6, atol=1e-6)
    held = np.arange(10) == 7
    validation = signals(machine, replace(recording_of(machine, Rows(q, {}), home), validation=held), ())
    assert not validation.geometry[7].any() and validation.geometry[6].any() and validation.geometry[8].any()


def test_rows_have_no_past_but_their_own() -> None:
    """A joint came by a long move from its side; bodies have the temperatures of their thermometers."""
    machine, q = arm(), np.array([[0.0, 0.5, -0.2], [10.0, -0.3, 0.1]])
    drivers = {"approach.q2": np.array([1.0, -1.0]), "temperature.link2": np.array([20.0, 25.0])}
    found = recording_of(machine, Rows(q, drivers), np.zeros(3))

    def told(name: str) -> list[float] | None:
        values = found.driver(name)
        return None if values is None else values.tolist()[1:]

    assert told("temperature.link2~300") == told("temperature.link2") == [20.0, 25.0]
    assert told("stop.q2~0.01") == [0.01, -0.01]
    assert told("stop.q3~0.01") is None  # nobody says from where it came
    assert told("stop.q9~0.01") is None
    loop = told("loop.q2~0.5~-1~1")
    # the line of the whole loop has the slope 3 t^2 - 2 t^3, t the width's share of the range
    assert loop == pytest.approx([0.5 - 0.5 * 0.5, -0.5 + 0.5 * 0.3])
    assert found.from_row is not None and found.from_row.tolist() == [0, 0, 0] and found.shuffled
    assert found.session_recorded.all() and found.session.tolist() == [1, 1, 1] and found.time is None
