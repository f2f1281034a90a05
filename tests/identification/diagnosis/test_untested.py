"""What could not be tested keeps its share: a compliance where nobody said which way is down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support.searched_arm import Case
from truepose.identification.diagnosis.findings import finding
from truepose.identification.diagnosis.naming import summarised
from truepose.identification.diagnosis.posterior_summary import Named, Rival
from truepose.identification.diagnosis.result import Levels
from truepose.identification.diagnosis.rivals import beside_untested, without_untested
from truepose.identification.diagnosis.search import Found
from truepose.identification.fit.estimate import estimate
from truepose.identification.prediction.simulate import simulate
from truepose.identification.recording.load import load_recording
from truepose.identification.report.level_words import driver_clauses
from truepose.identification.report.untestable_words import untestable_lines
from truepose.identification.signatures.untestable import GRAVITY, Untestable
from truepose.models.effect_text import parse_effect
from truepose.models.load import load_machine
from truepose.models.placed import EffectAtPlace

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
    (folder / "down.yaml").write_text(ARM.format(down=DOWN))
    (folder / "arm.yaml").write_text(ARM.format(down=DOWN if stated else ""))
    there, rng = load_machine(folder / "down.yaml"), np.random.default_rng(12)
    table = pd.DataFrame(rng.uniform(-1, 1, (ROWS, 2)) * [160, 80], columns=["q1 [deg]", "q2 [deg]"])
    table.to_csv(folder / "poses.csv", index=False)
    poses = load_recording(there, [folder / "poses.csv"], need_observations=False)
    soft = parse_effect("joint-compliance@q2:c_kg=2e-4", there)
    read = simulate(there, poses, [soft], seed=3)
    pd.concat([table, read], axis=1).to_csv(folder / "rows.csv", index=False)
    machine = load_machine(folder / "arm.yaml")
    return Case.on(machine, load_recording(machine, [folder / "rows.csv"]))


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


def test_what_a_line_would_make_testable_is_told_first() -> None:
    lines = untestable_lines(
        [
            Untestable("backlash", "q1: no approach.q1 column; q2: no approach.q2 column"),
            Untestable("zero-shift", "the recording holds one session only"),
            Untestable(
                "joint-compliance", "no `gravity:` in the machine file; add `gravity: [0, 0, -9.80665]`"
            ),
            Untestable("gravity-sag", "no `gravity:` in the machine file; add `gravity: [0, 0, -9.80665]`"),
        ]
    )
    assert lines == [
        "joint-compliance and gravity-sag: no `gravity:` in the machine file; add `gravity: [0, 0, -9.80665]`",
        "backlash: no approach.q1 column",
    ]
