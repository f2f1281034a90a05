"""Turning points of a mirror: what counts as one, and how well a motion must fit before anything is concluded."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from support import fringe_signal as signals
from truepose.identification.leaves.fringes.count import count_fringes
from truepose.identification.leaves.fringes.excursions import Fault
from truepose.identification.leaves.fringes.levels import Noise
from truepose.identification.leaves.fringes.move import read_move
from truepose.identification.leaves.fringes.turns import Verdict, Visit, judge
from truepose.models.machine.fabry_perot import coupling, fringe

Array = NDArray[np.float64]
FIBRE = (0.04, 0.9)
SAMPLES, SIGMA = 160, 0.01


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


NM = 1e6
REST, SCAN_TIME, STEP = 0.2, 0.3, 2e-3


def short_move(way: float, *, scan: float = 2e-5, after: float = 0.0, noise: float = 0.005) -> Any:
    """A mirror that goes ``way`` fringes; the light of the last scan is that of one ``after`` fringes farther."""
    half, t = signals.WAVELENGTH / 2.0, np.arange(0.0, 0.8, STEP)
    path = half * (0.05 + way * signals.smooth_step(t, REST, 0.4))
    detector = signals.Detector(noise=noise)
    run = signals.run(t, path, detector, np.random.default_rng(3), 0.9, scan, SCAN_TIME)
    if after:
        last = slice(-round(SCAN_TIME / STEP), None)
        phase = 4.0 * np.pi * (0.9 + path[-1] + after * half) / run.wavelength[last]
        run.signal[last] = detector.read(phase, np.random.default_rng(4))
    return run


@pytest.mark.parametrize("way", [3.2, -3.2])
def test_scans_tell_the_direction_and_on_which_side_of_a_fringe_the_mirror_rests(way: float) -> None:
    run = short_move(way)
    move = read_move(run.t, run.signal, run.wavelength, FIBRE)
    assert move.signed and not move.faults
    assert abs(move.change - run.change) < 4.0 * move.sigma < 20.0 / NM
    assert np.sign(move.change) == np.sign(way) and move.count.turns == 0
    assert move.count.start.doubt == move.count.stop.doubt == 0.0
    assert move.wavelength == signals.WAVELENGTH
    plain = short_move(way, scan=0.0)
    unsigned = read_move(plain.t, plain.signal, plain.wavelength, FIBRE)
    assert not unsigned.signed and unsigned.change == pytest.approx(
        abs(way) * signals.WAVELENGTH / 2.0, abs=2e-5
    )


def test_a_count_that_the_scans_contradict_is_not_used() -> None:
    """One whole fringe that nobody counted is enough."""
    for after, contradicted in ((0.0, False), (1.0, True)):
        run = short_move(3.2, after=after)
        move = read_move(run.t, run.signal, run.wavelength, FIBRE)
        assert (Fault.COUNT in move.faults) is contradicted


def test_light_without_fringes_counts_nothing_and_knows_nothing() -> None:
    t = np.arange(0.0, 1.0, STEP)
    noise = np.random.default_rng(5).standard_normal(len(t))
    for light in (noise, np.zeros(len(t)), np.full(len(t), 7.0)):
        count = count_fringes(t, light, FIBRE)
        assert count.faults == (Fault.WEAK,)
        assert (count.walked, count.turns, count.phase) == (0.0, 0, 0.0)
        assert np.isinf(count.sigma) and np.isinf(count.noise)
        assert count.start == count.stop and (count.start.offset, count.start.doubt) == (0.0, 0.0)


@pytest.mark.parametrize(("noise", "weak"), [(0.05, False), (0.07, True)])
def test_noise_beyond_six_hundredths_of_a_fringe_hides_it(noise: float, weak: bool) -> None:
    run = short_move(4.2, scan=0.0, noise=noise)
    assert (Fault.WEAK in count_fringes(run.t, run.signal, FIBRE).faults) is weak
