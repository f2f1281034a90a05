"""How much a hypothesis is worth: one number, the evidence of a cheap fit under what the file knows.

What is left of a right hypothesis is the drawing's errors, physics, and noise: of a size that nobody knows, and alike in
neighbouring poses. So its evidence falls with the misfit to the power ``WORTH``, however many rows there are, and with how
seldom such a slip is made. Readings that are said to be in a smaller unit have to be met as much better.

What the drawing's tolerances explain of a misfit, and at which price: a few linear steps of all constants.

A hypothesis is right where little is left *and* no constant had to leave its tolerance for it. Both count in one number:
the rms of whitened readings and of departures from the drawing, in units of the same noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.fit.standing_out import FAR
from truepose.identification.leaves.check.alignment import Frames
from truepose.identification.leaves.check.pair import RARE, SELDOM, Scene, Slip, Stand
from truepose.identification.leaves.check.rig import ABSURD, KEPT, Rig, motion, trimmed
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.joint_readings import SLACK
from truepose.models.file.sections import FramesSection
from truepose.models.machine.machine import FRAMES
from truepose.models.sensors.pose import Position

_STEPS, _PARTS, _ENOUGH = 6, (1.0, 0.3, 0.1), 0.01
# -- What the drawing's tolerances explain of a misfit, and at which price: a few linear steps of all constants

_LOOSE = 1e3
"""Steps allowed to what is unknown (frames, infinite tolerances), in natural sizes: none is in the way."""


@dataclass(frozen=True)
class Settled:
    """Constants p (np,) where readings and tolerances agree best, the misfit that is left, and what it cost.

    price: rms of readings and departures, in sigmas; misfit: rms of the readings alone, over the rows that fit best; away:
    departure of each constant, in tolerances, by name.
    """

    p: Array
    price: float
    misfit: float
    away: dict[str, float]

    @property
    def farthest(self) -> float:
        """The largest departure, in tolerances."""
        return max(self.away.values(), default=0.0)


def expected(rig: Rig, stand: Stand) -> float:
    """Return the misfit (whitened rms) that the tolerances alone would leave once base and tool are fitted; at least 1."""
    here, p = _over(rig, stand), stand.p
    jacobian, _ = linearised(rig, here, p, stand)
    tolerance = rig.tolerances(stand.scene)
    known = np.flatnonzero(np.isfinite(tolerance) & (tolerance > 0) & ~_loose(rig))
    if not len(known) or not len(jacobian):
        return 1.0
    carried = jacobian[:, :, known] * tolerance[known]
    flat = carried.reshape(-1, len(known))
    left = without(jacobian[:, :, _loose(rig)].reshape(len(flat), -1), flat)
    return float(np.sqrt(1.0 + np.sum(left**2) / max(len(flat), 1)))


def settle(rig: Rig, stand: Stand, free: tuple[str, ...] = (), noise: float | None = None) -> Settled:
    """Return where readings and tolerances agree, with the frames ``free`` wherever they fit best.

    What is left then is taken as the readings' noise (sigmas, unless it is given), so that no constant bends for what it cannot
    explain.
    """
    if stand.bad:
        return Settled(stand.p, float("inf"), float("inf"), {})
    if noise is not None:
        return Problem(rig, stand, noise, free).settled()
    first = Problem(rig, stand, 1.0, free).settled()
    return Problem(rig, stand, max(first.misfit, 1.0), free).settled()


class Problem:
    """Readings and tolerances in one sum of squares, for one hypothesis."""

    def __init__(self, rig: Rig, stand: Stand, noise: float, free: tuple[str, ...]) -> None:
        self.rig, self.stand, self.noise = rig, stand, noise
        self.here = _over(rig, stand)
        tolerance = rig.tolerances(stand.scene, free)
        self.moving = np.flatnonzero(tolerance > 0)
        self.known = np.isfinite(tolerance[self.moving])
        natural = np.where(rig.lengths[self.moving], 100.0, 1.0)
        self.scale = np.where(self.known, tolerance[self.moving], natural)
        self.held = np.where(self.known, 1.0, 1.0 / _LOOSE)

    def settled(self) -> Settled:
        """Return the least sum within a few linear steps."""
        p = self.stand.p.copy()
        best, misfit = self._price(p)
        for _ in range(_STEPS if len(self.moving) else 0):
            jacobian, residual = linearised(self.rig, self.here, p, self.stand)
            if not len(residual):
                break
            keep = _kept(residual)
            j = jacobian[keep][:, :, self.moving].reshape(-1, len(self.moving)) * self.scale / self.noise
            off = self.off(p) * self.held
            right = -np.concatenate([residual[keep].reshape(-1) / self.noise, np.where(self.known, off, 0.0)])
            step = np.linalg.lstsq(np.vstack([j, np.diag(self.held)]), right, rcond=None)[0]
            for part in _PARTS:
                trial = p.copy()
                trial[self.moving] += part * step * self.scale
                price, left = self._price(trial)
                if price < best:
                    break
            else:
                break
            gained, best, misfit, p = (best - price) / best, price, left, trial
            if gained < _ENOUGH:
                break
        names = [self.rig.names[k] for k in self.moving[self.known]]
        away = dict(zip(names, np.abs(self.off(p)[self.known]).tolist(), strict=True))
        return Settled(p, best, misfit, away)

    def off(self, p: Array) -> Array:
        """Return how far constants (np,) are from where the file has them, in tolerances or natural sizes."""
        out: Array = (p - self.stand.scene.p)[self.moving] / self.scale
        return out

    def _price(self, p: Array) -> tuple[float, float]:
        """The sum at constants (np,), and the readings' share of it, both as an rms over the readings."""
        residual, good = self.rig.residual(self.here, p, self.stand.scene)
        residual = residual * self.rig.scale(self.stand.scene)
        residual = residual[good & np.isfinite(residual).all(axis=1)]
        if len(residual) < 0.5 * len(good):
            return float("inf"), float("inf")
        kept = residual[_kept(residual)]
        off = self.off(p)[self.known]
        read, count = np.sum(kept**2), max(kept.size, 1)
        return float(np.sqrt((read + self.noise**2 * np.sum(off**2)) / count)), float(np.sqrt(read / count))


