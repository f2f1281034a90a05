"""Bounds of whole states: each state counts by the signs of all that it holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.linear_problems import SIZES, catalogue_problem, single, spike_slab
from truepose.identification.posterior.design import GridPoint, Terms
from truepose.identification.posterior.spike_slab import SpikeSlab

TERMS = 6


def test_signs_count_for_a_whole_state() -> None:
    """One that holds a coefficient of the wrong sign is as much less probable as its slot would have it."""
    free = spike_slab(catalogue_problem(1))
    size = int(np.flatnonzero(free.noticeable[:, 0])[0])
    members, point = ((0, size),), GridPoint((0,), 0, 0)
    mean, covariance = free.root(point).posterior(*free.columns(members))
    sign = float(np.sign(mean[0]))

    def signed(direction: float) -> float:
        dense = catalogue_problem(1)
        if direction < 0:
            column = dense.design.n
            grams = []
            for gram in dense.design.grams:
                turned = gram.copy()
                turned[column] *= -1.0
                turned[:, column] *= -1.0
                grams.append(turned)
            design = replace(dense.design, grams=tuple(grams))
        else:
            design = dense.design
        terms = Terms(
            [
                replace(t, lower=(0.0,), upper=(np.inf,)) if k == 0 else t
                for k, t in enumerate(single(*[1] * TERMS).all)
            ],
            single(*[1] * TERMS).urn,
        )
        return SpikeSlab(design, dense.unknowns, terms, SIZES).log_bounds(point, members)

    right, wrong = signed(sign), signed(-sign)
    assert right > wrong and right <= np.log(2.0) + 1e-9
    assert np.exp(right) + np.exp(wrong) == pytest.approx(2.0)  # 2 P(c > 0) and 2 P(c < 0)
    assert free.log_bounds(point, members) == free.log_bounds(point, ()) == 0.0
    assert covariance[0, 0] > 0.0
