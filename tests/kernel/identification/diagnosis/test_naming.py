"""What names are worth before any reading: shares of slugs and places, rivals without a name; families; when a model fails."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pandas as pd
import pytest

from support.effect_machines import read_machines
from support.searched_arm import PLAY, SCALE, Case, searched, sums_of
from support.simulated import machine_from, recorded
from truepose.identification.diagnosis.alarms import misfits
from truepose.identification.diagnosis.diagnose import verdict
from truepose.identification.diagnosis.naming import (
    FAMILY,
    UNREPLICATED,
    Summary,
    cap_law,
    keep_supported,
    named,
    summarised,
)
from truepose.identification.diagnosis.posterior_summary import Sums, driver_of, parts_of
from truepose.identification.diagnosis.proof import replications
from truepose.identification.diagnosis.result import Alarm, Replication
from truepose.identification.diagnosis.search import Found
from truepose.identification.posterior.state import State
from truepose.identification.prior import TOGETHER
from truepose.identification.recording.load import load_recording
from truepose.identification.signatures.candidates import Catalogue, catalogue
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import EffectAtPlace

ARM = """schema: truepose/machine/1
name: arm
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: 90, d: 50, range: [-100, 100]}
    - {name: q3, kind: revolute, d: 300, range: [-100, 100]}