def linearised(rig: Rig, here: Predictor, p: Array, stand: Stand) -> tuple[Array, Array]:
    """Return whitened Jacobians (n, m, np) and residuals (n, m) of the rows that have them, at constants (np,)."""
    x, good = rig.assembled(here, p, stand.scene)
    blocks = list(here.blocks(p, x))
    scale = rig.scale(stand.scene)
    residual = np.concatenate([b.residual for b in blocks]) * scale
    jacobian = np.concatenate([b.jacobian for b in blocks]) * scale[:, None]
    fine = good & np.isfinite(residual).all(axis=1) & np.isfinite(jacobian).all(axis=(1, 2))
    return jacobian[fine], residual[fine]


def _over(rig: Rig, stand: Stand) -> Predictor:
    return rig.predictor.over(stand.scene.rows.subset(stand.rows))


def _loose(rig: Rig) -> Mask:
    """(np,) what the cheap fit moves freely: the two frames."""
    out = np.zeros(len(rig.names), dtype=bool)
    for places in rig.at.values():
        out[places] = True
    return out


def _kept(residual: Array) -> Mask:
    """(n,) the rows that fit best."""
    each = np.sum(residual**2, axis=1)
    return np.asarray(each <= np.quantile(each, KEPT))


def without(columns: Array, values: Array) -> Array:
    """Return what the span of some columns (n, k) leaves of others (n, m)."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0] / size[size > 0]
    if not columns.size:
        return values
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    basis = u[:, s > 1e-9 * s[0]]
    return np.asarray(values - basis @ (basis.T @ values))


# -- How much a hypothesis is worth: one number, the evidence of a cheap fit under what the file knows

WORTH = 8.0
"""Readings that count as independent: a slip that every workshop has seen needs to fit three times better to be certain."""
LEAST = 0.1
"""Sigmas below which no misfit counts as smaller."""
CERTAIN = 0.99
USUAL_REACH, DECADES = 500.0, 0.5
"""mm: the longest dimension of a robot, roughly; and by how many decades (1-sigma) robots are larger or smaller."""
PHYSICS = 0.2
"""Share of what the tool moves that nothing left out of a model makes: an open-loop piezo is off by 0.23 of its stroke."""
NOWHERE_ELSE: Mapping[tuple[str, ...], float] = {(): 1.0}
"""The one way of frames that stand where the file has them."""


@dataclass(frozen=True)
class Hypothesis:
    """Slips made together, the scene without them, and their odds."""

    slips: tuple[Slip, ...]
    scene: Scene
    odds: float = 1.0

    def with_slip(self, slip: Slip) -> Hypothesis:
        """Return the hypothesis that this slip was made too."""
        return Hypothesis((*self.slips, slip), slip.change(self.scene), self.odds * slip.odds)


@dataclass(frozen=True)
class Weighed:
    """A hypothesis with its best fit: frames that must be ``free`` for it, and the logarithm of its evidence.

    near: whether what is left is what drawing and sigma let one expect.
    """

    hypothesis: Hypothesis
    free: tuple[str, ...]
    stand: Stand
    settled: Settled
    score: float
    near: bool

    @property
    def plain(self) -> bool:
        """Whether it needs either slips or frames elsewhere: where it needs both, two slips may say it better."""
        return not (self.free and self.hypothesis.slips)


def evidence(rig: Rig, scene: Scene, misfit: float, odds: float) -> float:
    """Return the logarithm of a hypothesis' evidence, given its misfit in sigmas."""
    if not np.isfinite(misfit):
        return -np.inf
    seen = max(misfit, LEAST) * (scene.coarse / scene.size) ** float(np.mean(rig.long))
    # where lengths are read beside them, angles make too little of a misfit for a larger unit to earn anything
    seen *= max(scene.turned / scene.width, 1.0) ** float(np.mean(rig.wide))
    size = reach(rig, scene.p)
    unlikely = 0.5 * (np.log10(size / USUAL_REACH) / DECADES) ** 2 if size > 0 else 0.0
    beyond = len(joints_beyond(rig, scene)) * np.log(1.0 / SELDOM)
    return float(np.log(odds) - WORTH * np.log(seen) - unlikely - beyond)


