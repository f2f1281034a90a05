"""Laws of classes and findings: which explanations are one, what a finding of several terms says, maps and lists."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray
from truepose.identification.diagnosis.classes import (
    INDISTINCT,
    Member,
    Named,
    _credible,
    _indistinct,
    _settings_doubt,
    _tempered,
)
from truepose.identification.diagnosis.effect_evidence import Evidence
from truepose.identification.diagnosis.effect_selection import Ranking

from support.effect_machines import read_machines
from support.effects import with_effect
from truepose.identification.diagnosis.candidates import Catalogue
from truepose.identification.diagnosis.findings import evidence_map, merge_findings, ranked_alternatives
from truepose.identification.diagnosis.remainder import _form
from truepose.identification.fit.estimate import Estimate
from truepose.models.machine import Machine

Array = NDArray[np.float64]


def ranking(
    odds: Array | list[float], gain: list[float] | None = None, sizes: Array | None = None
) -> Ranking:
    """Candidates of one coefficient each, of these log odds; gains are the same unless said."""
    n = len(odds)
    amplitude = tuple(np.array([v]) for v in (np.zeros(n) if sizes is None else sizes))
    gains = np.array(odds if gain is None else gain, dtype=float)
    std = tuple(np.ones(1) for _ in range(n))
    found = Evidence(0.0, gains, amplitude, std, np.ones(n), 1.0, (1.0,), np.ones(n))
    return Ranking(tuple(range(n)), np.array(odds, dtype=float), gains, found)


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    folder: Path = tmp_path_factory.getbasetemp() / "findings_laws"
    return read_machines(folder)["arm"]


@pytest.fixture(scope="module")
def cat(arm: Machine) -> Catalogue:
    """Two settings of a shift of q2's zero, the same shift of q3, and a compliance of q2."""
    shifts = [
        with_effect(arm, "zero-shift", (j,), {"session": s})
        for j, s in (("q2", 1.0), ("q2", 2.0), ("q3", 1.0))
    ]
    return Catalogue((*shifts, with_effect(arm, "joint-compliance", ("q2",))), (-2.0,) * 4, ())


# -- classes ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("missed", "gains", "one"),
    [
        (0.0, (40.0, 39.0), True),  # says the same, and data prefer neither
        (49.0, (40.0, 39.0), True),  # says more than half
        (51.0, (40.0, 39.0), False),  # says less than half of it
        (49.0, (40.0, 36.0), False),  # data prefer one by more than 3
        (49.0, (40.0, 44.0), False),
        (49.0, (5.5, 2.6), False),  # worth less than half as much
        (49.0, (5.0, 2.6), True),
        (0.0, (40.0, 32.0), True),  # says exactly the same: what tells them apart is not the signature
        (0.0, (40.0, 30.5), False),
        (0.0, (-3.0, -4.0), False),  # worth nothing
    ],
)
def test_explanations_are_one_where_they_say_the_same_and_data_prefer_neither(
    missed: float, gains: tuple[float, float], one: bool
) -> None:
    weighed = ranking(list(gains))
    assert _indistinct(weighed, 100.0, np.array([0.0, missed]), 0, 1, INDISTINCT) is one
    wider = _indistinct(weighed, 100.0, np.array([0.0, missed]), 0, 1, 3.0 * INDISTINCT)
    assert wider >= one


def test_a_class_grows_by_the_likeliest_until_it_is_certain(cat: Catalogue) -> None:
    """Shares of those that say much the same, and of nothing more at all; 0.95 is enough."""
    odds = np.log([60.0, 20.0, 16.0, 3.0])
    weighed = ranking(odds)
    for rivals, expected in (([], [1, 2]), ([3], [3, 1, 2])):
        members, certainty = _credible(cat, weighed, 0, rivals, [0, 1, 2, 3])
        assert members == expected
        assert certainty == pytest.approx(sum(np.exp(odds[[0, *expected]])) / 100.0)
    alone, certainty = _credible(cat, weighed, 0, [], [0])
    assert alone == [] and certainty == pytest.approx(60.0 / 61.0)


def test_shares_are_tempered_between_causes_and_not_between_settings(cat: Catalogue) -> None:
    weighed = ranking(np.log([8.0, 1.0, 3.0, 4.0]))
    for power in (1.0, 0.5):
        share = _tempered(cat, weighed, [0, 1, 2, 3], power)
        causes = np.array([9.0, 3.0, 4.0]) ** power
        expected = np.append(causes[0] * np.array([8.0, 1.0]) / 9.0, causes[1:]) / causes.sum()
        np.testing.assert_allclose(share, expected)


def test_settings_that_data_do_not_choose_are_a_doubt_of_the_coefficients(cat: Catalogue) -> None:
    """Rms distance by the odds of the settings, in the coefficient's unit; of another place, or of a series, none."""
    weighed = ranking(np.log([3.0, 1.0, 50.0, 50.0]), sizes=np.array([1.0, 3.0, 9.0, 9.0]))
    (coefficient,) = cat.candidates[0].coefficients
    summed = cat.candidates[0].effect.settings_add
    expected = 0.0 if summed else np.sqrt(0.25 * 2.0**2) * coefficient.scale
    assert list(_settings_doubt(cat, weighed, 0)) == pytest.approx([expected])
    assert _settings_doubt(cat, weighed, 2) == _settings_doubt(cat, weighed, 3) == (0.0,)


