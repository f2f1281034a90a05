"""What joints do beside their readings: screws, gears, encoders, play, friction, creep; rails that are not straight.

Each function makes a ``Physics`` for joints of a machine; ``index`` tells the column of a joint. Sizes are mm of slides
and rad of turns. What memory there is runs along the path that the joint truly took.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from . import operators
from .base import Array, Imperfection, Kind, Place
from .ported import Act, Draw, Physics, Work, shapeless

TURN = 2 * np.pi
THRESHOLDS = (0.02, 0.06, 0.15, 0.35)
"""Half widths of the plays that make up a hysteresis, as shares of the range."""
WEIGHTS = (0.4, 0.3, 0.2, 0.1)
LOOP = 101
"""Points of each way of a full loop."""


@dataclass(frozen=True)
class Axes:
    """Joints by name in the order of the columns: (nq,) ranges, and by how much each overshoots before it arrives."""

    names: tuple[str, ...]
    low: Array
    high: Array
    overshoot: Array

    def index(self, place: Place) -> int:
        """Column of the joint at a place."""
        return self.names.index(place[0])

    def path(self, work: Work) -> Array:
        """(2 n, nq) turning points of the true path."""
        return operators.waypoints(work.campaign.q, work.campaign.approach, self.overshoot)

    def share(self, work: Work, k: int) -> Array:
        """(n,) where joint k stands in its range, 0 to 1."""
        return np.asarray((work.campaign.q[:, k] - self.low[k]) / (self.high[k] - self.low[k]))


def places(names: Iterable[str]) -> tuple[Place, ...]:
    """One place a name."""
    return tuple((name,) for name in names)


def phase(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
    """A phase, rad."""
    return {"phase": float(rng.uniform(0, TURN))}


def displacing(
    axes: Axes, kind: Kind, shift: Callable[[Work, Imperfection, int], Array], shape: Draw = shapeless
) -> Physics:
    """A kind that adds ``shift(work, imperfection, column)`` (n,) to its joint."""

    def act(work: Work, imperfection: Imperfection) -> None:
        k = axes.index(imperfection.place)
        work.moved[:, k] += shift(work, imperfection, k)

    return Physics(kind, act, shape)


def actuator_scale(axes: Axes, names: Sequence[str], typical: float) -> Physics:
    """The joint moves (1 + size) times its reading; geometry swallows much of it."""
    kind = Kind("actuator-scale", places(names), typical, "actuator-scale", conceals=True)
    return displacing(axes, kind, lambda work, i, k: i.size * work.campaign.q[:, k])


def screw_periodic(axes: Axes, names: Sequence[str], pitch: float, typical: float) -> Physics:
    """A screw's error of size mm once a turn, or twice (its nut or coupling is oval)."""

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"phase": float(rng.uniform(0, TURN)), "order": float(rng.choice([1, 1, 2]))}

    def shift(work: Work, i: Imperfection, k: int) -> Array:
        turned = TURN * i.shape["order"] * work.campaign.q[:, k] / pitch
        return np.asarray(i.size * np.sin(turned + i.shape["phase"]))

    kind = Kind("screw-periodic", places(names), typical, "screw-periodic")
    return displacing(axes, kind, shift, shape)


def backlash(axes: Axes, names: Sequence[str], typical: float) -> Physics:
    """Play of ``size`` in all."""
    approach = f"approach.{names[0]}"

    def shift(work: Work, i: Imperfection, k: int) -> Array:
        return np.asarray(
            operators.at_rows(operators.play(axes.path(work)[:, [k]], i.size / 2))[:, 0]
            - work.campaign.q[:, k]
        )

    return displacing(axes, Kind("backlash", places(names), typical, "backlash", (approach,)), shift)


def screw_windup(axes: Axes, names: Sequence[str], typical: float) -> Physics:
    """Friction of the nut twists the screw: lost motion that grows with the free length, ``size`` at the far end."""

    def shift(work: Work, i: Imperfection, k: int) -> Array:
        path = axes.path(work)[:, [k]]
        held = operators.at_rows(operators.presliding(path, [0.1 * axes.overshoot[k]], [1.0]))[:, 0]
        return np.asarray(-0.5 * i.size * held * axes.share(work, k))

    needs = (f"approach.{names[0]}",)
    return displacing(axes, Kind("screw-windup", places(names), typical, "screw-windup", needs), shift)


