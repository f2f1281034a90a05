"""How well fringes are counted: speed, noise, contrast and turning points; damage; and 10^7 samples in time.

Series come from `support.fringe_signal`, which adds the light beam by beam. Run as ``python -m benchmarks.fringe_study``;
prints the tables of benchmarks/results/fringes.md.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from support.fringe_journeys import RATE, REST, SCAN, Maker, cut, journeys
from support.fringe_signal import FIBRE, WAVELENGTH, Detector, Run, displacement, ramp, reflected, run
from truepose.identification.leaves.fringes.count import count_fringes
from truepose.identification.leaves.fringes.move import Move, read_move

Array = NDArray[np.float64]
NM = 1e6
SPEEDS = (200.0, 30.0, 8.0)
NOISES = (0.002, 0.01, 0.03)
MIRRORS = (FIBRE, (0.3, 0.3))


@dataclass(frozen=True)
class Score:
    """``errors`` (n,) in nm of the counts without a fault, and as parts of sigma; how many series there were."""

    errors: Array
    pulls: Array
    series: int

    @property
    def flagged(self) -> float:
        """Share of the series with a fault."""
        return 1.0 - len(self.errors) / self.series

    def cells(self) -> str:
        """Median, 95 %, largest error, share flagged, rms error / sigma, as cells of a table."""
        flagged = f"{100.0 * self.flagged:.0f} %"
        if not len(self.errors):
            return f"- | - | - | {flagged} | -"
        size = np.abs(self.errors)
        return (
            f"{np.median(size):.2f} | {np.quantile(size, 0.95):.2f} | {size.max():.2f} | {flagged} | "
            f"{np.sqrt(np.mean(self.pulls**2)):.2f}"
        )


def together(scores: Sequence[Score]) -> Score:
    """All series of some scores as one."""
    return Score(
        np.concatenate([one.errors for one in scores]),
        np.concatenate([one.pulls for one in scores]),
        sum(one.series for one in scores),
    )


def error_of(move: Move, change: float) -> float:
    """Error in nm; without a sign only the size is judged."""
    return (move.change - (change if move.signed else abs(change))) * NM


def score(make: Maker, reflectivities: tuple[float, float], series: int, seed: int) -> Score:
    """Read so many series from a maker."""
    rng = np.random.default_rng(seed)
    errors, pulls = [], []
    for _ in range(series):
        one = make(rng)
        move = read_move(one.t, one.signal, one.wavelength, reflectivities)
        if not move.faults:
            errors.append(error_of(move, one.change))
            pulls.append(errors[-1] / (move.sigma * NM))
    return Score(np.array(errors), np.array(pulls), series)


def grid(series: int) -> list[str]:
    """Speed x noise x contrast x turning points."""
    lines = [
        "| samples a fringe | noise | R1, R2 | turning points | median, nm | 95 %, nm | largest, nm | flagged "
        "| rms error / sigma |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    seed = 0
    scores: dict[bool, list[Score]] = {False: [], True: []}
    for samples in SPEEDS:
        for noise in NOISES:
            for mirrors in MIRRORS:
                for turning in (False, True):
                    seed += 1
                    make = journeys(samples, Detector(mirrors, noise=noise), turning)
                    found = score(make, mirrors, series, seed)
                    scores[turning].append(found)
                    lines.append(
                        f"| {samples:g} | {100 * noise:g} % | {mirrors[0]:g}, {mirrors[1]:g} | "
                        f"{'one' if turning else 'none'} | {found.cells()} |"
                    )
    for turning, found_all in scores.items():
        lines.append(f"| all | all | all | {'one' if turning else 'none'} | {together(found_all).cells()} |")
    return lines


def abrupt(rng: np.random.Generator) -> Run:
    """A reversal from full speed to full speed within a sample."""
    t = np.arange(0.0, 2.0, 1.0 / RATE)
    u, half = np.clip(t - REST, 0.0, 1.2), rng.uniform(0.4, 0.8)
    path = 0.02 * (1.0 + rng.random()) * np.where(u < half, u, 2.0 * half - u)
    return run(t, path, Detector(noise=0.01), rng, scan=SCAN)


def shaken(amplitude: float) -> Maker:
    """A slow move on which the mirror vibrates at 50 Hz, at rest as well."""

    def make(rng: np.random.Generator) -> Run:
        t = np.arange(0.0, 2.0, 1.0 / RATE)
        path = displacement(t, 0.5, [(0.02 * (1.0 + rng.random()), 0.0, 1.0)])
        return run(t, path + amplitude * np.sin(2.0 * np.pi * 50.0 * t), Detector(noise=0.01), rng, scan=SCAN)

    return make


def damaged(series: int) -> list[str]:
    """Series that should be flagged, or that are hard."""
    quiet = Detector(noise=0.01)
    cases: dict[str, Maker] = {
        "one turning point, no wavelength scan": journeys(30.0, quiet, True, 0.0),
        "one turning point, wavelength scans": journeys(30.0, quiet, True),
        "0.2 um, less than a fringe, with scans": lambda rng: _short(rng, SCAN),
        "0.2 um, less than a fringe, no scan": lambda rng: _short(rng, 0.0),
        "reversal within one sample": abrupt,
        "vibration of 3 nm": shaken(3e-6),
        "vibration of 20 nm": shaken(20e-6),
        "gain drifts by 2 %, a fifth of a fringe": journeys(30.0, replace(quiet, drift=0.02), False),
        "gain drifts by 10 %, a whole fringe": journeys(30.0, replace(quiet, drift=0.1), False),
        "64 steps of the converter a fringe": journeys(30.0, replace(quiet, steps=64), False),
        "noise 10 %": journeys(30.0, replace(quiet, noise=0.10), False),
        "3 samples a fringe": journeys(3.0, quiet, False),
        "gap of 10 to 40 samples": cut(journeys(30.0, quiet, False), False),
        "gap closed up (a jump)": cut(journeys(30.0, quiet, False), True),
        "gap closed up, no wavelength scan": cut(journeys(30.0, quiet, False, 0.0), True),
    }
    lines = [
        "| series | median, nm | 95 %, nm | largest, nm | flagged | rms error / sigma |",
        "|---|---|---|---|---|---|",
    ]
    for seed, (name, make) in enumerate(cases.items(), start=1000):
        lines.append(f"| {name} | {score(make, FIBRE, series, seed).cells()} |")
    return lines


def _short(rng: np.random.Generator, scan: float) -> Run:
    t = np.arange(0.0, 1.5, 1.0 / RATE)
    path = displacement(t, 0.5, [(0.0002 * (1.0 + rng.random()), 0.0, 0.5)])
    return run(t, path, Detector(noise=0.005), rng, 0.9 + 1e-3 * rng.random(), scan)


def timing(samples: int = 10**7, per_fringe: float = 30.0) -> list[str]:
    """One series of so many samples: this counter and the phase of the analytic signal (FFT), unwrapped."""
    rng = np.random.default_rng(5)
    t = np.arange(samples) / 1e6
    lasting = 0.9 * t[-1]
    distance = WAVELENGTH / 2.0 * lasting * 1e6 / per_fringe
    path = distance * ramp(t, 0.05 * t[-1], lasting, 0.1 * lasting)
    turn = np.linspace(0.0, 2.0 * np.pi, 200_001)  # the sum over beams takes minutes for all samples
    phase = (4.0 * np.pi * (0.9 + path) / WAVELENGTH) % (2.0 * np.pi)
    signal = np.interp(phase, turn, reflected(turn, FIBRE)) * (1.0 + 0.02 * t / t[-1])
    signal += 0.01 * Detector().peak_to_peak * rng.standard_normal(samples)
    began = time.perf_counter()
    count = count_fringes(t, signal, FIBRE)
    own = time.perf_counter() - began
    began = time.perf_counter()
    angle = np.unwrap(np.angle(scipy.signal.hilbert(signal - signal.mean())))
    peer = time.perf_counter() - began
    unit = WAVELENGTH / (4.0 * np.pi)
    faults = ", ".join(fault.name for fault in count.faults) or "none"
    return [
        f"{samples} samples, {distance / (WAVELENGTH / 2.0):.0f} fringes:",
        "",
        "| method | s | error, nm |",
        "|---|---|---|",
        f"| `count_fringes` (faults: {faults}) | {own:.1f} | {(count.phase * unit - distance) * NM:.3f} |",
        f"| `scipy.signal.hilbert`, `numpy.unwrap` | {peer:.1f} "
        f"| {((angle[-1] - angle[0]) * unit - distance) * NM:.1f} |",
    ]


def main() -> None:
    """Print the tables; series a row as the first argument."""
    series = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    for lines in (grid(series), damaged(series), timing()):
        sys.stdout.write("\n".join(lines) + "\n\n")


if __name__ == "__main__":
    main()
