"""What could not be tested keeps its share: a compliance where nobody said which way is down."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support.searched_arm import Case
from support.signature_rows import columns_at
from support.simulated import machine_from, readings_of
from truepose.identification.diagnosis.findings import finding
from truepose.identification.diagnosis.naming import summarised
from truepose.identification.diagnosis.posterior_summary import SHOWN, Named, Rival
from truepose.identification.diagnosis.result import Levels
from truepose.identification.diagnosis.rivals import beside_untested, without_untested
from truepose.identification.diagnosis.search import Found
from truepose.identification.fit.estimate import estimate
from truepose.identification.recording.load import load_recording
from truepose.identification.report.finding_words import driver_clauses
from truepose.identification.signatures.signatures import Signatures
from truepose.identification.signatures.untestable import GRAVITY, places_of
from truepose.models.effects.base import Effect, PlacedEffect, effects
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
Searched = Callable[[bool], tuple[Case, Found]]
ROWS = 40
DOWN = "gravity: [0, 0, -9.80665]\n"


def case(folder: Path, *, stated: bool) -> Case:
    """A soft q2 that carries 1 kg at the tool, in a machine file that states gravity or not."""
    there, rng = machine_from(folder, ARM.format(down=DOWN), "down"), np.random.default_rng(12)
    machine = machine_from(folder, ARM.format(down=DOWN if stated else ""), "arm")
    table = pd.DataFrame(rng.uniform(-1, 1, (ROWS, 2)) * [160, 80], columns=["q1 [deg]", "q2 [deg]"])
    rows = readings_of(there, table, "joint-compliance@q2:c_kg=2e-4")
    return Case.on(machine, load_recording(machine, rows))


@pytest.fixture(scope="module")
def searched(tmp_path_factory: pytest.TempPathFactory) -> Searched:
    """The case with gravity stated or not, and what is found in it: each is searched once."""

    @cache
    def once(stated: bool) -> tuple[Case, Found]:
        one = case(tmp_path_factory.mktemp("down"), stated=stated)
        return one, one.found()

    return once


def blamed(one: Case, found: Found, slug: str) -> tuple[Found, Named]:
    """An effect at q2 fitted to these readings, as a name that was drawn with 0.96."""
    wanted = next(i for i, c in enumerate(one.cat.candidates) if c.effect.slug == slug and c.place == ("q2",))
    fit = estimate(one.signatures.machine, one.signatures.recording, [one.cat.candidates[wanted]])
    found = replace(found, fit=fit)
    levels = Levels(0.99, one.cat.candidates[wanted].kind, 0.97)
    return found, Named(EffectAtPlace(slug, ("q2",)), (wanted,), 0.96, 0.97, (), 30.0, levels=levels)


def test_what_could_not_be_tested_is_told_and_not_guessed(searched: Searched) -> None:
    """A name that an untested deflection outweighs is said as a place under load, not as a law."""
    found, name = blamed(*searched(False), "encoder-eccentricity")
    rival = Rival(EffectAtPlace("joint-compliance", ("q2",)), 0.9, 0.0, tested=False)
    weak = replace(name, probability=0.06, equivalents=(rival,))
    (said,) = without_untested(found, [weak])
    assert (said.cause, said.probability, said.tested) == (EffectAtPlace("empirical", ("q2",)), 0.0, False)
    assert (said.levels.kind, said.levels.driver) == ("load", 0.9) and said.levels.place == name.levels.place
    assert [m.cause for m in said.equivalents] == [rival.cause, name.cause]
    assert without_untested(found, [name]) == (name,)
    told = finding(found.signatures.machine, found.catalogue, found.fit, said, None, None)
    (clause,) = driver_clauses([told])
    likely = "likely a compliant joint at q2 (90.0 %)"
    assert clause == f"something at q2 errs, {likely}, which could not be tested"
    assert told.explanation == ""


def test_where_gravity_is_stated_nothing_is_left_to_share(searched: Searched) -> None:
    one, first = searched(True)
    found, name = blamed(one, first, "encoder-eccentricity")
    assert beside_untested(found, [name]) == (name,)
    said = summarised(first, first.fit)
    assert ("joint-compliance", ("q2",)) in {(n.cause.effect, n.cause.place) for n in said.laws}


def test_nothing_false_is_sure_without_gravity(searched: Searched) -> None:
    _, found = searched(False)
    assert all(n.probability < 0.9 for n in summarised(found, found.fit).laws)
    assert found.signatures.machine.gravity is None and GRAVITY[2] < 0.0


def deflections(found: Found, effect: Effect) -> list[PlacedEffect]:
    """An effect's terms at all its places and settings, on the machine with gravity."""
    machine = replace(found.signatures.machine, gravity=GRAVITY)
    return [
        placed
        for place in places_of(effect, machine)
        for settings in effect.settings(machine, place, found.signatures.recording)
        if not (placed := PlacedEffect.at(effect, machine, place, settings)).bent
    ]


