"""Laws of how a linearisation becomes a posterior's problem: evidence, families, errors of form, the remainder, units."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from support.effect_machines import read_machines
from support.effects import with_effect
from support.linear_models import ANGLE, LENGTH, READINGS, catalogue_of, linear, shifts_of, unit
from support.sensor_bench import Bench
from truepose.identification.diagnosis import prior
from truepose.identification.diagnosis.alone import WIDENINGS, flip_inflation, weighed_alone
from truepose.identification.diagnosis.families import FEWEST, LARGEST, families
from truepose.identification.diagnosis.model import FEW, WORTH, remainder_shapes
from truepose.identification.diagnosis.naming import Named
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.weighed import Cause, Weighed, weighed
from truepose.identification.fit.estimate import estimate
from truepose.identification.posterior.mode import State, slot_odds
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue
from truepose.identification.signatures.empirical_forms import empirical_forms
from truepose.identification.signatures.forms import ERROR, Forms
from truepose.identification.signatures.linearisation import Linearisation, Signatures
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine import Machine

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    folder: Path = tmp_path_factory.getbasetemp() / "weighed_laws"
    return read_machines(folder)["arm"]


@pytest.fixture(scope="module")
def shifts(arm: Machine) -> tuple[PlacedEffect, ...]:
    return shifts_of(arm)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Machine, Recording]:
    bench = Bench(tmp_path_factory.mktemp("bench"), "arm")
    return bench.machine, bench.recording()


# -- evidence -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("departure", [0.0, 1.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_evidence_is_that_of_readings_at_the_drawing_wherever_the_fit_stands(
    shifts: tuple[PlacedEffect, ...], departure: float, seed: int
) -> None:
    lin, j, g, e = linear(shifts[:3], seed, sizes=(0.3,), departure=departure)
    problem = weighed(lin, catalogue_of(shifts[:3]), 1.5)
    weighing = problem.weighing

    def dense(point: tuple[int, int, int], size: float) -> float:
        noise = weighing.unknowns.noise[0].values[point[0]]
        wide = dict(zip(problem.classes, weighing.unknowns.widening[point[1]], strict=True))
        spread = j * np.array([wide[c] for c in lin.parts])
        v = noise**2 * np.eye(READINGS) + spread @ spread.T + size**2 * np.outer(g[:, 0], g[:, 0])
        return float(multivariate_normal.logpdf(e, cov=v))

    at = unit(problem)
    for point in (at, (at[0] + 3, 1, 0)):
        term = problem.candidates.index((0,))
        odds = weighing.log_odds(point, ())[:, term] - weighing.terms.log_prior(())[term]
        for s, size in enumerate(weighing.sizes.values):
            if not weighing.noticeable[s, term]:
                assert odds[s] == -np.inf
                continue
            expected = dense(point, float(size)) - dense(point, 0.0) + weighing.sizes.log_prior[s]
            assert odds[s] == pytest.approx(expected, abs=1e-5)
    first, other = (
        (weighing.log_evidence(p, ()) - weighing.unknowns.log_prior(p)) for p in (at, (at[0] + 3, 1, 0))
    )
    assert first - other == pytest.approx(dense(at, 0.0) - dense((at[0] + 3, 1, 0), 0.0), abs=1e-5)


def test_units_of_parameters_and_coefficients_are_nothing(shifts: tuple[PlacedEffect, ...]) -> None:
    """Scales of J go with its tolerances, and the order of rows is not in a Gram matrix."""
    lin, *_ = linear(shifts[:3], 4, sizes=(0.5,), departure=1.0)
    factor = np.array([1e3, 1e-3, 7.0])
    scale = np.concatenate([factor, np.ones(4)])
    other = replace(
        lin,
        grams=(lin.gram * scale[:, None] * scale,),
        departure=lin.departure / scale[:-1],
        weight=lin.weight * factor,
    )
    one, two = (weighed_alone(weighed(own, catalogue_of(shifts[:3]), 1.5), 3) for own in (lin, other))
    np.testing.assert_allclose(two, one, atol=1e-6)


@pytest.mark.parametrize("away", [0.0, 1e3, -1e6])
def test_a_wrong_constant_where_nothing_is_known_is_never_likely(arm: Machine, away: float) -> None:
    """A frame without a tolerance may be anywhere: a constant of it that is wrong says nothing more, however far it is."""
    wrong = with_effect(arm, "wrong-constant", ("tool.x",))
    shift = with_effect(arm, "zero-shift", ("q2",), {"session": 1.0})
    rng = np.random.default_rng(5)
    j = rng.standard_normal((READINGS, 3))
    g = np.column_stack([50.0 * j[:, 2], rng.standard_normal(READINGS)])
    e = rng.standard_normal(READINGS) + away * j[:, 2]
    rows = np.column_stack([j, g, -e])
    lin = Linearisation(
        (rows.T @ rows,), (READINGS,), 3, (slice(0, 1), slice(1, 2)), 0, np.zeros(5), np.array([1.0, 1.0, 0.0]),
        (LENGTH, LENGTH, ANGLE), (wrong, shift),
    )  # fmt: skip
    alone = weighed_alone(weighed(lin, catalogue_of((wrong, shift)), 1.5), 2)
    assert alone[0] == pytest.approx(0.0, abs=1e-6)  # neither for nor against
    known = replace(lin, weight=np.ones(3))
    assert weighed_alone(weighed(known, catalogue_of((wrong, shift)), 1.5), 2)[0] < 0.0 or away != 0.0


def test_prior_shares_of_all_terms_add_up_to_one(shifts: tuple[PlacedEffect, ...]) -> None:
    """Single places and families; what the fit leaves out as impossible gives its share to the others."""
    lin, *_ = linear(shifts)
    for impossible in ((), (3,), (1,)):
        terms = weighed(lin, catalogue_of(shifts), 1.5, impossible).weighing.terms
        assert np.logaddexp.reduce([t.log_prior for t in terms.all]) == pytest.approx(0.0, abs=1e-9)


# -- families -------------------------------------------------------------------------------------------------


def test_a_family_is_three_like_effects_at_single_places(arm: Machine) -> None:
    own = [
        with_effect(arm, "zero-shift", (q,), {"session": s}) for s in (1.0, 2.0) for q in ("q1", "q2", "q3")
    ]
    pair = with_effect(arm, "zero-shift", ("q1", "q2"), {"session": 1.0})
    constants = [with_effect(arm, "wrong-constant", (f"q{k}.theta",)) for k in (1, 2, 3)]
    every = [*own, pair, *constants]
    assert families(every, range(len(every))) == ((0, 1, 2), (3, 4, 5))
    assert families(every, [0, 1, 3, 4, 5]) == ((3, 4, 5),)  # two are no family
    assert FEWEST == 3
    many = [replace(c, coefficients=c.coefficients * (LARGEST // 3 + 1)) for c in own[:3]]
    assert families(many, range(3)) == ()


def test_what_gives_way_under_weight_is_a_family_too(arm: Machine) -> None:
    """Joints, links and mounts at once, with each choice of settings that bends no formula."""
    joints = [with_effect(arm, "joint-compliance", (q,)) for q in ("q1", "q2", "q3")]
    bent = [with_effect(arm, "joint-compliance", (q,), {"bend": 2.0}) for q in ("q1", "q2", "q3")]
    sag = with_effect(arm, "gravity-sag", ("base",))
    every = [*joints, *bent, sag, with_effect(arm, "backlash", ("q1",))]
    assert families(every, range(len(every))) == ((0, 1, 2), (3, 4, 5), (0, 1, 2, 6))
    assert families(every, [0, 6]) == ()  # two are no family


def test_a_family_of_a_kin_says_each_effect_at_its_own_places(arm: Machine) -> None:
    joints = [with_effect(arm, "joint-compliance", (q,)) for q in ("q1", "q2", "q3")]
    placed = (*joints, with_effect(arm, "gravity-sag", ("base",)))
    lin, *_ = linear(placed)
    problem = weighed(lin, catalogue_of(placed), 1.5)
    terms = problem.weighing.terms
    cause = problem.causes[int(terms.cause[problem.candidates.index((0, 1, 2, 3))])]
    assert cause.effect == "deflection" and cause.family
    assert cause.singles == (*(Cause("joint-compliance", (q,)) for q in ("q1", "q2", "q3")),
                             Cause("gravity-sag", ("base",)))  # fmt: skip
    assert cause.told == (
        Cause("joint-compliance", ("q1", "q2", "q3"), family=True),
        Cause("gravity-sag", ("base",), family=True),
    )
    assert cause.has("joint-compliance", ("q2",)) and not cause.has("gravity-sag", ("q2",))
    assert np.logaddexp.reduce([t.log_prior for t in terms.all]) == pytest.approx(0.0, abs=1e-9)


def test_a_family_is_a_term_of_all_its_columns_under_one_size(shifts: tuple[PlacedEffect, ...]) -> None:
    lin, *_ = linear(shifts)
    problem = weighed(lin, catalogue_of(shifts), 1.5)
    term = problem.candidates.index((0, 1, 2))
    terms = problem.weighing.terms
    assert terms.columns[term].tolist() == [0, 1, 2]
    assert problem.causes[int(terms.cause[term])] == Cause("zero-shift", ("q1", "q2", "q3"), family=True)
    singles = [problem.candidates.index((k,)) for k in range(3)]
    assert all(terms.excludes[term, k] for k in singles)  # a joint of the family is not there twice
    share = float(
        np.exp(terms.all[term].log_prior - np.logaddexp.reduce([terms.all[k].log_prior for k in singles]))
    )
    assert share == pytest.approx(prior.FAMILY_SHARE / (1.0 - prior.FAMILY_SHARE))


# -- errors of form ---------------------------------------------------------------------------------------------


def test_errors_of_form_are_a_tenth_of_the_signal_that_they_modulate(
    recorded: tuple[Machine, Recording],
) -> None:
    """Their 1-sigma in all the rows together, whatever the columns' number; none where nothing was fitted."""
    _, recording = recorded
    used = ~recording.validation
    rng = np.random.default_rng(7)
    amplitude = np.array([0.4, -1.1])
    forms = Forms.of(recording, used, [(np.array([0, 1]), amplitude), (np.array([3]), np.array([2.0]))])
    assert np.mean(np.sum(forms.modulations[used] ** 2, axis=1)) == pytest.approx(ERROR**2)
    assert forms.width == 2 * forms.modulations.shape[1]
    rows = np.flatnonzero(used)
    signature = rng.standard_normal((len(rows), 3, 4))
    columns = forms.columns(signature, rows)
    assert columns.shape == (len(rows), 3, forms.width)
    half = forms.width // 2
    expected = (signature[:, :, :2] @ amplitude)[:, :, None] * forms.modulations[rows][:, None, :]
    np.testing.assert_allclose(columns[:, :, :half], expected)
    np.testing.assert_allclose(
        columns[:, :, half:], 2.0 * signature[:, :, 3:] * forms.modulations[rows][:, None, :]
    )
    assert Forms.of(recording, used, []).width == 0
    assert Forms.none().columns(signature, rows).shape == (len(rows), 3, 0)