def fits_better(rig: Rig, one: Weighed, other: Weighed) -> bool:
    """Return True if a hypothesis meets the numbers that were recorded certainly better than another by base and tool alone.

    Sigmas and tolerances that grow, or a range that does, are no evidence.
    """
    if other.stand.bad:
        return True
    mine, its = (_as_recorded(rig, w.stand) for w in (one, other))
    return bool(WORTH * np.log(max(its, LEAST) / max(mine, LEAST)) > np.log(CERTAIN / (1.0 - CERTAIN)))


def _as_recorded(rig: Rig, stand: Stand) -> float:
    """Return the rms of what is left over the rows that fit best, in sigmas of the numbers as they were recorded."""
    scene = stand.scene
    grown = np.where(rig.long, scene.coarse / scene.size, np.where(rig.wide, scene.turned / scene.width, 1.0))
    return trimmed(stand.residual * grown)


def joints_beyond(rig: Rig, scene: Scene) -> list[str]:
    """Return the joints that a hypothesis has out of their range, whole turns aside."""
    out = []
    for k, a in enumerate(rig.actuators):
        q = scene.rows.q[:, k]
        if a.reading_range is None or not len(q):
            continue
        low, high = np.multiply(a.reading_range, scene.drawn if a.reading_unit == "mm" else 1.0)
        if a.reading_unit == "rad":
            q = q - 2.0 * np.pi * np.round((q - (low + high) / 2.0) / (2.0 * np.pi))
        slack = SLACK * (high - low)
        if q.min() < low - slack or q.max() > high + slack:
            out.append(a.reading)
    return out


def reach(rig: Rig, p: Array) -> float:
    """Return the longest dimension of the mechanism at constants p (np,), mm; 0 where none is a length."""
    long = [rig.names.index(q.name) for q in rig.machine.mechanism.parameters if q.unit == "mm"]
    return float(np.abs(p[long]).max(initial=0.0))