def odds_of(found: Found, soft: Sequence[PlacedEffect]) -> Callable[[list[int], PlacedEffect], float]:
    """exp of minus (1 - R^2) E / (2 (1 + E / 100)) of terms of the fit and a deflection, from rows written out in full."""
    machine = replace(found.signatures.machine, gravity=GRAVITY)
    signatures = Signatures(machine, found.signatures.recording, (*found.fit.effects, *soft))
    lin = signatures.linearise(found.fit)
    noise = float(found.problem.spike_slab.unknowns.scales(found.mode.point)[0])
    rows = columns_at(signatures, found.fit) / noise
    geometry = np.vstack([rows[:, : lin.free], np.diag(lin.weight)])
    columns = np.vstack([rows[:, lin.free : -1], np.zeros((lin.free, lin.columns[-1].stop))])
    left = columns - geometry @ np.linalg.lstsq(geometry, columns, rcond=None)[0]

    def odds(own: list[int], placed: PlacedEffect) -> float:
        at = lin.indices(own)
        signal = left[:, at] @ lin.departure[lin.free + np.array(at)]
        (k,) = lin.indices([lin.candidates.index(placed)])
        energy = float(signal @ signal)
        alike = float(signal @ left[:, k]) ** 2 / energy / float(left[:, k] @ left[:, k])
        return float(np.exp(-0.5 * (1.0 - alike) * energy / (1.0 + 0.01 * energy)))

    return odds


@pytest.mark.parametrize("curve", [False, True])
def test_an_untested_deflection_takes_the_odds_that_its_formula_says(tmp_path: Path, curve: bool) -> None:
    """(1 - R^2) E / (2 (1 + E / 100)) nats less, geometry free in its tolerances; with a curve beside it also of both together,
    as much likelier as the curve was unlikely. Nothing is lost between them."""
    one = case(tmp_path, stated=False)
    labels = {c.effect.slug: c.label for c in one.cat.candidates[::-1] if c.place == ("q2",)}
    wanted = [labels["encoder-eccentricity"], *([labels["empirical"]] if curve else [])]
    found = one.holding(*wanted)
    number = {c.label: i for i, c in enumerate(one.cat.candidates)}
    levels = Levels(0.99, "position-periodic", 0.97)
    alike = (Rival(EffectAtPlace("backlash", ("q1",)), 0.03, 20.0),)
    wave = EffectAtPlace("encoder-eccentricity", ("q2",))
    name = Named(wave, (number[wanted[0]],), 0.9, 0.97, alike, 30.0, levels=levels)
    (beside,) = beside_untested(found, [name])

    effect = effects.get("joint-compliance", "test")()
    soft = deflections(found, effect)
    odds = odds_of(found, soft)
    worth = {placed.place: odds([0], placed) for placed in soft}
    if curve:
        term = found.problem.candidates.index(number[wanted[1]])
        share = float(np.exp(found.problem.spike_slab.terms.log_first[term]))
        for placed in soft:
            worth[placed.place] += odds([0, 1], placed) / share
    places = {c.place for c in one.cat.candidates if c.effect.slug == wave.effect}
    rarer = effect.commonness / len(worth) * len(places) / found.fit.effects[0].effect.commonness
    kept = 1.0 / (1.0 + rarer * sum(worth.values()))
    assert beside.probability == pytest.approx(0.9 * kept)
    assert beside.levels.kind == "position-periodic"
    assert beside.levels.driver == pytest.approx(0.97 * kept)
    here = rarer * worth["q2",]
    assert beside.levels.place == pytest.approx(0.99 * (1.0 + here) * kept)
    untested = {m.cause.place: m.probability for m in beside.equivalents if not m.tested}
    expected = {place: 0.9 * rarer * one_worth * kept for place, one_worth in worth.items()}
    assert untested == pytest.approx({place: p for place, p in expected.items() if p > SHOWN})
    (other,) = (m for m in beside.equivalents if m.tested)
    assert other.probability == pytest.approx(0.03 * kept)
    assert [m.probability for m in beside.equivalents] == sorted(
        (m.probability for m in beside.equivalents), reverse=True
    )
    assert untested or not curve


