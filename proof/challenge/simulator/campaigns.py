"""How a measurement goes: rounds over shuffled poses, each joint from a drawn side, load steps, a warming room.

A machine says what can be varied (``Setting``); ``draw`` makes a campaign of it by a plan, ``joined`` lets one
campaign follow another. Poses are visited in rounds, so that repeats lie far apart in time; the repeat of a pose
comes from the opposite sides. A pose keeps its load: the same joints under another load are another pose.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .base import Array, Campaign, Plan
from .heat import REFERENCE, lump, motor_heat

PRESSURE = 1013.25
NIGHT = 57_600.0
"""s between the sessions of a campaign."""


def everywhere(_: Array) -> bool:
    """Accepts any readings (nq,)."""
    return True


@dataclass(frozen=True)
class Setting:
    """What a machine lets an experimenter vary.

    low, high: (nq,) ranges of the readings, mm and rad. payloads: kg, the first is nominal; heavier: kg for
    extreme plans. thermometers: logged places (``temperature.<place>``); ``air`` may be among them. interval: s
    between rows. speed: (nq,) of moves, mm/s and rad/s. accept: whether a pose (nq,) may be measured. changes:
    the sensor reads changes of length. step: readings are rounded to it (mm; np.radians(1e-4) for angles, so that
    a file in degrees holds them exactly). lags: s of bodies behind the air, drawn for those not named.
    """

    low: Array
    high: Array
    thermometers: tuple[str, ...] = ()
    payloads: tuple[float, ...] = (0.0,)
    heavier: float = 0.0
    interval: tuple[float, float] = (30.0, 90.0)
    speed: float | Array = 0.5
    accept: Callable[[Array], bool] = everywhere
    changes: bool = False
    step: float | Array = 1e-7
    lags: Mapping[str, float] = field(default_factory=dict)


def draw(setting: Setting, plan: Plan, rng: np.random.Generator) -> Campaign:
    """A campaign by the plan. Rows of an extreme plan are all for validation."""
    q, load = _poses(setting, plan, rng)
    number, side = _visits(q, load, plan, rng)
    n = len(number)
    session = np.minimum(np.arange(n) * plan.sessions // max(n, 1), plan.sessions - 1).astype(np.int64)
    time = np.cumsum(rng.uniform(*setting.interval, n)) + NIGHT * session
    temperatures, pressure = _weather(setting, plan, time.round(1), session, q[number], rng)
    held = np.ones(len(q), dtype=bool) if plan.extreme else _held_out(len(q), plan.held_out, rng)
    rows = np.arange(n)
    speeds = rng.uniform(-1, 1, (n, q.shape[1])) * setting.speed
    return Campaign(
        q=q[number],
        time=time.round(1),
        pose=number + 1,
        approach=np.where(speeds < 0, -1.0, 1.0) if plan.moving else side,
        session=session + 1,
        payload=load[number],
        temperatures=temperatures,
        pressure=pressure,
        validation=held[number],
        origin=_origins(number) if setting.changes else rows,
        velocity=speeds.round(6) if plan.moving else None,
        dwell=np.full(n, rng.uniform(1.0, 4.0)).round(2),  # the program waits alike before every reading
    )


def joined(first: Campaign, second: Campaign, pause: float = 1800.0) -> Campaign:
    """``second`` done after ``first``, ``pause`` seconds later, in the last session of the first.

    Places logged in only one of them are left out; pose numbers of the second follow those of the first.
    """
    later = first.time[-1] + pause - second.time[0]
    places = [name for name in first.temperatures if name in second.temperatures]
    stack = {
        name: np.concatenate([getattr(first, name), getattr(second, name)])
        for name in ("q", "approach", "payload", "pressure", "validation")
    }
    return replace(
        first,
        **stack,
        time=np.concatenate([first.time, second.time + later]),
        pose=np.concatenate([first.pose, second.pose + first.pose.max()]),
        session=np.concatenate([first.session, second.session - second.session.min() + first.session[-1]]),
        temperatures={p: np.concatenate([first.temperatures[p], second.temperatures[p]]) for p in places},
        origin=np.concatenate([first.origin, second.origin + len(first)]),
        velocity=_both(first.velocity, second.velocity),
        dwell=_both(first.dwell, second.dwell),
    )


def _both(first: Array | None, second: Array | None) -> Array | None:
    return None if first is None or second is None else np.concatenate([first, second])


def _poses(setting: Setting, plan: Plan, rng: np.random.Generator) -> tuple[Array, Array]:
    """(poses, nq) readings and (poses,) loads; under a plan with loads a third are others' joints under another load."""
    fresh = plan.poses - plan.poses // 3 if plan.loads and len(setting.payloads) > 1 else plan.poses
    drawn: list[Array] = []
    for _ in range(10_000 * plan.poses):
        if len(drawn) == fresh:
            break
        pose = _pose(setting, plan.extreme, rng)
        if setting.accept(pose):
            drawn.append(pose)
    if len(drawn) < fresh:
        raise ValueError(
            f"found {len(drawn)} poses that the machine accepts, expected {fresh}: is its range right?"
        )
    q = np.array(drawn).reshape(fresh, len(setting.low))
    if not plan.loads or len(setting.payloads) < 2:
        return q, np.full(fresh, setting.payloads[0])
    loads = np.array((setting.payloads[0], setting.heavier) if plan.extreme else setting.payloads)
    chosen = rng.integers(len(loads), size=fresh)
    again = rng.permutation(fresh)[: plan.poses - fresh]
    other = (chosen[again] + rng.integers(1, len(loads), size=len(again))) % len(loads)
    return np.concatenate([q, q[again]]), loads[np.concatenate([chosen, other])]


