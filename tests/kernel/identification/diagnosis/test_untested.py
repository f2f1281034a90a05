"""What could not be tested keeps its share: a compliance where nobody said which way is down is a candidate without a name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support.searched_arm import Case, sums_of
from support.simulated import machine_from, readings_of
from truepose.identification.diagnosis.findings import finding
from truepose.identification.diagnosis.naming import named, summarised
from truepose.identification.diagnosis.posterior_summary import Named, Rival
from truepose.identification.diagnosis.result import Levels
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.selection_problem import selection_problem, weighed_alone
from truepose.identification.fit.estimate import estimate
from truepose.identification.posterior.state import State
from truepose.identification.recording.load import load_recording
from truepose.identification.report.finding_words import driver_clauses
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.signatures import Signatures
from truepose.identification.signatures.untestable import GRAVITY, with_assumed_gravity
from truepose.models.machine.placed import EffectAtPlace

ARM = """
schema: truepose/machine/1
name: arm
{down}tolerances: {{length: 0.1, angle: 0.05}}
mechanism:
  type: serial
  joints:
    - {{name: q1, kind: revolute, r: 400, range: [-170, 170]}}
    - {{name: q2, kind: revolute, alpha: 90, d: 50, range: [-100, 100]}}
frames: {{tool: {{in: flange, xyz: [300, 0, 40], tolerance: {{xyz: 0.5, rpy: 0}}}}}}
sensor: {{type: position, sigma: {{xyz: 0.01}}}}
"""
ROWS = 40
DOWN = "gravity: [0, 0, -9.80665]\n"
WAVE, SOFT = EffectAtPlace("encoder-eccentricity", ("q2",)), EffectAtPlace("joint-compliance", ("q2",))


def case(folder: Path, *, stated: bool) -> Case:
    """A soft q2 that carries 1 kg at the tool, in a machine file that states gravity or not."""
    there, rng = machine_from(folder, ARM.format(down=DOWN), "down"), np.random.default_rng(12)
    machine = machine_from(folder, ARM.format(down=DOWN if stated else ""), "arm")
    table = pd.DataFrame(rng.uniform(-1, 1, (ROWS, 2)) * [160, 80], columns=["q1 [deg]", "q2 [deg]"])
    recording = load_recording(machine, readings_of(there, table, "joint-compliance@q2:c_kg=2e-4"))
    upright = with_assumed_gravity(machine)
    cat = catalogue(upright, recording, machine)
    return Case(cat, Signatures(upright, recording, cat.candidates), estimate(upright, recording))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[bool, Case]:
    """The case with gravity stated, and without."""
    folder = tmp_path_factory.mktemp("down")
    return {stated: case(folder, stated=stated) for stated in (True, False)}


@pytest.fixture(scope="module")
def searched(made: dict[bool, Case]) -> dict[bool, Found]:
    """What is found in the case with gravity stated, and without."""
    return {stated: one.found() for stated, one in made.items()}


# -- candidates by an assumption ----------------------------------------------------------------------------------


def test_where_nobody_said_which_way_is_down_the_base_stands_upright(tmp_path: Path) -> None:
    """What the file states is never assumed anew."""
    for text in (DOWN, "gravity: [9.8, 0, 0]\n"):
        stated = machine_from(tmp_path, ARM.format(down=text), "arm")
        assert with_assumed_gravity(stated) is stated
    silent = machine_from(tmp_path, ARM.format(down=""), "arm")
    upright = with_assumed_gravity(silent)
    assert silent.gravity is None and upright.gravity == GRAVITY and GRAVITY[2] < 0.0
    assert replace(upright, gravity=None) == silent


def test_what_is_a_candidate_by_an_assumption_alone_has_a_law_and_no_name(made: dict[bool, Case]) -> None:
    """And as likely beforehand as where it could be tested; what lacks is told all the same."""
    known, assumed = made[True].cat, made[False].cat
    assert [c.label for c in assumed.candidates] == [c.label for c in known.candidates]
    np.testing.assert_allclose(assumed.log_prior, known.log_prior)
    assert known.untested == frozenset()
    assert {k for k, c in enumerate(assumed.candidates) if c.needs_load} == assumed.untested
    assert {assumed.cause(k).effect for k in assumed.untested} == {"joint-compliance"}
    for k in range(len(assumed.candidates)):
        assert assumed.has_law(k) is known.has_law(k) is known.named(k)
        assert assumed.named(k) is (known.named(k) and k not in assumed.untested)
    told = {one.effect: one.why for one in assumed.untestable}
    assert "gravity:" in told["joint-compliance"]
    assert "joint-compliance" not in {one.effect for one in known.untestable}


def test_an_untested_deflection_is_weighed_as_a_tested_one(made: dict[bool, Case]) -> None:
    """The evidence of each candidate is that where gravity is stated, and so are its odds."""
    alone, first = [], []
    for one in made.values():
        problem = selection_problem(one.signatures.linearise(one.null), one.cat, one.rms)
        alone.append(weighed_alone(problem, len(one.cat.candidates)))
        first.append(problem.spike_slab.terms.log_first)
    np.testing.assert_allclose(alone[1], alone[0], atol=1e-6)
    np.testing.assert_allclose(first[1], first[0], atol=1e-12)


# -- what is said of it -------------------------------------------------------------------------------------------


def test_where_gravity_is_stated_nothing_is_left_untested(searched: dict[bool, Found]) -> None:
    found = searched[True]
    said = summarised(found, found.fit)
    assert SOFT in {n.cause for n in said.laws}
    assert all(m.tested for n in (*said.names, *said.leading) for m in n.equivalents)


def test_nothing_false_is_sure_without_gravity(searched: dict[bool, Found]) -> None:
    """What yields is said as a place under load, and not as a law."""
    found = searched[False]
    said = summarised(found, found.fit)
    assert all(n.probability < 0.9 for n in said.laws)
    assert SOFT not in {n.cause for n in (*said.names, *said.leading)}
    (one,) = [n for n in said.names if n.levels.kind == "load"]
    assert one.nameless and one.cause.place == ("q2",) and one.levels.place > 0.95


def test_a_wave_that_may_be_a_deflection_is_no_sure_wave(searched: dict[bool, Found]) -> None:
    """The driver is as open as the law; the place, which both share, stays."""
    found = searched[False]
    sums = sums_of(found)
    wave, soft = (found.problem.causes.index(cause) for cause in (WAVE, SOFT))
    assert sums.tested(wave) and not sums.tested(soft)
    assert sums.law(wave) < 0.7 and sums.at(("q2",), "position") < 0.7
    assert sums.at(("q2",)) > 0.95


def test_an_untested_deflection_keeps_its_share_and_takes_the_name_away(made: dict[bool, Case]) -> None:
    """Of states with a wave, with a deflection, and with both: the wave has those that leave nothing untested at its part."""
    one = made[False]
    wave = next(c.label for c in one.cat.candidates if c.at_place == WAVE)
    found = one.holding(wave)
    problem, point = found.problem, found.mode.point
    numbers = {cause: problem.causes.index(cause) for cause in (WAVE, SOFT)}
    cause = problem.spike_slab.terms.cause.tolist()
    term = {own: cause.index(number) for own, number in numbers.items()}

    def share(alone: float, untested: float, both: float) -> Named:
        sets = (
            ((WAVE,), alone),
            ((SOFT,), untested),
            ((WAVE, SOFT), both),
            ((), 1.0 - alone - untested - both),
        )
        states = tuple((State(tuple(sorted((term[c], 5) for c in own)), point, 0.0), p) for own, p in sets)
        causes, beside = np.zeros(len(problem.causes)), np.zeros((len(problem.causes),) * 2)
        causes[numbers[WAVE]], causes[numbers[SOFT]] = alone + both, untested + both
        beside[numbers[WAVE], [numbers[WAVE], numbers[SOFT]]] = alone, untested
        posed = replace(
            found, posterior=replace(found.posterior, causes=causes, beside=beside, states=states)
        )
        sums = sums_of(posed)
        assert sums.law(numbers[WAVE]) == pytest.approx(alone)
        assert sums.at(("q2",), "load") == pytest.approx(untested + both)
        assert sums.at(("q2",), "position") == pytest.approx(alone + both)
        assert sums.at(("q2",)) == pytest.approx(alone + untested + both)
        (told,) = named(posed, sums)
        return told

    sure = share(0.96, 0.0, 0.0)
    assert sure.cause == WAVE and sure.probability == pytest.approx(0.96) and sure.said
    open_ = share(0.3, 0.6, 0.05)
    assert open_.nameless and open_.probability == 0.0 and open_.said and not open_.tested
    assert [(m.cause, m.tested) for m in open_.equivalents] == [(SOFT, False), (WAVE, True)]
    assert [m.probability for m in open_.equivalents] == pytest.approx([0.65, 0.3])
    assert open_.levels.place == pytest.approx(0.95)
    assert open_.levels.kind == "load" and open_.levels.driver == pytest.approx(0.65)
    beside = share(
        0.2, 0.0, 0.7
    )  # a wave that stands beside a deflection nearly always is no wave that is known
    assert beside.nameless and beside.levels.driver == pytest.approx(0.9)


def test_what_could_not_be_tested_is_told_and_not_guessed(made: dict[bool, Case]) -> None:
    """A place under load with an untested deflection as its best explanation says so, and that it could not be tested."""
    found = made[False].holding(next(c.label for c in made[False].cat.candidates if c.at_place == WAVE))
    rivals = (Rival(SOFT, 0.9, 0.0, tested=False), Rival(WAVE, 0.06, 30.0))
    levels = Levels(0.99, "load", 0.9)
    own, cause = tuple(found.accepted), EffectAtPlace("empirical", ("q2",))
    said = Named(cause, own, 0.0, 0.97, rivals, 30.0, levels=levels, tested=False)
    told = finding(found.signatures.machine, found.catalogue, found.fit, said, None, None)
    (clause,) = driver_clauses([told])
    likely = "likely a compliant joint at q2 (90.0 %)"
    assert clause == f"something at q2 errs, {likely}, which could not be tested"
    assert told.explanation == ""