def ways(rig: Rig) -> dict[tuple[str, ...], float]:
    """Return which frames may be elsewhere than the file says, with the odds of it: none, either, both."""
    # how a tool is turned that is read as a point does not matter where nobody knows that point
    points = all(isinstance(sensor, Position) for sensor in rig.machine.sensors)
    seen = {f: rig.at[f][: 3 if points and f == "tool" else 6] for f in FRAMES}
    known = [f for f in FRAMES if np.isfinite(rig.tolerance[seen[f]]).any()]
    frames = rig.machine.file.frames if rig.machine.file else FramesSection()
    odds = {f: RARE if frames.is_stated(f) else SELDOM for f in known}
    sets = [w for k in range(len(known) + 1) for w in combinations(known, k)]
    return {way: float(np.prod([odds[f] for f in way])) for way in sets}


def weigh(
    rig: Rig,
    hypothesis: Hypothesis,
    among: Mapping[tuple[str, ...], float] | None = None,
    also: Sequence[Frames] = (),
) -> Weighed:
    """Return a hypothesis with its best fit among some of its ``ways``.

    ``also``: frames to start from, beside those that closed forms have.
    """
    scene, found = hypothesis.scene, []
    for way, odds in (among or ways(rig)).items():
        stand = rig.stand(scene, way, also=also)
        found.append((bound(rig, stand, way, odds * hypothesis.odds), way, odds, stand))
    best: Weighed | None = None
    for most, way, odds, stand in sorted(found, key=lambda one: (len(one[1]), -one[0])):
        if best is not None and (best.near or most < best.score):
            continue  # a frame that need not be elsewhere is where the file has it
        settled = settle(rig, stand, way)
        score = evidence(rig, scene, settled.price, odds * hypothesis.odds)
        one = Weighed(hypothesis, way, stand, settled, score, is_near(rig, stand, settled, way))
        best = one if best is None or one.score > best.score else best
    if best is None:
        raise ValueError("a hypothesis is weighed with at least one way for its frames")
    return best


def is_near(rig: Rig, stand: Stand, settled: Settled, free: tuple[str, ...] = ()) -> bool:
    """Return whether what is left is what drawing and sigma let one expect, with no constant far off.

    It is where the machine fits as it is drawn, however far constants would bend to take up physics, and where it fits with
    all constants inside ``FAR`` tolerances.
    """
    if stand.bad or joints_beyond(rig, stand.scene):
        return False
    most = allowed(rig, stand)
    if stand.misfit <= most and departures(rig, stand, free).max(initial=0.0) <= FAR:
        return True
    if not settled.misfit <= most:
        return False
    # constants that bend for physics need not where all of it may be left
    eased = settle(rig, stand, free, most) if settled.farthest > FAR else settled
    return eased.misfit <= most and eased.farthest <= FAR


def is_right(rig: Rig, weighed: Weighed) -> bool:
    """Return whether a hypothesis is near, and not by tolerances that allow for anything: nothing else is looked for then."""
    return weighed.near and weighed.stand.misfit <= PHYSICS * motion(rig, weighed.stand)


def departures(rig: Rig, stand: Stand, free: tuple[str, ...]) -> Array:
    """Return how far constants that are known (of frames and instrument) are from where the file has them, in tolerances."""
    tolerance = rig.tolerances(stand.scene, free)
    known = tolerance > 0
    return np.asarray(np.abs(stand.p - stand.scene.p)[known] / tolerance[known])


def bound(rig: Rig, stand: Stand, free: tuple[str, ...], odds: float) -> float:
    """Return the logarithm of a hypothesis' evidence by frames alone; that these leave their tolerances costs."""
    if stand.bad:
        return -np.inf
    bent = float(np.sum(departures(rig, stand, free) ** 2)) / max(stand.residual.size, 1)
    return evidence(rig, stand.scene, stand.misfit * float(np.sqrt(1.0 + bent)), odds)


def allowed(rig: Rig, stand: Stand) -> float:
    """Return the largest misfit, in sigmas, of a machine as it is drawn; where nobody says how well it is, of any machine."""
    known = any(p.free for p in rig.machine.mechanism.parameters)
    most = 2.0 * expected(rig, stand) if known else ABSURD * motion(rig, stand)
    return max(FAR, most)


def best_of(every: Iterable[Weighed]) -> Weighed:
    """Return the hypothesis with the most evidence."""
    return max(every, key=lambda weighed: weighed.score)