def test_what_does_not_vary_modulates_nothing(recorded: tuple[Machine, Recording]) -> None:
    """A joint at rest has no range; a driver that is not thermal, a load or the time is no reason for an error of form."""
    _, recording = recorded
    used = ~recording.validation
    signal = [(np.array([0]), np.ones(1))]
    whole = Forms.of(recording, used, signal).width
    q = recording.q.copy()
    q[:, 0] = 0.3
    assert Forms.of(replace(recording, q=q), used, signal).width == whole - 2
    n = len(recording)
    warm = {
        "temperature.air": np.linspace(20.0, 25.0, n),
        "approach.q1": np.where(np.arange(n) % 2 > 0, 1.0, -1.0),
    }
    bare = replace(recording, drivers={}, time=None)
    both = Forms.of(replace(bare, drivers=warm), used, signal).width
    assert both == Forms.of(bare, used, signal).width + 2


# -- the remainder ------------------------------------------------------------------------------------------------


def test_the_remainder_is_worth_one_sigma_of_all_readings_at_size_one(
    recorded: tuple[Machine, Recording],
) -> None:
    """All forms together, as a Gaussian in columns; directions that add next to nothing are left out."""
    machine, recording = recorded
    forms = empirical_forms(machine, recording)
    lin = Signatures(machine, recording, forms).linearise(estimate(machine, recording))
    problem = weighed(lin, Catalogue(forms, (-1.0,) * len(forms), ()), 3.0)
    at = lin.free + problem.nameless
    gram = lin.gram[np.ix_(at, at)]
    variance = np.trace(problem.remainder.T @ gram @ problem.remainder) / lin.n_observations
    assert 0.9 < variance <= 1.0 + 1e-9
    assert problem.remainder.shape[1] < len(at)
    sizes = problem.weighing.unknowns.size
    assert sizes.values[0] == 0.0 and sizes.values[-1] >= 3.0
    assert np.sum(np.exp(sizes.log_prior)) == pytest.approx(1.0)
    assert np.exp(sizes.log_prior[0]) == pytest.approx(1.0 - prior.REMAINDER)


