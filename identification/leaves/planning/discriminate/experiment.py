"""The experiment that splits explanations which a diagnosis cannot tell apart.

``discriminate`` chooses rows (pose, payload, temperature, side, time) that maximise the expected log Bayes factor of
whatever is true against its worst rival, geometry marginalised under its tolerances (``criterion``),
and says what it is expected to tell.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.identifiability.observability import Note
from truepose.identification.leaves.planning.discriminate.factors import (
    Class,
    Explanation,
    Factor,
    Offer,
    factors,
    unplanned,
)
from truepose.identification.leaves.planning.discriminate.hypotheses import (
    Field,
    Hypothesis,
    hypotheses,
    ordered,
    race,
    shares,
)
from truepose.identification.leaves.planning.discriminate.pool import Pool
from truepose.identification.leaves.planning.discriminate.race import Race, chosen
from truepose.identification.leaves.planning.discriminate.rows import Rows, recording_of, signals
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.file.driver import AIR, PAYLOAD, Driver
from truepose.models.machine.machine import Machine, Mass
from truepose.shown.result import Shown
from truepose.wording import joined

# -- What an experiment that tells explanations apart is expected to say, as data

SPLIT = 3.0
"""Expected log Bayes factor from which two explanations are told apart: the diagnosis' own threshold."""
IDENTICAL = 1e-5
"""Share of a signal below which what a rival cannot reproduce is rounding, and its own wide prior."""


@dataclass(frozen=True)
class Pair:
    """How well ``true`` is told from ``rival``: expected log Bayes factor of the plan.

    share: of the true signal on all rows that may be taken, what the rival cannot reproduce; separable: whether those
    rows would tell them apart at all; twins: the same function by construction.
    """

    true: Explanation
    rival: Explanation
    expected: float
    share: float
    separable: bool
    twins: bool

    @property
    def identical(self) -> bool:
        """Whether no size would help: the rival does the same to every reading."""
        return self.twins or self.share < IDENTICAL


@dataclass(frozen=True, repr=False)
class Experiment(Shown):
    """Rows to measure, in a sensible order, and what they are expected to tell.

    expected: of the worst pair; already: of the rows that exist; random (DRAWS,): of as many random rows; held: drivers that
    explanations read and nobody offered to vary.
    ``to_frame()``: the rows that ``truepose plan --discriminate`` writes: joints and what else varies, in the machine
    file's units.
    """

    machine: Machine
    explanations: tuple[Explanation, ...]
    rows: Rows
    reference: Array | None
    pairs: tuple[Pair, ...]
    expected: float
    already: float | None
    random: Array
    held: tuple[str, ...]
    seed: int
    notes: tuple[Note, ...] = ()

    @property
    def splits(self) -> bool:
        """Whether every pair is expected to be told apart."""
        return self.expected >= SPLIT and not self.stuck

    @property
    def stuck(self) -> tuple[Pair, ...]:
        """Pairs that no row that may be taken tells apart, each once."""
        stuck = {frozenset((p.true.name, p.rival.name)): p for p in self.pairs if not p.separable}
        return tuple(stuck.values())

    @property
    def hopeless(self) -> bool:
        """Whether no row that may be taken tells any pair apart."""
        return not any(pair.separable for pair in self.pairs)


# -- The experiment that splits explanations which a diagnosis cannot tell apart

DRAWS = 20
"""Random sets of rows that the plan is compared with."""


