"""The diagnosis on small recordings: what is adequate, what is named, what nothing explains, and what changes nothing.

Play is a state carried through the sequence, and no formula of the catalogue.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.stats import binom, kstest

from support.shifting_bench import Bench, clock, the_only
from truepose.identification.diagnosis import alarms
from truepose.identification.diagnosis.alarms import conflict_with_tolerances
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimate import FREE_WIDENING, estimate
from truepose.identification.fit.problem import prior_of
from truepose.identification.recording.load import load_recording
from truepose.identification.report.finding_words import form_words
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.signatures import Signatures

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, int], Bench]:
    folder = tmp_path_factory.mktemp("benches")
    return lambda name, seed: Bench(folder, name, seed)


# -- nothing missing ------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [1, 2])
def test_where_nothing_is_missing_the_model_is_adequate(
    bench: Callable[[str, int], Bench], seed: int
) -> None:
    table = bench("table", seed)
    found = table.diagnose(table.frame(table.readings(50), time=clock(50)))
    assert found.verdict == "adequate"
    assert not found.findings
    assert not found.concealed
    assert found.remainder is None
    assert not found.terms
    assert not any(alarm.raised for alarm in found.alarms.values())
    assert found.fits["after"].chi2_per_dof == pytest.approx(1.0, abs=0.35)


def test_alarms_are_uniform_where_nothing_is_missing(bench: Callable[[str, int], Bench]) -> None:
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
def backlash(bench: Callable[[str, int], Bench]) -> tuple[Bench, pd.DataFrame, Diagnosis]:
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


def test_order_of_rows_and_units_change_nothing(backlash: tuple[Bench, pd.DataFrame, Diagnosis]) -> None:
    table, frame, first = backlash
    scaled = frame.copy()
    for column in map(str, frame):
        name, _, unit = column.rstrip("]").partition(" [")
        if unit in ("mm", "rad"):
            small = {"mm": "um", "rad": "mrad"}[unit]
            scaled[column] *= 1000
            scaled = scaled.rename(columns={column: f"{name} [{small}]"})
    shuffled = scaled.sample(frac=1.0, random_state=3)
    second = table.diagnose(shuffled)
    assert second.verdict == first.verdict
    assert second.concealed == first.concealed
    assert [(f.effect, f.place, f.settings) for f in second.findings] == [
        (f.effect, f.place, f.settings) for f in first.findings
    ]
    for a, b in zip(first.findings, second.findings, strict=True):
        assert b.log_bayes_factor == pytest.approx(a.log_bayes_factor, rel=1e-3, abs=1e-3)
        assert b.probability == pytest.approx(a.probability, abs=1e-3)
        for name, quantity in a.parameters.items():
            assert b.parameters[name].value == pytest.approx(quantity.value, rel=1e-5)
    for name, alarm in first.alarms.items():
        assert second.alarms[name].statistic == pytest.approx(alarm.statistic, rel=1e-4), name
    assert second.fits["before"].chi2_per_dof == pytest.approx(first.fits["before"].chi2_per_dof, rel=1e-6)


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


def test_a_misread_drawing_is_concealed_by_the_free_fit(bench: Callable[[str, int], Bench]) -> None:
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


def test_rows_that_are_no_readings_are_told_apart_from_physics(bench: Callable[[str, int], Bench]) -> None:
    table = bench("table", 11)
    frame = table.frame(table.readings(60))
    frame.loc[[7, 30], "x [mm]"] += 1.0
    found = table.diagnose(frame)
    assert found.outlier_rows == (8, 31)
    assert found.verdict == "adequate"


def test_what_no_effect_explains_is_unknown(bench: Callable[[str, int], Bench]) -> None:
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