def piezo_hysteresis(axes: Axes, names: Sequence[str], typical: float) -> Physics:
    """Prandtl-Ishlinskii: plays in parallel; ``size`` is their share of the stroke."""

    def shift(work: Work, i: Imperfection, k: int) -> Array:
        reach = axes.high[k] - axes.low[k]
        widths = [t * reach * i.shape["width"] for t in THRESHOLDS]
        weights = [i.size * w for w in WEIGHTS]
        loop = operators.at_rows(operators.prandtl_ishlinskii(axes.path(work)[:, [k]], widths, weights))[:, 0]
        # the drawing's gain is that of the maker, who ran it to and fro over its whole range
        there = np.linspace(axes.low[k], axes.high[k], LOOP)
        full = np.concatenate([there, there[::-1], there, there[::-1]])
        whole = operators.prandtl_ishlinskii(full[:, None], widths, weights)[2 * LOOP :, 0]
        line = np.polyfit(full[2 * LOOP :], whole, 1)
        return np.asarray(loop - np.polyval(line, work.campaign.q[:, k]))

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"width": float(rng.uniform(0.6, 1.2))}

    needs = (f"approach.{names[0]}",)
    return displacing(
        axes, Kind("piezo-hysteresis", places(names), typical, "piezo-hysteresis", needs), shift, shape
    )


def piezo_creep(axes: Axes, names: Sequence[str], typical: float) -> Physics:
    """Creep of ``size`` of each step for every factor ten in time."""

    def shift(work: Work, i: Imperfection, k: int) -> Array:
        c = work.campaign
        return np.asarray(operators.creep(c.q[:, [k]], c.time, i.size, dwell=c.dwell)[:, 0])

    kind = Kind("piezo-creep", places(names), typical, "piezo-creep", ("time",), conceals=True)
    return displacing(axes, kind, shift)


def encoder_eccentricity(axes: Axes, names: Sequence[str], typical: float) -> Physics:
    """A disc off its axis by ``size`` of its radius, by the geometry of disc and head; its zero is zeroed."""

    def shift(work: Work, i: Imperfection, k: int) -> Array:
        q = work.campaign.q[:, k]
        zero = operators.eccentric_disc(np.zeros(1), i.size, i.shape["phase"])
        return np.asarray(operators.eccentric_disc(q, i.size, i.shape["phase"]) - zero - q)

    kind = Kind("encoder-eccentricity", places(names), typical, "encoder-eccentricity", conceals=True)
    return displacing(axes, kind, shift, phase)


def transmission_error(axes: Axes, names: Sequence[str], ratio: float, typical: float) -> Physics:
    """A gear's mesh error: once a turn of its input, and less at twice that."""

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        one, two = rng.uniform(0, TURN, 2)
        return {"phase": float(one), "second": float(two), "share": float(rng.uniform(0.1, 0.4))}

    def shift(work: Work, i: Imperfection, k: int) -> Array:
        sizes = (i.size, i.shape["share"] * i.size)
        phases = (i.shape["phase"], i.shape["second"])
        return operators.mesh_error(work.campaign.q[:, k], (ratio, 2 * ratio), sizes, phases)

    kind = Kind("transmission-error", places(names), typical, "transmission-error")
    return displacing(axes, kind, shift, shape)


def axis_coupling(axes: Axes, pairs: Sequence[tuple[str, str]], typical: float) -> Physics:
    """The driven joint moves by ``size`` times the driving one's reading. Place: driven, driving."""

    def shift(work: Work, i: Imperfection, k: int) -> Array:
        return np.asarray(i.size * work.campaign.q[:, axes.names.index(i.place[1])])

    return displacing(axes, Kind("axis-coupling", tuple(pairs), typical, "axis-coupling"), shift)


def zero_shift(axes: Axes, names: Sequence[str], typical: float) -> Physics:
    """Another zero from the second session on."""
    kind = Kind("zero-shift", places(names), typical, "zero-shift", ("session",))
    return displacing(axes, kind, lambda work, i, _: i.size * second_session(work))


def second_session(work: Work) -> Array:
    """(n,) 1 from the second session on."""
    return np.asarray(work.campaign.session > work.campaign.session.min(), dtype=float)


def rail_profile(shape: Mapping[str, float], share: Array) -> Array:
    """(n,) departure of a rail from the line through its ends, largest 1: monotone cubics between six clamps."""
    clamps = np.linspace(0.0, 1.0, 8)
    heights = np.array([0.0, *(shape[f"clamp{j}"] for j in range(6)), 0.0])
    smooth = PchipInterpolator(clamps, heights / np.max(np.abs(heights)))
    return np.asarray(smooth(np.clip(share, 0.0, 1.0)))


def rail_shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
    """Where a rail was clamped off its line, and which way it leaves it."""
    heights = np.cumsum(rng.standard_normal(8))
    heights = heights[1:-1] - np.interp(np.arange(1, 7), [0, 7], heights[[0, -1]])
    out = {f"clamp{j}": float(h) for j, h in enumerate(heights)}
    return out | {"direction": float(rng.uniform(0, TURN)), "turn": float(rng.uniform(0, TURN))}


def axis_straightness(axes: Axes, names: Sequence[str], typical: float, act: Act) -> Physics:
    """A rail that leaves its line by up to ``size``; ``act`` says what follows it."""
    kind = Kind("axis-straightness", places(names), typical, "axis-straightness", conceals=True)
    return Physics(kind, act, rail_shape)
