"""Laws of findings: what one of several terms says, rivals and twins, maps and lists, the form of what is left."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from support.effects import with_effect
from truepose.identification.diagnosis.findings import (
    best_shape,
    evidence_map,
    finding,
    ranked_alternatives,
    remainder_of_residuals,
)
from truepose.identification.diagnosis.posterior_summary import Named, Rival
from truepose.identification.diagnosis.result import UNNAMED, Alarm, Form, Replication
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import EffectAtPlace


@pytest.fixture(scope="module")
def cat(arm: Machine) -> Catalogue:
    """Two settings of a shift of q2's zero, the same shift of q3, and a compliance of q2."""
    shifts = [
        with_effect(arm, "zero-shift", (j,), {"session": s})
        for j, s in (("q2", 1.0), ("q2", 2.0), ("q3", 1.0))
    ]
    return Catalogue((*shifts, with_effect(arm, "joint-compliance", ("q2",))), (-2.0,) * 4, ())


# -- findings --------------------------------------------------------------------------------------------


def fitted(cat: Catalogue, std: float = 0.1) -> Estimate:
    names = [name for c in cat.candidates for name in c.parameter_names]
    p = np.arange(1.0, len(names) + 1.0)
    return cast(
        Estimate,
        SimpleNamespace(prior=SimpleNamespace(names=names), p=p, std=np.full(len(names), std), effects=()),
    )


RIVALS = (
    Rival(EffectAtPlace("zero-shift", ("q3",)), 0.2, 14.0),
    Rival(EffectAtPlace("joint-compliance", ("q2",)), 0.15, 13.0),
    Rival(EffectAtPlace("empirical", ("q2",)), 0.05, 12.0),
)


def test_terms_of_one_cause_are_one_finding(arm: Machine, cat: Catalogue) -> None:
    """With the amplitudes of all its candidates; what the posterior says of it is said as it is."""
    one = Named(EffectAtPlace("zero-shift", ("q2",)), (0, 1), 0.6, 0.95, RIVALS, 30.0)
    half = Replication((0.9, 0.8), agree=True)
    found = finding(arm, cat, fitted(cat), one, 8.0, half)
    assert (found.effect, found.place, found.log_bayes_factor) == ("zero-shift", ("q2",), 30.0)
    assert (found.flip_lambda, found.prior_dependent, found.replication) == (8.0, True, half)
    assert found.settings == ({"session": 1.0}, {"session": 2.0})
    assert sorted((q.value, q.std) for q in found.parameters.values()) == [(1.0, 0.1), (2.0, 0.1)]
    assert found.certainty == 0.95 and found.family == ""
    free = finding(arm, cat, fitted(cat), one, None, None)
    assert free.flip_lambda is None and not free.prior_dependent and free.replication is None


def test_rivals_stand_beside_a_finding_with_their_shares_and_what_has_no_name_as_such(
    arm: Machine, cat: Catalogue
) -> None:
    one = Named(EffectAtPlace("zero-shift", ("q2",)), (0,), 0.6, 0.95, RIVALS, 30.0)
    found = finding(arm, cat, fitted(cat), one, None, None)
    told = [(o.effect, o.place, o.log_bayes_factor) for o in found.equivalents if o.log_bayes_factor < 30.0]
    assert told == [
        ("zero-shift", ("q3",), 14.0),
        ("joint-compliance", ("q2",), 13.0),
        (UNNAMED, ("q2",), 12.0),
    ]
    assert found.equivalents[-1].nameless and not found.equivalents[0].nameless
    assert [o.probability for o in found.equivalents] == sorted(
        (o.probability for o in found.equivalents), reverse=True
    )
    # what is the same function shares the probability of the name: nothing is added or lost
    total = found.probability + sum(o.probability for o in found.equivalents)
    assert total == pytest.approx(0.6 + sum(m.probability for m in RIVALS))


def test_twins_share_a_name_by_how_likely_they_are(arm: Machine) -> None:
    """A series of waves a turn may come from the gear or from the encoder: no reading tells."""
    wave = with_effect(arm, "transmission-error", ("q1",), {"orders": 3.0})
    likely = wave.twins
    assert likely
    cat = Catalogue((wave,), (-2.0,), ())
    one = Named(
        EffectAtPlace("transmission-error", ("q1",)), (0,), 0.8, 0.8, (), 30.0, family="transmission-error"
    )
    found = finding(arm, cat, fitted(cat), one, None, None)
    assert {o.effect for o in found.equivalents} == set(likely)
    for other in found.equivalents:
        assert other.probability / found.probability == pytest.approx(likely[other.effect])
    assert found.probability + sum(o.probability for o in found.equivalents) == pytest.approx(0.8)
    assert found.family == "transmission-error"