def test_forms_that_make_the_remainder_are_carried_the_largest_first(
    recorded: tuple[Machine, Recording],
) -> None:
    """A curve of a joint that errs is the first of them; without a remainder there are none."""
    machine, recording = recorded
    forms = empirical_forms(machine, recording)
    signatures = Signatures(machine, recording, forms)
    fit = estimate(machine, recording)
    lin = signatures.linearise(fit)
    true = next(k for k, f in enumerate(forms) if f.place == ("q3",) and len(f.coefficients) == 4)
    own = lin.free + np.arange(lin.columns[true].start, lin.columns[true].stop)
    unit_size = 1.0 / np.sqrt(np.diag(lin.gram)[own] / lin.n_observations)
    step = np.zeros(len(lin.gram))
    step[own] = 8.0 * unit_size * [0.6, -1.0, 0.8, 0.5]
    change = np.eye(len(lin.gram))
    change[:, -1] -= step  # a reading larger than its prediction is a smaller residual
    bent = replace(lin, grams=tuple(change.T @ gram @ change for gram in lin.grams))
    problem = weighed(bent, Catalogue(forms, (-1.0,) * len(forms), ()), 12.0)

    def found(size: int) -> Found:
        mode = State((), (unit(problem)[0], 0, size), 0.0)
        cat = Catalogue(forms, (-1.0,) * len(forms), ())
        return cast(Found, SimpleNamespace(weighed=problem, mode=mode, linearisation=bent, catalogue=cat))

    assert remainder_shapes(found(0)) == ()
    shapes = remainder_shapes(found(len(problem.weighing.unknowns.size.values) - 1))
    assert shapes[0].candidate == true
    assert [s.share for s in shapes] == sorted((s.share for s in shapes), reverse=True)
    assert len(shapes) <= FEW and len({s.candidate for s in shapes}) == len(shapes)
    assert sum(s.share for s in shapes[:-1]) <= WORTH
    for shape in shapes:
        assert len(shape.sigma) == len(forms[shape.candidate].coefficients) and np.all(shape.sigma >= 0.0)


