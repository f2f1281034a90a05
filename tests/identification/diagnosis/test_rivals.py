"""A name and what is only like it: the thing itself, its signal modulated by a joint, and what nobody tested."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support.searched_arm import PLAY, SCALE, Case, searched
from truepose.identification import prior
from truepose.identification.diagnosis import rivals
from truepose.identification.diagnosis.rivals import forms_hold
from truepose.identification.diagnosis.search import Found
from truepose.identification.prediction.simulate import simulate
from truepose.identification.recording.load import load_recording
from truepose.models.effect_text import parse_effect
from truepose.models.load import load_machine

UNTESTED = 1.0 / (1.0 + prior.ONLY_ALIKE)


def held(found: Found, slug: str) -> float:
    """Probability that the name in the mode is the thing itself."""
    name = [i for i in found.accepted if found.catalogue.cause(i)[0] == slug]
    assert name
    (like,) = forms_hold(found, 0.0, [name])
    assert like.tested
    return like.itself


@pytest.mark.parametrize("truth", [(PLAY,), (SCALE,), (PLAY, SCALE)])
def test_the_thing_itself_is_told_from_what_is_like_it(truth: tuple[str, ...]) -> None:
    _, found = searched(*truth)
    for text in truth:
        assert held(found, text.partition("@")[0]) > 0.97


@pytest.mark.parametrize(("share", "is_held"), [(0.05, True), (0.9, False)])
def test_play_that_differs_along_another_joint_is_only_like_play(
    tmp_path: Path, share: float, is_held: bool
) -> None:
    """Five percent is an error of form; ninety is no play of one size."""
    case = modulated(tmp_path, share)
    assert (held(case.found(), "backlash") > 0.9) is is_held


def test_play_that_differs_along_its_own_joint_is_play(tmp_path: Path) -> None:
    """How play is spread over the joint's travel is a matter of the joint."""
    assert held(modulated(tmp_path, 0.9, along="q2", reach=95.0).found(), "backlash") > 0.9


def test_what_the_fit_does_not_hold_was_not_tested() -> None:
    _, found = searched(PLAY)
    untouched = replace(
        found, linearisation=replace(found.linearisation, bent=((-1,),) * len(found.linearisation.bent))
    )
    name = list(found.accepted)
    (like,) = forms_hold(untouched, 0.0, [name])
    assert like.itself == pytest.approx(UNTESTED) and not like.tested
    assert forms_hold(found, 0.0, []) == []


def modulated(folder: Path, share: float, along: str = "q1", reach: float = 160.0) -> Case:
    """Play at q2 that grows and shrinks by ``share`` over a joint's ``reach`` (deg)."""
    case = Case.of(folder, PLAY)
    machine = load_machine(folder / "arm.yaml")
    table = pd.read_csv(folder / "rows.csv")
    plain = simulate(machine, case.signatures.recording, [], seed=None)
    full = simulate(machine, case.signatures.recording, [parse_effect(PLAY, machine)], seed=None)
    t = table[f"{along} [deg]"].to_numpy() / reach
    for name in plain.columns:
        table[name] += share * t * (full[name] - plain[name]).to_numpy()
    table.to_csv(folder / "rows.csv", index=False)
    recording = load_recording(machine, [folder / "rows.csv"])
    return Case.on(machine, recording)


def test_the_more_a_formula_is_bent_the_less_its_name_holds() -> None:
    """A mild bend is what formulas err by anyway; one that carries half of the signal speaks for another thing."""
    nothing = np.full((12, 3), -3.0)
    said = [rivals.held_probability(nothing, 0.5, bent) for bent in (0.0, 0.1, 0.2, 0.4, 0.8)]
    assert said[0] > 0.9 and said[1] > 0.9
    assert all(more > less for more, less in pairwise(said[1:]))
    assert said[3] < 0.5


@pytest.mark.parametrize("times", [1.0, 3.0, 28.0])
def test_a_name_larger_than_its_physics_costs_what_its_prior_says(times: float) -> None:
    """Beyond the largest usual size a law is as much rarer as the table of priors has it; within it nothing is paid."""
    _, found = searched(PLAY)
    name = [i for i in found.accepted if found.catalogue.cause(i)[0] == "backlash"]
    at = found.linearisation.free + np.array(found.linearisation.indices(name))
    departure = found.linearisation.departure.copy()
    departure[at] = times
    grown = replace(
        found, linearisation=replace(found.linearisation, departure=departure, bent=((-1,),) * len(name))
    )
    (like,) = forms_hold(grown, 0.0, [name])
    assert like.itself == pytest.approx(1.0 / (1.0 + prior.ONLY_ALIKE * times**prior.RARER))
    assert prior.beyond_usual(0.2) == 1.0
