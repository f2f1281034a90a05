"""A name and what is only like it: the thing itself, its signal modulated by a joint, and what nobody tested."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.special import logit
from scipy.stats import norm

from support.searched_arm import PLAY, SCALE, Case, searched
from support.searched_arm import held as held_case
from support.signature_rows import columns_at
from truepose.arrays import Array
from truepose.identification import prior
from truepose.identification.diagnosis import rivals
from truepose.identification.diagnosis.rivals import forms_hold
from truepose.identification.diagnosis.search import Found
from truepose.identification.posterior.design import GridPoint
from truepose.identification.prediction.predict import simulate
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


# -- the sum over rivals ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("odds", [0.3, 1.0, 20.0])
@pytest.mark.parametrize("bent", [0.0, 0.05, 0.3, 0.9])
@pytest.mark.parametrize("sources", [1, 4])
def test_a_name_holds_as_likelihoods_of_it_and_of_other_things_say(
    sources: int, bent: float, odds: float
) -> None:
    """Its formula is poor with a known probability; another thing is off by more, along any source as likely.

    Terms that bend a formula are one source more, with the density of that bend in place of a gain.
    """
    gains = np.random.default_rng(sources).normal(0.0, 2.0, (sources, len(prior.OFF_FORM)))
    likely = np.exp(gains)
    if bent:
        usual = norm.pdf(bent, scale=prior.FORM_ERROR)
        likely = np.vstack([likely, [norm.pdf(bent, scale=share) / usual for share in prior.OFF_FORM]])
    poor, *others = likely.mean(axis=0)
    itself = (1.0 - prior.POOR) + prior.POOR * poor
    expected = itself / (itself + odds * np.mean(others))
    assert rivals.held_probability(gains, odds, bent) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("gain", "held"), [(1e4, 0.0), (-1e4, 1.0)])
def test_however_clear_it_is_a_probability_is_told(gain: float, held: float) -> None:
    with np.errstate(over="raise", invalid="raise"):
        found = rivals.held_probability(np.full((3, len(prior.OFF_FORM)), gain) * [0.0, 1.0, 1.0], 0.3)
    assert found == pytest.approx(held, abs=1e-100)


@pytest.mark.parametrize("nameless", [0.0, 0.25, 1.0])
def test_a_part_of_something_without_a_name_is_likelier_than_a_thing_that_is_only_like_it(
    nameless: float,
) -> None:
    _, found = held_case(PLAY)
    lin = replace(found.linearisation, bent=((-1,),))
    (like,) = forms_hold(replace(found, linearisation=lin), nameless, [list(found.accepted)])
    odds = (1.0 - nameless) * prior.ONLY_ALIKE + nameless * prior.PART_OF_IT
    size = float(np.abs(lin.departure[lin.free + np.array(lin.indices(list(found.accepted)))])[0])
    assert like.itself == pytest.approx(1.0 / (1.0 + odds * prior.beyond_usual(size)))


def test_the_size_of_a_name_is_that_of_its_terms_together() -> None:
    """The root mean square over all their coefficients: two of five times the usual size, or one alone."""
    _, found = held_case(PLAY, SCALE)
    lin, name = found.linearisation, list(found.accepted)
    departure = lin.departure.copy()
    for sizes in ((5.0, 5.0), (7.0, 1.0)):
        departure[lin.free + np.array(lin.indices(name))] = sizes
        grown = replace(found, linearisation=replace(lin, departure=departure, bent=((-1,),)))
        (like,) = forms_hold(grown, 0.0, [name])
        assert like.itself == pytest.approx(1.0 / (1.0 + 0.3 * 25.0))


def test_modulated_signals_are_weighed_as_readings_written_out() -> None:
    """Columns of the signal times the polynomials of each joint but its own, at the noise that suits each best.

    Off by a share s, a source's polynomials carry s of the signal in all rows together.
    """
    case, found = held_case(PLAY, SCALE)
    name = [i for i in found.accepted if found.catalogue.cause(i).effect == "actuator-scale"]
    lin, slab, mode = found.linearisation, found.problem.spike_slab, found.mode
    (like,) = forms_hold(found, 0.0, [name])
    fit, recording = found.fit, case.signatures.recording
    rows = columns_at(found.signatures, fit)
    j, g, r = rows[:, : lin.free], rows[:, lin.free : -1], rows[:, -1]
    e = np.column_stack([j, g]) @ lin.departure[: lin.free + g.shape[1]] - r
    columns, sizes = slab.columns(mode.members)
    tolerances = 1.0 / lin.weight
    widening = dict(zip(found.problem.classes, slab.unknowns.widening[mode.point.widening], strict=True))
    known = j * tolerances * [widening[part] for part in lin.parts]
    bends = polynomials(recording.q, fit.used)
    total = np.sqrt(np.mean(np.sum(np.hstack(bends) ** 2, axis=1)))

    def signal(candidate: int) -> Array:
        at = lin.indices([candidate])
        return np.asarray(g[:, at] @ lin.departure[lin.free + np.array(at)])

    # what the fit's effects err by anyway: a tenth of each signal, along all sources together
    tenth = prior.FORM_ERROR / total
    errors = np.hstack(
        [tenth * np.repeat(bend, 3, axis=0) * signal(i)[:, None] for i in found.accepted for bend in bends]
    )
    always = known @ known.T + (g[:, columns] * sizes**2) @ g[:, columns].T + errors @ errors.T
    assert slab.unknowns.size.values[mode.point.remainder] == 0.0

    def density(more: Array, point: GridPoint) -> float:
        noise = float(slab.unknowns.scales(point)[0])
        spread = noise**2 * np.eye(len(e)) + always + more @ more.T
        own = -0.5 * (np.linalg.slogdet(spread)[1] + e @ np.linalg.solve(spread, e))
        return float(own + slab.unknowns.log_prior(point))

    points = [mode.point.louder(step) for step in (0, -2, -4, -8)]
    (other,) = (k for k, joint in enumerate(recording.joints) if joint != "q1")
    bend = np.repeat(bends[other], 3, axis=0) * signal(name[0])[:, None] * np.sqrt(len(bends)) / total
    plain, *bent = (max(density(share * bend, point) for point in points) for share in (0.0, *prior.OFF_FORM))
    size = float(np.abs(lin.departure[lin.free + np.array(lin.indices(name))])[0])
    expected = rivals.held_probability(np.array([bent]) - plain, prior.ONLY_ALIKE * prior.beyond_usual(size))
    # directions of errors of form that say next to nothing are left out
    assert logit(like.itself) == pytest.approx(logit(expected), abs=0.02)
    assert like.tested


def polynomials(q: Array, used: NDArray[np.bool_]) -> list[Array]:
    """(n, 2) the first two Chebyshev polynomials of each joint over what was seen."""
    t = 2.0 * (q - q[used].min(axis=0)) / np.ptp(q[used], axis=0) - 1.0
    return [np.column_stack([own, 2.0 * own**2 - 1.0]) for own in t.T]


def test_the_more_a_formula_is_bent_the_less_its_name_holds() -> None:
    """A mild bend is what formulas err by anyway; one that carries half of the signal speaks for another thing."""
    nothing = np.full((12, 3), -3.0)
    said = [rivals.held_probability(nothing, 0.5, bent) for bent in (0.0, 0.1, 0.2, 0.4, 0.8)]
    assert said[0] > 0.9 and said[1] > 0.9
    assert all(more > less for more, less in pairwise(said[1:]))
    assert said[3] < 0.5