frames: {tool: {in: flange, xyz: [200, 0, 0], tolerance: {xyz: 0.5, rpy: 0}}}
sensor: {type: position, sigma: {xyz: 0.01}}
tolerances: {length: 0.1, angle: 0.05}
"""
ROWS = 24


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Machine, Catalogue]:
    """Candidates of a small arm, two sessions, a room that warms up."""
    folder: Path = tmp_path_factory.mktemp("naming")
    (folder / "arm.yaml").write_text(ARM)
    rng = np.random.default_rng(3)
    frame = pd.DataFrame(rng.uniform(-90, 90, (ROWS, 3)), columns=["q1", "q2", "q3"])
    frame["time"] = np.arange(ROWS) * 60.0
    frame["session"] = 1 + (np.arange(ROWS) >= ROWS // 2)
    frame["temperature.air"] = np.linspace(20, 24, ROWS)
    frame[["x", "y", "z"]] = rng.normal(size=(ROWS, 3))
    frame.to_csv(folder / "rows.csv", index=False)
    machine = load_machine(folder / "arm.yaml")
    return machine, catalogue(machine, load_recording(machine, [folder / "rows.csv"]))


def test_priors_of_all_candidates_add_up_to_one(arm: tuple[Machine, Catalogue]) -> None:
    assert np.sum(np.exp(arm[1].log_prior)) == pytest.approx(1.0)


def test_one_joint_alone_is_likelier_than_two_at_once(arm: tuple[Machine, Catalogue]) -> None:
    cat = arm[1]
    share = {1: 0.0, 2: 0.0}
    for placed, log in zip(cat.candidates, cat.log_prior, strict=True):
        if placed.effect.slug == "zero-shift":
            share[len(placed.place)] += float(np.exp(log))
    assert share[2] / (share[1] + share[2]) == pytest.approx(TOGETHER)


# -- families -----------------------------------------------------------------------------------------------


WAVES = {
    EffectAtPlace("encoder-eccentricity", ("q1",)): "order=1,a=1e-3,b=5e-4",
    EffectAtPlace("encoder-eccentricity", ("q2",)): "order=1,a=-1e-3",
    EffectAtPlace("encoder-eccentricity", ("q3",)): "order=1,b=2e-3",
}
SCALES = {
    EffectAtPlace("actuator-scale", ("q1",)): "s=2e-3",
    EffectAtPlace("actuator-scale", ("q2",)): "s=-2e-3",
    EffectAtPlace("actuator-scale", ("q3",)): "s=3e-3",
}
COUPLED = {EffectAtPlace("axis-coupling", ("q2", "q1")): "k=1e-3"}


def found_in(folder: Path, truth: Mapping[EffectAtPlace, str]) -> Found:
    """Of the arm with these effects simulated."""
    machine = machine_from(folder, ARM, "arm")
    rng = np.random.default_rng(4)
    rows = pd.DataFrame(rng.uniform(-95, 95, (2 * ROWS, 3)), columns=["q1 [deg]", "q2 [deg]", "q3 [deg]"])
    texts = [f"{slug}@{'+'.join(place)}:{values}" for (slug, place), values in truth.items()]
    return Case.on(machine, recorded(machine, rows, *texts)).found()


def said(found: Found) -> dict[EffectAtPlace, str]:
    """What is said, and the family of each."""
    return {n.cause: n.family for n in named(found, sums_of(found)) if n.said}


def doubted(found: Found, cause: EffectAtPlace) -> Found:
    """One of its causes is there one time in ten."""
    problem, posterior, mode = found.problem, found.posterior, found.mode
    number = problem.causes.index(cause)
    rest = tuple(m for m in mode.members if problem.spike_slab.terms.cause[m[0]] != number)
    causes, beside = posterior.causes.copy(), posterior.beside.copy()
    causes[number], beside[number], beside[:, number] = 0.1, 0.0, 0.0
    states = ((State(rest, mode.point, 0.0), 0.9), (mode, 0.1))
    return replace(found, posterior=replace(posterior, causes=causes, beside=beside, states=states))


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> Found:
    return found_in(tmp_path_factory.mktemp("three"), {**WAVES, **COUPLED})


def test_from_three_places_of_one_effect_on_they_are_a_family(tmp_path: Path, three: Found) -> None:
    """Each is said for itself still; two are none, and nothing else beside them is of it."""
    assert FAMILY == 3
    assert said(three) == dict.fromkeys(WAVES, "encoder-eccentricity") | dict.fromkeys(COUPLED, "")
    two = {cause: text for cause, text in WAVES.items() if cause.place != ("q3",)}
    assert said(found_in(tmp_path, {**two, **COUPLED})) == dict.fromkeys((*two, *COUPLED), "")


@pytest.mark.parametrize("doubt", WAVES)
def test_a_place_that_is_not_said_makes_no_family(three: Found, doubt: EffectAtPlace) -> None:
    rest = [cause for cause in (*WAVES, *COUPLED) if cause != doubt]
    found = doubted(three, doubt)
    assert said(found) == dict.fromkeys(rest, "")
    (other,) = [n for n in named(found, sums_of(found)) if n.cause == doubt]
    assert not other.said and other.family == ""


def test_three_joints_that_err_each_in_its_own_size_are_three(tmp_path: Path) -> None:
    """And not two of them beside an error of all three at once, which says the same."""
    assert said(found_in(tmp_path, SCALES)) == dict.fromkeys(SCALES, "actuator-scale")


# -- verdicts -----------------------------------------------------------------------------------------------


QUIET = Alarm(1.0, 0.5)


def raised(*, residual: Alarm = QUIET, stated: float = 0.5) -> dict[str, Alarm]:
    return {"residual": residual, "prior_conflict": Alarm(9.0, stated), "structure": QUIET}


def test_a_model_fails_by_what_misstated_tolerances_and_sigmas_do_not_explain() -> None:
    assert not misfits(raised(stated=1e-20))  # tolerances may be stated too small
    stated = raised(residual=Alarm(2.0, 1e-6, "stated sigma"))
    assert not misfits(stated)  # a sigma that is wrong by less than three
    assert misfits(raised(residual=Alarm(2.0, 1e-6, "replicates")))
    assert misfits(raised(residual=Alarm(10.0, 1e-6, "stated sigma")))


@pytest.mark.parametrize(
    "residual", [QUIET, Alarm(1.7, 1e-6, "stated sigma"), Alarm(1.7, 1e-6, "replicates")]
)
@pytest.mark.parametrize("nameless", [0.5, 0.95])
@pytest.mark.parametrize("named", [False, True])
def test_one_rule_gives_the_verdict(named: bool, nameless: float, residual: Alarm) -> None:
    """What is named is missing; else what is surely there, or what noise alone cannot make, is unknown."""
    said = cast(
        Summary,
        SimpleNamespace(names=("form",) if named else (), inclusion=SimpleNamespace(nameless=nameless)),
    )
    there = nameless > 0.9 or residual.about == "replicates"
    told = "missing-physics" if named else "unknown" if there else "adequate"
    assert verdict(said, raised(residual=residual)) == told


@pytest.fixture(scope="module")
def found() -> Found:
    return searched(PLAY, SCALE)[1]


@pytest.fixture(scope="module")
def summary(found: Found) -> Summary:
    return summarised(found, found.fit)


def test_names_that_the_fit_determines_stay(found: Found, summary: Summary) -> None:
    kept = keep_supported(summary, found, found.fit, partial(replications, found, rms=1.0))
    assert [n.cause for n in kept.summary.names] == [n.cause for n in summary.names]
    assert kept.unseen == () and len(kept.replications) == len(summary.names)


@pytest.mark.parametrize(("sigmas", "stays"), [(2.5, False), (3.5, True)])
def test_a_name_needs_three_sigma_of_the_nonlinear_fit(
    found: Found, summary: Summary, sigmas: float, stays: bool
) -> None:
    at = found.fit.prior.names.index("backlash@q2:b")
    p = found.fit.p.copy()
    p[at] = sigmas * found.fit.std[at]
    kept = keep_supported(
        summary, found, replace(found.fit, p=p), partial(replications, found, rms=1.0)
    ).summary
    assert any(n.cause.effect == "backlash" for n in kept.names) is stays
    assert any(n.cause.effect == "backlash" for n in kept.leading) is not stays


def test_what_no_reading_sees_could_not_be_tested(found: Found, summary: Summary) -> None:
    """The same fit with a column that no reading depends on: the prior alone holds the coefficient."""
    free = found.fit.prior.free.tolist().index(found.fit.prior.names.index("backlash@q2:b"))
    factor, p = found.fit.factor.copy(), found.fit.p.copy()
    factor[:, free] = 0.0
    p[found.fit.prior.free[free]] = 0.0
    kept = keep_supported(
        summary, found, replace(found.fit, factor=factor, p=p), partial(replications, found, rms=1.0)
    )
    assert [one.effect for one in kept.unseen] == ["backlash"] and "q2" in kept.unseen[0].why
    assert all(n.cause.effect != "backlash" for n in (*kept.summary.names, *kept.summary.leading))
    play = next(n.cause for n in summary.names if n.cause.effect == "backlash")
    assert kept.summary.inclusion.places[play] == 0.0


@pytest.mark.parametrize(
    ("half", "capped"),
    [
        (Replication((0.9, 0.9), True), False),
        (Replication((0.9, 0.1), True), True),
        (Replication((0.9, 0.9), False), True),
        (Replication((0.9, 0.0), True, (True, False)), False),
        (None, False),
    ],
)
def test_a_law_that_a_half_does_not_show_is_open(
    summary: Summary, half: Replication | None, capped: bool
) -> None:
    one = summary.laws[0]
    said = cap_law(one, half)
    assert said.probability == (UNREPLICATED if capped else one.probability)
    assert said.levels == one.levels  # location and driver stay
    total = said.probability + sum(m.probability for m in said.equivalents)
    assert total == pytest.approx(one.probability + sum(m.probability for m in one.equivalents))
    assert np.isclose(one.probability, 1.0, atol=0.4)


@pytest.fixture(scope="module")
def sums(found: Found) -> Sums:
    return sums_of(found)


def test_no_level_is_less_probable_than_a_deeper_one(summary: Summary) -> None:
    assert {(n.cause.effect, n.cause.place) for n in summary.laws} == {
        ("backlash", ("q2",)),
        ("actuator-scale", ("q1",)),
    }
    for name in summary.names:
        assert name.probability <= name.levels.driver <= name.levels.place <= 1.0
        assert name.levels.driver > 0.9
        assert summary.inclusion.places[name.cause] == name.probability  # told with one value


def test_a_wave_and_a_curve_of_the_own_position_are_one_driver(sums: Sums) -> None:
    assert driver_of("position-periodic") == driver_of("position") != driver_of("load")
    assert sums.at(["q1"], "position-periodic") == sums.at(["q1"], "position")


def test_parts_have_one_name_each(tmp_path: Path) -> None:
    machine = read_machines(tmp_path / "machines")["gough"]
    limb = machine.mechanism.limbs[0]
    assert parts_of(machine, "leg-compliance", (limb.name,)) == (limb.reading,)
    assert parts_of(machine, "wrong-constant", (f"{limb.name}.a.x",)) == (limb.reading,)
    assert parts_of(machine, "axis-coupling", ("q4", "q3")) == ("q4",)  # the one that is driven
    assert parts_of(machine, "gravity-sag", ("base",)) == ("base",)
    assert parts_of(machine, "zero-shift", ("q4", "q3", "q4")) == ("q4", "q3")
    encoded = read_machines(tmp_path / "machines")[
        "encoded"
    ]  # an encoder on a load side is a part of its own
    assert parts_of(encoded, "encoder-eccentricity", ("angle.q3",)) == ("angle.q3",)
    assert parts_of(encoded, "wrong-constant", ("q3.d",)) == ("q3",)


# -- drivers as types ---------------------------------------------------------------------------------------------
