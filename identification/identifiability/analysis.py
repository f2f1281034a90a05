"""What poses can and cannot tell about a machine, before or after it is measured: readings are not needed.

Jacobians are exact, at the drawing and at machines drawn from the tolerances. The first alone would mislead
where the drawing is special: neighbouring axes that are exactly parallel hide an offset that shows as soon as
they are not. A direction counts as unseen only when it stays unseen on every machine drawn.

Poses to look at: drawn over the joints' ranges or recorded, with readings or without, and what they see.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array, Mask
from truepose.errors import InputError
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.decomposition import Decomposition, Observability
from truepose.identification.fit.leastsquares import triangular
from truepose.identification.fit.problem import Prior, prior_of
from truepose.identification.fit.set_ups import with_set_ups
from truepose.identification.identifiability.observability import (
    Columns,
    Direction,
    Knowledge,
    Note,
    Subset,
    determined,
    independent_subset,
    nearly_unseen,
    unseen,
)
from truepose.identification.identifiability.patterns import Blind
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import coupling_matrix
from truepose.shown.result import Shown

SEED = 20


def drawn_poses(machine: Machine, n: int, seed: int = SEED) -> Recording:
    """``n`` configurations drawn evenly over the joints' ranges; changes count from the first one.

    Raises InputError naming the joint that has no range, and for a sensor that compares rows by labels.
    """
    ranges = []
    for actuator in machine.mechanism.actuators:
        if actuator.reading_range is None or not np.isfinite(actuator.reading_range).all():
            raise InputError(
                f"{machine.name}: joint {actuator.reading}: found no range to draw poses from, expected "
                "'range: [low, high]', or a file of poses"
            )
        ranges.append(actuator.reading_range)
    for sensor in machine.sensors:
        if sensor.label_columns:
            raise InputError(
                f"{machine.name}: poses cannot be drawn for a sensor that needs the columns "
                f"{', '.join(sensor.label_columns)}; expected a file of poses"
            )
    low, high = np.array(ranges, dtype=float).T
    q = low + (high - low) * np.random.default_rng(seed).random((n, len(low)))
    return Recording(
        joints=machine.mechanism.readings,
        uncoupling=coupling_matrix(machine.mechanism),
        q=q,
        observations={},
        labels={},
        drivers={},
        files=("drawn poses",),
        source_file=np.zeros(n, dtype=np.int64),
        source_row=np.arange(1, n + 1),
        session=np.ones(n, dtype=np.int64),
        session_recorded=np.zeros(n, dtype=np.bool_),
        validation=np.zeros(n, dtype=np.bool_),
        pose=np.arange(1, n + 1),
        from_row=np.zeros(n, dtype=np.int64),
        shuffled=True,
    )


def measured(machine: Machine, recording: Recording) -> bool:
    """Whether every column of every sensor was recorded."""
    return all(name in recording.observations for sensor in machine.sensors for name in sensor.columns)


def with_observations(machine: Machine, recording: Recording) -> Predictor:
    """A predictor whose recording has readings: where some are missing, what the sensors should have read."""
    predictor = Predictor(machine, recording, machine.effects)
    if measured(machine, recording):
        return predictor
    p = predictor.model.p_home
    x, good = predictor.assemble(p)
    x[~good] = predictor.model.home
    names, values, _ = predictor.values(p, x)
    read = dict(zip(names, np.where(good[:, None], values, 0.0).T, strict=True))
    complete = copy.copy(predictor)
    complete.recording = replace(recording, observations={**recording.observations, **read})
    return complete


@dataclass(frozen=True)
class Seen:
    """Triangular factor (n_free, n_free) of the scaled Jacobian, rows (n,) that are in it, how many readings
    say anything."""

    factor: Array
    used: Mask
    n_observations: int

    @classmethod
    def at(cls, predictor: Predictor, prior: Prior, p: Array) -> Seen:
        """At parameters ``p`` (np,)."""
        x, good = predictor.assemble(p)
        used = good & ~predictor.recording.validation
        free, count = prior.free, 0

        def rows() -> Iterator[Array]:
            nonlocal count
            for block in predictor.blocks(p, x, used):
                jacobian = block.jacobian[used[block.rows]][:, :, free] * prior.scale[free]
                flat = jacobian.reshape(-1, len(free))
                count += int(np.sum(np.any(flat != 0.0, axis=1)))
                yield flat

        return cls(triangular(rows(), len(free)), used, count)


DRAWN_POSES = 100
DRAWN_MACHINES = 4
UNTOUCHED = 0.9
"""Above this share of the tolerance the readings have said next to nothing."""
SAME = 0.999
"""Cosine above which a direction unseen at the drawing is one unseen on a machine as built."""
WELL_SEEN = 3.0
"""Sigmas a tolerance from which a direction unseen at the drawing counts as seen on a machine as built."""
UNBOUNDED_SPREAD = 0.1
"""How far parameters of infinite tolerance are drawn, in steps (100 mm, 1 rad)."""


@dataclass(frozen=True)
class ParameterSight:
    """One free parameter: unit (mm, rad or an effect's own), tolerance, the 1-sigma to expect after the
    measurement (at the drawing, and rms over machines as built), a status and who it trades with.

    status: ``determined`` (the readings at least halve its variance, and no unseen direction moves it),
    ``tolerance decides`` (over nine tenths of the tolerance are left), ``nothing decides`` (no tolerance either),
    ``partly`` (what is between).
    """

    name: str
    unit: str
    tolerance: float
    std_at_drawing: float
    std: float
    status: str
    partners: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class Identifiability(Shown):
    """What a set of poses can tell.

    files: recordings, or none where poses were drawn (then ``seed`` says how); poses and readings used. rank:
    directions seen on machines as built, rank_at_drawing: at the drawing. indices: O1 to O5 at the drawing.
    unseen: never seen, and what they mean together; unseen_at_drawing: seen on machines as built only,
    where the readings see the best of them to ``as_built_size`` sigmas a tolerance; nearly: seen worse than the
    tolerances say; subset: parameters that can be told apart.
    ``to_frame()``: free constants, one a row: ``parameter``, ``unit``, ``tolerance``, ``std`` (to expect after the
    measurement, rms over machines as built), ``std_at_drawing``, ``status``, ``trades_with`` (names). mm, rad or an
    effect's own unit.
    """

    machine: str
    files: tuple[str, ...]
    seed: int | None
    poses: int
    n_observations: int
    free: int
    rank: int
    rank_at_drawing: int
    indices: Observability
    parameters: tuple[ParameterSight, ...]
    unseen: Blind
    unseen_at_drawing: tuple[Direction, ...]
    as_built_size: float
    nearly: tuple[Direction, ...]
    subset: Subset
    known: Knowledge
    notes: tuple[Note, ...] = ()


def identifiability(
    machine: Machine,
    recording: Recording | None = None,
    *,
    poses: int = DRAWN_POSES,
    machines: int = DRAWN_MACHINES,
    seed: int = SEED,
) -> Identifiability:
    """What the poses of ``recording`` tell, or ``poses`` drawn over the ranges of the joints.

    Rows for validation do not count. Readings may be
    missing; where they are there they only say where a base of wide tolerance stands. Raises InputError where a joint
    has no range to draw from, where nothing is free, and when no row can be assembled.
    """
    rows = drawn_poses(machine, poses, seed) if recording is None else recording
    machine = with_set_ups(machine, rows)
    predictor = with_observations(machine, rows)
    prior = prior_of(machine, machine.effects)
    home = aligned_start(predictor) if measured(machine, rows) else predictor.model.p_home.copy()
    seen = Seen.at(predictor, prior, home)
    if not seen.used.any():
        raise InputError(f"{', '.join(rows.files)}: found no row in which {machine.name} can be assembled")
    weight = np.where(np.isinf(prior.sigma), 0.0, prior.scale / np.where(prior.sigma > 0, prior.sigma, 1.0))
    weight = weight[prior.free]
    known = Knowledge.at(prior, machine.parameter_units, home, Decomposition.of(seen.factor, weight))
    built = [
        Decomposition.of(Seen.at(predictor, prior, p).factor, weight)
        for p in _as_built(prior, home, machines, np.random.default_rng(seed))
    ]
    return _judged(predictor, rows, seed if recording is None else None, home, known, built, seen)


def _as_built(prior: Prior, home: Array, count: int, rng: np.random.Generator) -> Iterator[Array]:
    """Parameters drawn from the tolerances about ``home``."""
    spread = np.where(np.isinf(prior.sigma), UNBOUNDED_SPREAD * prior.scale, prior.sigma)
    effects = np.array([part == "effect" for part in prior.parts])
    spread[effects] = 0.0  # their spread allows for any effect; the machine has those of its file
    for _ in range(count):
        yield home + spread * rng.standard_normal(len(home))


def _judged(
    predictor: Predictor,
    recording: Recording,
    seed: int | None,
    home: Array,
    known: Knowledge,
    built: list[Decomposition],
    seen: Seen,
) -> Identifiability:
    here = known.decomposition
    best = max([here, *built], key=lambda parts: parts.rank)
    lasting, hidden = _parted(here.null_space, best.null_space)
    never = Blind.of(known, lasting, predictor.machine, home)
    size = float(best.singular[here.rank]) if best.rank > here.rank else 0.0
    blind = lasting if size >= WELL_SEEN else here.null_space
    std = np.sqrt(np.mean([(parts.std * known.scale) ** 2 for parts in built or [here]], axis=0))
    lost = np.flatnonzero(~seen.used & ~recording.validation)
    return Identifiability(
        machine=predictor.machine.name,
        files=recording.files if seed is None else (),
        seed=seed,
        poses=int(seen.used.sum()),
        n_observations=seen.n_observations,
        free=len(known.names),
        rank=best.rank,
        rank_at_drawing=here.rank,
        indices=here.observability(seen.n_observations),
        parameters=_sights(known, std, never.directions, blind),
        unseen=never,
        unseen_at_drawing=unseen(known, hidden),
        as_built_size=size,
        nearly=nearly_unseen(known),
        subset=independent_subset(Columns(known.names, seen.factor, known.scale)),
        known=known,
        notes=tuple(Note("unassembled", recording.where(int(k))) for k in lost),
    )


def _parted(here: Array, built: Array) -> tuple[Array, Array]:
    """Directions unseen at the drawing in two: those that a machine as built hides too, and the others.

    Unseen directions turn with the parameters, so that as many as remain are matched by the angle between
    the two null spaces.
    """
    if len(here) <= len(built):
        return here, here[:0]
    turn, _, _ = np.linalg.svd(here @ built.T)
    matched = turn.T @ here
    return matched[: len(built)], matched[len(built) :]


def _sights(
    known: Knowledge, std: Array, never: tuple[Direction, ...], blind: Array
) -> tuple[ParameterSight, ...]:
    seen = determined(known, std, blind)
    out = []
    for k, name in enumerate(known.names):
        partners = dict.fromkeys(n for d in never if name in d.parts for n in d.parts if n != name)
        tolerance, own = float(known.sigma[k]), float(std[k])
        status = _status(bool(seen[k]), own, tolerance)
        drawn = float(known.std[k])
        out.append(ParameterSight(name, known.units[k], tolerance, drawn, own, status, tuple(partners)))
    return tuple(out)


def _status(seen: bool, std: float, tolerance: float) -> str:
    if np.isinf(std):
        return "nothing decides"
    if seen:
        return "determined"
    return "tolerance decides" if std > UNTOUCHED * tolerance else "partly"