# -- tolerances -----------------------------------------------------------------------------------------------------


def test_a_name_falls_where_tolerances_are_wide_enough_to_stand_in_for_it(
    shifts: tuple[PlacedEffect, ...],
) -> None:
    """The widening told is the first at which the odds of the name, all else as in the mode, are below even."""
    told = []
    for size in (5.0, 12.0, 40.0, 4000.0):
        axes = np.linalg.qr(np.random.default_rng(4).standard_normal((READINGS, 3)))[0]
        along = np.cos(0.2) * axes[:, 0] + np.sin(0.2) * axes[:, 1]
        rows = np.column_stack([2.0 * axes[:, 0], 50.0 * along, -size * axes[:, 0]])
        lin = Linearisation(
            (rows.T @ rows,),
            (READINGS,),
            1,
            (slice(0, 1),),
            0,
            np.zeros(2),
            np.ones(1),
            (LENGTH,),
            shifts[:1],
        )
        problem = weighed(lin, catalogue_of(shifts[:1]), 1.5)
        values = problem.weighing.sizes.values
        state = State(((0, int(np.argmin(np.abs(np.log(values / (size / 50.0)))))),), unit(problem), 0.0)
        name = Named(problem.causes[0], (0,), 1.0, 1.0, (), 9.0)
        flip = flip_inflation(cast(Found, SimpleNamespace(weighed=problem, mode=state)), name)
        worth = [_odds(problem, state, axes[:, 0], along, size, w) for w in WIDENINGS]
        needed = [odds > 0.0 for odds in worth]
        expected = None if needed[-1] else WIDENINGS[needed.index(False)]
        assert flip == expected
        told.append(flip)
    assert len(set(told)) > 2  # the sizes tell


def _odds(problem: Weighed, state: State, part: Array, along: Array, size: float, width: float) -> float:
    """Log odds of a term along ``along`` beside a part of this tolerance, in readings of ``size`` along the part."""
    ((term, own),) = state.members
    spread = float(problem.weighing.sizes.values[own])
    noise = problem.weighing.unknowns.noise[0].values[state.point[0]]
    v = noise**2 * np.eye(READINGS) + (2.0 * width) ** 2 * np.outer(part, part)
    both = v + spread**2 * 50.0**2 * np.outer(along, along)
    gain = multivariate_normal.logpdf(size * part, cov=both) - multivariate_normal.logpdf(size * part, cov=v)
    share = problem.weighing.terms.all[term].log_prior + float(problem.weighing.sizes.log_prior[own])
    return float(gain) + share + slot_odds(prior.RICHNESS, 0)
