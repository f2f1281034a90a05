"""One series as a change of length: fringes counted, and its sign and its ends from scans of the wavelength.

A series is rest, move, rest at one wavelength; before and after it the wavelength may be scanned while the
mirror rests. Two scans give the lengths before and after to a fraction of a fringe, hence the sign and a check
of the count (the nanopositioner paper, section V.A). Each scan also tells on which side of the end of its
fringe the mirror rests, which the level alone does not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.fringes.count import Count, End, count_fringes
from truepose.identification.leaves.fringes.excursions import Fault
from truepose.identification.leaves.fringes.levels import Levels, noise_of
from truepose.identification.leaves.fringes.scan import Scan, read_scan
from truepose.models.sensors.irradiance import Reflectivities, coupling

_SURE = 16.0  # difference in chi2 between the signs
_WRONG = 30.0  # chi2 of the length, or of a phase, that no noise makes
_PHASE = 0.05  # rad: what phases of scan and rest may differ by


@dataclass(frozen=True)
class Move:
    """A change of length in the wavelength's unit, its 1-sigma (miscounts apart), and how it was found.

    ``signed``: whether scans gave the sign; else ``change`` is positive. ``faults``: why not to use it.
    """

    change: float
    sigma: float
    signed: bool
    count: Count
    faults: tuple[Fault, ...]


def read_move(
    t: Array,
    signal: Array,
    wavelength: Array | float,
    reflectivities: Reflectivities,
    levels: Levels | None = None,
) -> Move:
    """The change of length over a series: increasing times (n,), samples (n,) in any unit, wavelengths.

    ``wavelength`` is one number or (n,), constant while the mirror moves. ``levels`` serve where the series
    spans too few fringes to show its own. Raises nothing for a signal that cannot be read: see ``faults``.
    """
    wave = np.broadcast_to(np.asarray(wavelength, dtype=np.float64), t.shape)
    main = longest_constant(wave)
    base = float(wave[main.start])
    g, noise = coupling(reflectivities), noise_of(signal[main]).sigma
    sides = slice(0, main.start), slice(main.stop, len(t))
    count = count_fringes(t[main], signal[main], reflectivities, levels)
    if {Fault.LEVELS, Fault.WEAK} & set(count.faults) or count.levels is levels:
        free = [read_scan(wave[side], signal[side], base, g, noise) for side in sides]
        seen = levels_of(free, t[main])
        if seen is not None:
            count = count_fringes(t[main], signal[main], reflectivities, seen)
    known = None if {Fault.LEVELS, Fault.WEAK} & set(count.faults) else count.levels
    places = t[main][[0, -1]]
    scans = [
        read_scan(wave[side], signal[side], base, g, noise, known and known.at(float(place)))
        for side, place in zip(sides, places, strict=True)
    ]
    return signed_move(count, scans[0], scans[1], base)


def longest_constant(values: Array) -> slice:
    """The longest run of one value in (n,)."""
    change = np.flatnonzero(values[1:] != values[:-1]) + 1
    bounds = np.concatenate([[0], change, [len(values)]])
    longest = int(np.argmax(np.diff(bounds)))
    return slice(int(bounds[longest]), int(bounds[longest + 1]))


def levels_of(scans: list[Scan | None], t: Array) -> Levels | None:
    """Levels that scans at the start and the stop show."""
    seen = [
        (float(place), scan.low, scan.high)
        for place, scan in zip(t[[0, -1]], scans, strict=True)
        if scan is not None and scan.low is not None and scan.high is not None
    ]
    if not seen:
        return None
    knots, low, high = np.array(seen).T
    return Levels(knots, low, high, 0.001)


def signed_move(count: Count, before: Scan | None, after: Scan | None, base: float) -> Move:
    """The sign that agrees with the scans, and with it the ends as they give them."""
    unit = base / (4.0 * np.pi)
    plain = Move(abs(count.phase) * unit, count.sigma * unit, False, count, count.faults)
    if before is None and after is None:
        return plain
    misfits = {sign: misfits_of(count, before, after, unit, sign) for sign in (1.0, -1.0)}
    best = min(misfits, key=lambda sign: sum(misfits[sign]))
    if sum(misfits[-best]) - sum(misfits[best]) < _SURE:
        return plain
    start, stop = placed_end(count.start, before, best), placed_end(count.stop, after, best)
    placed = replace(count, start=start, stop=stop)
    sided = start.doubt == 0.0 and stop.doubt == 0.0
    faults = tuple(fault for fault in count.faults if not (fault is Fault.SIDE and sided))
    if max(misfits[best]) > _WRONG:
        faults = (*faults, Fault.COUNT)
    return Move(best * placed.phase * unit, placed.sigma * unit, True, placed, faults)


def misfits_of(
    count: Count, before: Scan | None, after: Scan | None, unit: float, sign: float
) -> list[float]:
    """chi2 of the length's change and of the phases at rest for a sign of the walking direction."""
    out = []
    if before is not None and after is not None:
        expected = sign * count.phase * unit
        spread = np.hypot(before.length_sigma, after.length_sigma) + count.sigma * unit
        out.append(float((after.length - before.length - expected) ** 2 / spread**2))
    for scan, end in ((before, count.start), (after, count.stop)):
        if scan is not None:
            off = np.angle(np.exp(1j * (_from_end(scan, end) - sign * end.offset)))
            out.append(float(off**2 / (scan.phase_sigma**2 + end.sigma**2 + _PHASE**2)))
    return out


def _from_end(scan: Scan, end: End) -> float:
    """The scan's phase from the end of the fringe, rad in (-pi, pi], positive towards greater lengths."""
    return float(np.angle(np.exp(1j * (scan.phase - (np.pi if end.high else 0.0)))))


def placed_end(end: End, scan: Scan | None, sign: float) -> End:
    """A rest by scan and level together; the side of the end of the fringe is the scan's."""
    if scan is None:
        return end
    measured = sign * _from_end(scan, end)
    distance = float(np.hypot(end.offset, end.doubt))
    level = float(np.copysign(distance, measured))
    spread = float(np.sqrt(max(end.sigma**2 - end.doubt**2, 0.0)))
    weights = np.array([scan.phase_sigma, max(spread, 1e-6)]) ** -2.0
    offset = float(np.average([measured, level], weights=weights))
    return replace(end, offset=offset, sigma=float(1.0 / np.sqrt(weights.sum())), doubt=0.0)