# -- findings --------------------------------------------------------------------------------------------


def fitted(cat: Catalogue, std: float = 0.1) -> Estimate:
    names = [name for c in cat.candidates for name in c.parameter_names]
    p = np.arange(1.0, len(names) + 1.0)
    return cast(
        Estimate, SimpleNamespace(prior=SimpleNamespace(names=names), p=p, std=np.full(len(names), std))
    )


def named(index: int, gain: float, members: tuple[Member, ...] = (), certainty: float = 0.9) -> Named:
    return Named(index, 0.6, certainty, gain, members, (0.0,))


def test_terms_of_one_cause_are_one_finding(arm: Machine, cat: Catalogue) -> None:
    """Gains add up; it goes when tolerances are wide enough for all its terms, and not before."""
    terms = [named(0, 20.0), named(2, 50.0), named(1, 10.0)]
    other, both = merge_findings(arm, cat, fitted(cat), terms, [3.0, None, 8.0])
    assert (both.effect, both.place, both.log_bayes_factor) == ("zero-shift", ("q2",), 30.0)
    assert (both.flip_lambda, both.prior_dependent) == (8.0, True)
    assert (other.place, other.flip_lambda, other.prior_dependent) == (("q3",), None, False)
    assert both.settings == ({"session": 1.0}, {"session": 2.0})
    assert sorted(q.value for q in both.parameters.values()) == [1.0, 2.0]
    (kept,) = merge_findings(arm, cat, fitted(cat), terms[::2], [3.0, None])
    assert kept.flip_lambda is None and not kept.prior_dependent
    single = merge_findings(arm, cat, fitted(cat), [replace(terms[0], doubt=(0.24,))], [None])[0]
    assert [q.std for q in single.parameters.values()] == [pytest.approx(0.26)]  # root of 0.1^2 + 0.24^2


def test_rivals_of_a_finding_add_up_over_settings_and_share_its_certainty(
    arm: Machine, cat: Catalogue
) -> None:
    rivals = (Member(2, 0.1, 15.0), Member(3, 0.1, 12.0), Member(1, 0.05, 11.0))
    first, second = named(0, 20.0, rivals), named(1, 10.0, (Member(3, 0.15, 14.0),))
    (found,) = merge_findings(arm, cat, fitted(cat), [first, second], [None, None])
    others = {
        (o.effect, o.place): o for o in found.equivalents if o.effect in ("zero-shift", "joint-compliance")
    }
    assert set(others) == {("zero-shift", ("q3",)), ("joint-compliance", ("q2",))}
    soft, shift = others["joint-compliance", ("q2",)], others["zero-shift", ("q3",)]
    assert soft.probability == pytest.approx(2.5 * shift.probability) and soft.log_bayes_factor == 14.0
    assert [o.probability for o in found.equivalents] == sorted(
        (o.probability for o in found.equivalents), reverse=True
    )
    assert found.certainty == 0.9
    assert found.probability + sum(o.probability for o in found.equivalents) == pytest.approx(0.9)
    assert found.probability > soft.probability


def test_the_map_has_the_best_of_each_part_and_the_list_everything(cat: Catalogue) -> None:
    weighed = ranking([2.0, 7.0, 4.0, -5.0], gain=[3.0, 9.0, 5.0, -4.0])
    assert list(evidence_map(cat, weighed).items()) == [("q2", 9.0), ("q3", 5.0)]
    found = ranked_alternatives(cat, weighed)
    assert [o.log_bayes_factor for o in found] == [9.0, 5.0, 3.0, -4.0]
    odds = np.exp([7.0, 4.0, 2.0, -5.0])
    np.testing.assert_allclose([o.probability for o in found], odds / (1.0 + odds.sum()))


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
    assert _form(residual, scale * t + 70.0) == expected


def test_few_values_are_steps() -> None:
    rng = np.random.default_rng(7)
    for count, kind in ((1, "steps"), (2, "steps"), (3, "steps"), (4, "linear")):
        values = np.arange(240.0) % count
        residual = (values - values.mean())[:, None] + 0.1 * rng.standard_normal((240, 1))
        assert _form(residual, values)[0] == kind


def test_a_further_function_must_be_worth_two_units_of_noise_a_channel() -> None:
    """Of straight lines in noise so many are called parabolas as exceed 4 in chi-square of two channels: one in seven."""
    rng, t = np.random.default_rng(8), np.linspace(-1.0, 1.0, 120)
    kinds = [_form(10.0 * t[:, None] + rng.standard_normal((120, 2)), t)[0] for _ in range(200)]
    assert set(kinds) == {"linear", "quadratic"}
    assert kinds.count("quadratic") / 200 == pytest.approx(
        np.exp(-2.0), abs=3.0 * np.sqrt(0.135 * 0.865 / 200)
    )