def _pose(setting: Setting, extreme: bool, rng: np.random.Generator) -> Array:
    """(nq,) readings within 85 % of the ranges; an extreme pose has half of its joints in the last tenth."""
    span, middle = (setting.high - setting.low) / 2, (setting.high + setting.low) / 2
    u = rng.uniform(-0.85, 0.85, len(span))
    if extreme:
        out = rng.random(len(span)) < 0.5
        u = np.where(out, np.where(u < 0, -1, 1) * rng.uniform(0.9, 1.0, len(span)), u)
    q: Array = np.round((middle + span * u) / setting.step) * setting.step
    return q


def _visits(q: Array, load: Array, plan: Plan, rng: np.random.Generator) -> tuple[NDArray[np.int64], Array]:
    """Pose of each row and the side (n, nq) each joint comes from: rounds, loads one after another within a round."""
    first = rng.choice([-1.0, 1.0], q.shape)
    numbers, sides = [], []
    for visit in range(plan.repeats):
        turn = {kg: place for place, kg in enumerate(rng.permutation(np.unique(load)))}
        order = sorted(rng.permutation(len(q)), key=lambda k: turn[load[k]])
        numbers.append(np.array(order, dtype=np.int64))
        flip = (-1.0) ** visit if plan.both_sides else 1.0
        sides.append(flip * first[order] if plan.both_sides else np.ones((len(q), q.shape[1])))
    return np.concatenate(numbers), np.concatenate(sides)


def _held_out(poses: int, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """(poses,) which poses are for validation."""
    chosen = np.zeros(poses, dtype=bool)
    chosen[rng.permutation(poses)[: round(share * poses)]] = True
    return chosen


def _origins(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) the row that each change counts from: the latest row of another pose; its own for the first row."""
    return np.maximum(np.arange(len(number)) - 1, 0).astype(np.int64)


def _weather(
    setting: Setting, plan: Plan, time: Array, session: NDArray[np.int64], q: Array, rng: np.random.Generator
) -> tuple[dict[str, Array], Array]:
    """Temperatures (n,) of the logged places and pressure (n,): nominal and steady without heat in the plan."""
    n = len(time)
    if not plan.heat:
        return {place: np.full(n, REFERENCE) for place in setting.thermometers}, np.full(n, PRESSURE)
    air = _air(plan, time, session, rng)
    temperatures = {}
    for place in setting.thermometers:
        lag = setting.lags.get(place, float(rng.uniform(120, 900)))
        rise = 0.0 if place == "air" else float(rng.uniform(0, 5)) * (2.0 if plan.extreme else 1.0)
        effort = np.abs(np.diff(q, axis=0, prepend=q[:1])) @ rng.dirichlet(np.ones(q.shape[1]))
        work = motor_heat(time, effort / (effort.max() or 1.0), float(rng.uniform(900, 3600)))
        temperatures[place] = (lump(time, air, 0.0 if place == "air" else lag) + rise * work).round(3)
    pressure = PRESSURE + rng.uniform(-8, 8) + np.cumsum(rng.normal(0, 0.1, n))
    return temperatures, pressure.round(2)


def _air(plan: Plan, time: Array, session: NDArray[np.int64], rng: np.random.Generator) -> Array:
    """(n,) degC: in each session the room climbs towards its own end, with a wave of its air conditioning."""
    air = np.zeros(len(time))
    for k in np.unique(session):
        rows = session == k
        since = time[rows] - time[rows][0]
        climb = rng.uniform(3.0, 7.0) + (6.0 if plan.extreme else 0.0)
        pace = rng.uniform(0.3, 0.8) * max(float(since[-1]), 1.0)
        wave = rng.uniform(0.2, 0.6) * np.sin(
            2 * np.pi * since / rng.uniform(1200, 2700) + rng.uniform(0, 6.28)
        )
        air[rows] = rng.uniform(18.5, 21.5) + climb * (1 - np.exp(-since / pace)) + wave
    return air