def test_names_are_as_they_are_where_nothing_is_left_untested(tmp_path: Path) -> None:
    """A form without a name says nothing that a deflection could be taken for."""
    one = case(tmp_path, stated=False)
    curve = next(c.label for c in one.cat.candidates if c.effect.slug == "empirical" and c.place == ("q2",))
    found = one.holding(curve)
    nameless = Named(EffectAtPlace("empirical", ("q2",)), (0,), 0.0, 0.0, (), 9.0)
    assert beside_untested(found, [nameless]) == (nameless,)
    assert beside_untested(found, []) == ()


def test_curves_beside_an_untested_deflection_go_with_its_name(tmp_path: Path) -> None:
    """It explains them as well; a curve of another part stays, and so does one beside a name that stands."""
    one = case(tmp_path, stated=False)
    number = {c.label: i for i, c in enumerate(one.cat.candidates)}
    labels = {(c.effect.slug, c.place): c.label for c in one.cat.candidates[::-1]}
    own = [
        labels[key]
        for key in (("encoder-eccentricity", ("q2",)), ("empirical", ("q2",)), ("empirical", ("q1",)))
    ]
    found = one.holding(*own)
    wave, here, there = (number[label] for label in own)
    untested = Rival(EffectAtPlace("joint-compliance", ("q2",)), 0.6, 0.0, tested=False)
    tested = Rival(EffectAtPlace("backlash", ("q2",)), 0.3, 0.0)
    levels = Levels(0.5, "position", 0.4)
    name = Named(
        EffectAtPlace("encoder-eccentricity", ("q2",)),
        (wave,),
        0.2,
        0.9,
        (untested, tested),
        9.0,
        levels=levels,
    )
    curves = [
        Named(EffectAtPlace("empirical", (place,)), (k,), 0.0, 0.0, (), 8.0)
        for place, k in (("q2", here), ("q1", there))
    ]
    said = without_untested(found, [name, *curves])
    assert [n.cause.place for n in said] == [("q2",), ("q1",)]
    assert said[0].candidates == (here, wave) and not said[0].tested
    assert said[0].levels == Levels(0.5, "load", 0.5)  # no surer of its driver than of its place
    assert [m.probability for m in said[0].equivalents] == [0.6, 0.3, 0.2]
    standing = replace(name, probability=0.7)
    assert without_untested(found, [standing, *curves]) == (standing, *curves)


def test_a_wave_that_may_be_a_deflection_is_no_sure_wave(searched: Searched) -> None:
    """The driver is as open as the law; the place, which both share, stays."""
    found, name = blamed(*searched(False), "encoder-eccentricity")
    found = replace(found, linearisation=found.signatures.linearise(found.fit))
    (beside,) = beside_untested(found, [name])
    assert beside.probability < 0.7 and beside.levels.driver < 0.7
    assert beside.levels.place > 0.95
    (rival, *_) = beside.equivalents
    assert rival.cause == EffectAtPlace("joint-compliance", ("q2",)) and not rival.tested
    assert rival.probability + beside.probability == pytest.approx(name.probability, abs=0.05)
