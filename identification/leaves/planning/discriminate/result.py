"""What an experiment that tells explanations apart is expected to say, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from truepose.arrays import Array
from truepose.identification.identifiability.observability import Note
from truepose.identification.leaves.planning.discriminate.explanations import Explanation
from truepose.identification.leaves.planning.discriminate.factors import Factor
from truepose.identification.leaves.planning.discriminate.rows import Rows
from truepose.identification.leaves.planning.discriminate.targets import Target
from truepose.models.machine.machine import Machine
from truepose.shown.result import Shown, frame

if TYPE_CHECKING:
    import pandas as pd

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


@dataclass(frozen=True)
class Worth:
    """What a kind of factor is worth: expected log Bayes factor when all of ``factors`` are held at their nominal
    value (offered), or varied over a usual span (not offered).

    opened: where that tells pairs apart which the plan cannot, the expected log Bayes factor of the worst of them.
    """

    kind: str
    factors: tuple[Factor, ...]
    offered: bool
    expected: float
    opened: float | None = None


@dataclass(frozen=True, repr=False)
class Experiment(Shown):
    """Rows to measure, in a sensible order, and what they are expected to tell.

    expected: of the worst pair; already: of the rows that exist; random (DRAWS,): of as many random rows.
    """

    machine: Machine
    explanations: tuple[Explanation, ...]
    rows: Rows
    reference: Array | None
    pairs: tuple[Pair, ...]
    expected: float
    already: float | None
    random: Array
    worth: tuple[Worth, ...]
    targets: tuple[tuple[Target, float], ...]
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

    def to_frame(self) -> pd.DataFrame:
        """The rows that ``truepose plan --discriminate`` writes: joints and what else varies, in the machine file's units."""
        return frame(self)