def test_the_map_has_the_best_of_each_part_and_the_list_everything(cat: Catalogue) -> None:
    """What was not weighed is in neither."""
    gain = np.array([3.0, 9.0, 5.0, -4.0])
    assert list(evidence_map(cat, gain).items()) == [("q2", 9.0), ("q3", 5.0)]
    found = ranked_alternatives(cat, gain)
    assert [o.log_bayes_factor for o in found] == [9.0, 5.0, 3.0, -4.0]
    odds = np.exp(np.array([9.0, 5.0, 3.0, -4.0]) - 2.0)
    np.testing.assert_allclose([o.probability for o in found], odds / (1.0 + odds.sum()))
    gain[2] = -np.inf
    assert list(evidence_map(cat, gain)) == ["q2"] and len(ranked_alternatives(cat, gain)) == 3


# -- the form of what is left ----------------------------------------------------------------------------


@pytest.mark.parametrize("scale", [1.0, 40.0])
@pytest.mark.parametrize("kind", ["linear", "quadratic", 1, 2, 3, 4, 6, 8])
def test_the_form_is_the_simplest_that_says_it(kind: str | int, scale: float) -> None:
    """In any unit of the driver, from any zero; a shape of more functions must be worth them."""
    rng, n = np.random.default_rng(6), 300
    t = np.sort(rng.uniform(-1.0, 1.0, n))
    t[[0, -1]] = -1.0, 1.0
    shapes = {"linear": 3.0 * t, "quadratic": 3.0 * t**2}
    shape = shapes[kind] if isinstance(kind, str) else 2.0 * np.cos(np.pi * kind * t + 0.3)
    residual = 0.3 * rng.standard_normal((n, 3))
    residual[:, 0] += shape
    expected = (kind, 0) if isinstance(kind, str) else ("periodic", kind)
    assert best_shape(residual, scale * t + 70.0) == expected


def test_few_values_are_steps() -> None:
    rng = np.random.default_rng(7)
    for count, kind in ((1, "steps"), (2, "steps"), (3, "steps"), (4, "linear")):
        values = np.arange(240.0) % count
        residual = (values - values.mean())[:, None] + 0.1 * rng.standard_normal((240, 1))
        assert best_shape(residual, values)[0] == kind


def test_a_further_function_must_be_worth_two_units_of_noise_a_channel() -> None:
    """Of straight lines in noise so many are called parabolas as exceed 4 in chi-square of two channels: one in seven."""
    rng, t = np.random.default_rng(8), np.linspace(-1.0, 1.0, 120)
    kinds = [best_shape(10.0 * t[:, None] + rng.standard_normal((120, 2)), t)[0] for _ in range(200)]
    assert set(kinds) == {"linear", "quadratic"}
    assert kinds.count("quadratic") / 200 == pytest.approx(
        np.exp(-2.0), abs=3.0 * np.sqrt(0.135 * 0.865 / 200)
    )


# -- what an explanation says ------------------------------------------------------------------------------------


def test_a_rival_states_its_driver_and_what_would_separate_it(arm: Machine, cat: Catalogue) -> None:
    rivals = (*RIVALS, Rival(EffectAtPlace("joint-compliance", ("q9",)), 0.01, 1.0, tested=False))
    one = Named(EffectAtPlace("zero-shift", ("q2",)), (0,), 0.6, 0.95, rivals, 30.0)
    found = finding(arm, cat, fitted(cat), one, None, None)
    told = {(o.effect, o.place): o for o in found.equivalents}
    soft, unknown = told["joint-compliance", ("q2",)], told[UNNAMED, ("q2",)]
    assert (soft.kind, soft.tested) == ("load", True) and soft.experiment
    assert (unknown.kind, unknown.experiment) == (None, "")
    elsewhere = told["joint-compliance", ("q9",)]
    assert (elsewhere.kind, elsewhere.tested) == (None, False)
    assert found.experiment == cat.candidates[0].effect.experiment


@pytest.mark.parametrize(
    ("about", "place"),
    [("q2", ("q2",)), ("temperature.q2", ("q2",)), ("approach.q2", ("q2",)), ("payload", ()), ("order", ())],
)
def test_what_is_left_is_placed_where_its_driver_is(about: str, place: tuple[str, ...]) -> None:
    rng, n = np.random.default_rng(9), 60
    t = np.linspace(-1.0, 1.0, n)
    recording = cast(
        Recording,
        SimpleNamespace(
            joints=("q1", "q2"),
            columns=lambda: (
                dict.fromkeys(("q1", "q2", "temperature.q2", "payload"), t) | {"approach.q2": np.sign(t)}
            ),
        ),
    )
    residual = 3.0 * t[:, None] + 0.1 * rng.standard_normal((n, 2))
    fit = cast(Estimate, SimpleNamespace(residual=residual, used=np.arange(n) > 0, chi2_per_dof=6.25))
    found = remainder_of_residuals(fit, recording, Alarm(9.0, 1e-9, about, 0.4))
    kind = {"approach.q2": "steps", "order": "order"}.get(about, "linear")
    assert (found.place, found.driver, found.form) == (place, about, Form(kind, 0.4))
    assert found.size_sigma == 2.5 and found.gain == {}