def discriminate(
    machine: Machine,
    n: int,
    wanted: Class,
    *,
    offer: Offer | None = None,
    recorded: Recording | None = None,
    candidates: Array | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> Experiment:
    """``n`` rows that tell the explanations of ``wanted`` apart; the same from the same ``seed``.

    ``offer`` says what may be varied beside the joints; sides of approach, time and sessions always are where an
    explanation reads them. ``recorded`` are rows that exist already, ``candidates`` (c, nq) the only poses that may be
    chosen. Raises InputError for fewer than two different explanations, and as ``plan`` does.
    """
    _check(wanted.explanations, n)
    offer, parts = offer or {}, _parts(wanted)
    machine, notes = _weighing(machine, parts, offer)
    varied = factors(machine, parts, offer)
    rng = np.random.default_rng(seed)
    progress("looking at candidates")
    pool = Pool.of(machine, varied, candidates, rng)
    progress("looking at what they would tell")
    stage = _Stage.of(machine, pool, parts, wanted, recorded, n)
    progress("choosing rows")
    design = chosen(stage.main, n) if stage.main.counted.any() else stage.drawn(n, rng)
    random = [stage.worst(stage.values(stage.drawn(n, rng))) for _ in range(DRAWS)]
    values = stage.values(design)
    return Experiment(
        machine=machine,
        explanations=wanted.explanations,
        rows=_in_order(pool.rows.take(design)),
        reference=pool.reference if any(s.differs_from_row for s in machine.sensors) else None,
        pairs=stage.pairs(wanted.explanations, values),
        expected=stage.worst(values),
        already=None if recorded is None else stage.worst(stage.values([])),
        random=np.array(random),
        held=tuple(factor.driver for factor in varied if len(factor.levels) == 1),
        seed=seed,
        notes=(*wanted.notes, *notes, *unplanned(parts), *_unused(offer, varied)),
    )


@dataclass(frozen=True)
class _Stage:
    """Rows with what they would tell, hypotheses about it, and the race between them on the rows that are offered."""

    field: Field
    found: tuple[Hypothesis, ...]
    main: Race

    @classmethod
    def of(
        cls,
        machine: Machine,
        pool: Pool,
        parts: Sequence[PlacedEffect],
        wanted: Class,
        recorded: Recording | None,
        n: int,
    ) -> _Stage:
        """From the rows of a pool, to be added to those that exist already."""
        every = signals(machine, recording_of(machine, pool.rows, pool.reference), parts)
        told = every.take(np.arange(1, len(pool.rows) + 1))  # without the reference row before them
        base = np.zeros_like(told.gram) if recorded is None else signals(machine, recorded, parts).gram
        field = Field(told, base, parts, wanted.others)
        everywhere = field.rows.gram * (n / len(pool.rows)) + field.base
        known = field.base
        if recorded is None:
            known = field.rows.take(pool.nominal).gram * (n / np.sum(pool.nominal))
        found = hypotheses(field, wanted.explanations, known, everywhere)
        return cls(field, found, race(field, found))

    def drawn(self, n: int, rng: np.random.Generator) -> list[int]:
        """``n`` random rows of those that are offered."""
        available = len(self.field.every)
        return [int(row) for row in rng.choice(available, n, replace=n > available)]

    def values(self, design: Sequence[int]) -> Array:
        """(p,) expected log Bayes factors; 0 where no row tells."""
        return np.where(self.main.counted, self.main.values(design), 0.0)

    def worst(self, values: Array) -> float:
        """Of values (p,), the least of those pairs that the plan can tell apart; 0 without any."""
        return float(np.min(values[self.main.counted])) if self.main.counted.any() else 0.0

    def pairs(self, explanations: Sequence[Explanation], values: Array) -> tuple[Pair, ...]:
        """Every ordered pair with its value."""
        share, counted = shares(self.field, self.found, self.main), self.main.counted
        pairs = [(explanations[i], explanations[j]) for i, j in ordered(len(explanations))]
        return tuple(
            Pair(a, b, float(values[k]), float(share[k]), bool(counted[k]), a.twin_of(b))
            for k, (a, b) in enumerate(pairs)
        )


def _check(explanations: Sequence[Explanation], n: int) -> None:
    names = [e.name for e in explanations]
    if len(set(names)) < len(names) or len(names) < 2:
        raise InputError(
            f"--discriminate: found {joined(names)}, expected two or more different explanations"
        )
    if n < 2:
        raise InputError(f"found {n} rows, expected at least 2")


def _parts(wanted: Class) -> tuple[PlacedEffect, ...]:
    """Every effect of every version, each once."""
    every = [part for e in wanted.explanations for form in e.forms for part in form]
    return tuple({part.label: part for part in (*every, *wanted.others)}.values())


def _weighing(machine: Machine, parts: Sequence[PlacedEffect], offer: Offer) -> tuple[Machine, list[Note]]:
    """The machine with a payload to be stepped, where loads matter and the file has none."""
    asked = any(part.needs_load for part in parts) and machine.loaded
    if not asked or any(mass.name == PAYLOAD for mass in machine.masses):
        return machine, []
    hung = replace(machine, masses=(*machine.masses, Mass(PAYLOAD, 0.0, (0.0, 0.0, 0.0), "tool")))
    return hung, [Note("payload")] if PAYLOAD in offer else []


def _in_order(rows: Rows) -> Rows:
    """As one would measure: by session and time, and what takes long to change is changed seldom."""
    pace = {kind: k for k, kind in enumerate(_SLOW)}  # of what has no pace of its own: as the payload
    slow = sorted(rows.drivers, key=lambda name: pace.get(Driver.of(name).kind, pace[PAYLOAD]))
    keys = [
        *(rows.q[:, k] for k in range(rows.q.shape[1] - 1, -1, -1)),
        *(rows.drivers[n] for n in reversed(slow)),
    ]
    return rows.take(np.lexsort(keys).astype(np.intp))


_SLOW = ("session", "time", "pressure", "humidity", "temperature", "payload", "velocity", "approach")


def _unused(offer: Offer, varied: Sequence[Factor]) -> list[Note]:
    read = {f.driver for f in varied}
    shared = any(Driver.of(name).thermal for name in read)
    return [
        Note("unread", driver) for driver in offer if driver not in read and not (driver == AIR and shared)
    ]
