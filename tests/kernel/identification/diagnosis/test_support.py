"""A name needs a fit that determines it, and a law both halves of the rows."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from support.searched_arm import PLAY, SCALE, searched
from truepose.identification.diagnosis.naming import (
    UNREPLICATED,
    Summary,
    cap_law,
    keep_supported,
    summarised,
)
from truepose.identification.diagnosis.proof import replications
from truepose.identification.diagnosis.result import Replication
from truepose.identification.diagnosis.search import Found


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
    assert (
        kept.summary.inclusion.of(next(n.cause for n in summary.names if n.cause.effect == "backlash")) == 0.0
    )


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
