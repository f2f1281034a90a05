"""What remains of the UR10 after all that is named, and how much of it these data can tell."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from real_recordings.common import FILES, Array, say
from real_recordings.hypotheses import Verdict, of_arrival, of_the_rest, predictable, previous_row, weigh
from real_recordings.ladder import Ladder, climb, held_out
from real_recordings.linearised import Linearised, linearise
from real_recordings.orders import Spectrum, spectrum
from real_recordings.regressors import Term, arrival, couplings, drift, gravity, waves
from real_recordings.repeats import REPEATS, Moments, moments, pairs, still, unreal_share, variogram
from real_recordings.ur10 import mark_held_out

GEAR = 101
PER_MOTOR_TURN = range(2, 31)
ENCODER = (256, 384, 512)
BEFORE_HIGH, BEFORE_ARRIVAL = "gravity's torque on joints 2 to 5", "orders 61 to 140"
BEFORE_LINES = "couplings of axes"
MIDDLE, HIGH = (101.0, 270.0), (141.0, 3100.0)
"""Orders scanned; up to 60 they are named already, and 61 to 100 continue that series."""
PEAKS, THINNED = 5, (4, 2)
SPHERICAL = 5
"""Joints whose turning moves the probe's point."""


def remainder(data_folder: Path, work: Path) -> None:
    """Ladder, arrival, the other hypotheses, repeats and orders of both files; then the orders they share."""
    work.mkdir(parents=True, exist_ok=True)
    mark_held_out(data_folder, work)
    found = {}
    for name in FILES:
        data = linearise(data_folder / "ur10-laser-tracker" / "machine.yaml", work / f"{name}.csv")
        found[name] = study(name, data)
    for joint in range(6):
        for part in (0, 1):
            _shared(joint, {name: spectra[joint][part] for name, spectra in found.items()})


def stages(data: Linearised) -> dict[str, list[Term]]:
    """The causes in the order in which they are added."""
    lines = sorted([GEAR * k for k in PER_MOTOR_TURN] + list(ENCODER))
    return {
        "geometry": [],
        "periodic errors of joints, orders 1 to 60": waves(data, range(1, 61)),
        BEFORE_HIGH: gravity(data),
        BEFORE_ARRIVAL: waves(data, range(61, 141)),
        "arrival along the last motion": arrival(data),
        "base drifts over the rows": drift(data),
        BEFORE_LINES: couplings(data),
        "2 to 30 cycles a motor turn; orders 256, 384, 512": waves(data, lines),
    }


def study(name: str, data: Linearised) -> list[tuple[Spectrum, Spectrum]]:
    """All tables of one file; two spectra of each joint, each before what it shows is fitted."""
    ladder = climb(data, stages(data))
    say(
        f"{name}: {len(data)} rows, {int(ladder.outlier.sum())} single rows set aside (all rows: in brackets)"
    )
    for rung in ladder.rungs:
        own, every = held_out(data, rung.residual, ladder.outlier), held_out(data, rung.residual)
        say(
            f"  {rung.name}: held out {own[0]:.1f} um ({every[0]:.1f}), {own[1]:.0f} urad; {rung.columns} columns"
        )
    _hypotheses(name, data, ladder)
    last = ladder.rungs[-1].residual
    _repeats(name, data, ladder, last)
    _thinned(name, data, ladder)
    return [
        (
            spectrum(data, ladder.residual(BEFORE_HIGH), ladder.outlier, k, *MIDDLE),
            spectrum(data, ladder.residual(BEFORE_LINES), ladder.outlier, k, *HIGH),
        )
        for k in range(6)
    ]


