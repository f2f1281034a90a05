"""Turning points of a mirror: what counts as one, and how well a motion must fit before anything is concluded."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from support.studies import study_module
from truepose.identification.fringes.count import count_fringes
from truepose.identification.fringes.levels import Noise
from truepose.identification.fringes.turns import Verdict, Visit, judge
from truepose.models.fabry_perot import coupling, fringe

Array = NDArray[np.float64]
FIBRE = (0.04, 0.9)
SAMPLES, SIGMA = 160, 0.01
signals = study_module("fringe_signal")


def visit(path: Array, high: bool, excess: float, seed: int) -> Visit:
    """Light on a ``path`` (n,) of phases from the end of a fringe, its noise ``excess`` times the stated one."""
    g = coupling(FIBRE)
    noise = np.random.default_rng(seed).standard_normal(len(path))
    noise *= excess * SIGMA / np.sqrt(np.mean(noise**2))  # chi2 is what is asked for
    v = fringe(np.cos(path + np.pi * high), g) + noise
    n = len(path)
    return Visit(
        np.linspace(0.0, 1.0, n),
        v,
        Noise(SIGMA, 0.0),
        high,
        g,
        1e-3,
        np.zeros(n, dtype=np.intp),
        np.ones(n, dtype=bool),
        np.full(n, high),
    )


U = np.linspace(-1.0, 1.0, SAMPLES)
PASSES, TURNS = 1.2 * U, -0.4 - 0.8 * U**2  # phases from the end, rad


@pytest.mark.parametrize("high", [True, False])
@pytest.mark.parametrize(("path", "sign"), [(PASSES, 1.0), (TURNS, -1.0)], ids=["passes", "turns"])
def test_a_motion_fits_within_four_sigma_of_chi2(path: Array, sign: float, high: bool) -> None:
    """chi2 of n readings scatters by sqrt(2 n): the noise may be larger than stated by so much, and no more."""
    most = 1.0 + 4.0 * np.sqrt(2.0 / SAMPLES)
    for seed in range(3):
        found = judge(visit(path, high, np.sqrt(most - 0.15), seed))
        assert found.fits and sign * found.odds > 0.0
        lost = judge(visit(path, high, np.sqrt(most + 0.15), seed))
        assert not lost.fits and lost.odds == 0.0 and not lost.passed


def test_a_passage_is_certain_at_five_sigma() -> None:
    for sigmas, certain in ((4.9, False), (5.1, True)):
        assert Verdict(sigmas**2, True, 1.0, 0.01).passed is certain
        assert not Verdict(-(sigmas**2), True, 1.0, 0.01).passed


@pytest.mark.parametrize(
    ("start", "stop", "back"), [(0.05, 3.3, False), (0.05, 3.3, True), (0.2, 3.4, False), (0.1, 3.2, False)]
)
def test_a_mirror_that_rests_before_the_end_of_a_fringe_does_not_turn_there(
    start: float, stop: float, back: bool
) -> None:
    """Turning points are those between the rests, wherever (in fringes) the mirror rests."""
    t = np.arange(0.0, 1.4, 2e-3)
    way = (stop - start) * signals.WAVELENGTH / 2.0
    moves = [(way, 0.0, 0.4), *([(-way, 0.6, 0.4)] if back else [])]
    path = start * signals.WAVELENGTH / 2.0 + signals.displacement(t, 0.2, moves)
    run = signals.run(t, path, signals.Detector(), np.random.default_rng(7), 0.78)
    count = count_fringes(run.t, run.signal, FIBRE)
    assert not count.faults
    assert count.turns == int(back)
    assert abs(count.phase) * signals.WAVELENGTH / (4.0 * np.pi) == pytest.approx(abs(run.change), abs=5e-6)