def _hypotheses(name: str, data: Linearised, ladder: Ladder) -> None:
    say(
        f"{name}: share of the direction of arrival that the pose foretells, by joint: {_numbers(predictable(data), 2)}"
    )
    for what, terms in of_arrival(data).items():
        found = weigh(data, ladder.residual(BEFORE_ARRIVAL), ladder.outlier, terms)
        _tell(name, what, found)
        say(f"    joints stand beyond their readings by {_numbers(-1e6 * found.coefficients, 0)} urad")
    last = ladder.rungs[-1].residual
    for what, terms in (of_the_rest(data) | {"the row before": previous_row(data, last)}).items():
        _tell(name, what, weigh(data, last, ladder.outlier, terms))


def _tell(name: str, what: str, v: Verdict) -> None:
    say(
        f"  {name}, {what} ({len(v.coefficients)}): ln Bayes {v.log_bayes:.0f} (placebo {v.placebo:.0f}), "
        f"held-out gain {v.gain[0]:.1f} um, {v.gain[1]:.1f} urad"
    )


def _repeats(name: str, data: Linearised, ladder: Ladder, left: Array) -> None:
    joint = data.joint[:, :3, :SPHERICAL]
    good = data.held & ~ladder.outlier
    _scatter(f"{name}, held-out rows", moments(left[good][:, :3], joint[good]))
    rows = pairs(data, ladder.outlier, REPEATS[name])
    apart = (left[rows[:, 1]] - left[rows[:, 0]])[:, :3] / np.sqrt(2.0)
    _scatter(
        f"{name}, {len(rows)} pairs of visits within {REPEATS[name]} deg", moments(apart, joint[rows[:, 0]])
    )
    share, sigma = unreal_share(data, left, rows)
    say(
        f"  part of the change of joint readings that the arm did not do: {_numbers(share, 2)} +- {_numbers(sigma, 2)}"
    )
    change = 1e6 * np.std(data.q[rows[:, 1]] - data.q[rows[:, 0]], axis=0) / np.sqrt(2.0)
    say(f"  scatter of one joint reading between visits: {_numbers(change, 0)} urad")
    fixed = still(data, left, rows)[:, :3] / np.sqrt(2.0)
    _scatter(f"{name}, the same pairs, joint readings taken as unchanged", moments(fixed, joint[rows[:, 0]]))
    for low, high, count, position, rotation in variogram(data, left, ladder.outlier):
        say(f"  {name}, {count} pairs {low:g} to {high:g} deg apart: {position:.1f} um, {rotation:.0f} urad")


def _thinned(name: str, data: Linearised, ladder: Ladder) -> None:
    """Whether more rows would help: the largest model from every fourth and second row; held-out rows the same."""
    place = np.arange(len(data))
    for part in THINNED:
        fewer = replace(data, held=data.held | (place % part != 0))
        left = climb(fewer, stages(data)).rungs[-1].residual
        own = held_out(data, left, ladder.outlier)
        say(f"  {name}, fitted to one row in {part}: held out {own[0]:.1f} um, {own[1]:.0f} urad")


def _scatter(what: str, m: Moments) -> None:
    say(
        f"  {what}: {m.rms:.1f} um; without direction {m.isotropic:.1f} um per axis, joints {_numbers(m.joints, 0)} urad; "
        f"shares {_numbers(m.share, 2)}"
    )


def _shared(joint: int, spectra: dict[str, Spectrum]) -> None:
    """Peaks of either file above all shuffles, and what the other file has within 1.5 orders."""
    for name, own in spectra.items():
        other = next(s for n, s in spectra.items() if n != name)
        for k in own.peaks(PEAKS):
            if own.power[k] > own.limit:
                near = np.abs(other.order - own.order[k]) <= 1.5
                say(
                    f"q{joint + 1}, {name}: order {own.order[k]:g} = {own.order[k] / GEAR:.3f} cycles a motor turn, "
                    f"{1e6 * own.amplitude[k]:.1f} urad, power {own.power[k]:.0f} (chance {own.limit:.0f}; "
                    f"other file {other.power[near].max():.0f}, chance there {other.limit:.0f})"
                )


def _numbers(values: Array, digits: int) -> str:
    return " ".join(f"{v:.{digits}f}" for v in values)
