"""What a diagnosis says, as data: everything that diagnosis.json and the report are written from.

What an alarm is: a statistic, judged by what chance makes of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from truepose.identification.fit.estimated import Estimate, Fitted
from truepose.identification.fit.summary import FitSummary
from truepose.identification.fit.tolerance_classes import PartClass
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.untestable import Missing, Untestable
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.empirical import Empirical
from truepose.models.file.driver import DriverKind
from truepose.models.file.sections import NO_WORSE
from truepose.models.machine.machine import Machine
from truepose.shown.result import Shown, Written

RAISED = 0.01
"""p below which an alarm is raised."""


@dataclass(frozen=True)
class Alarm:
    """A statistic, its p-value when nothing is missing, what it is about, and the share of the residual that this explains."""

    statistic: float
    p: float
    about: str = ""
    share: float = 0.0

    @property
    def raised(self) -> bool:
        """p below 1 %."""
        return self.p < RAISED


@dataclass(frozen=True)
class Quantity:
    """A value with its 1-sigma and unit."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Levels:
    """Probability that something is at a place, whatever drives it; its driver, and that this drives something there."""

    place: float = 0.0
    kind: DriverKind = "position"
    driver: float = 0.0


NAMED = 0.5
"""Probability from which on something is more probable than not, and is named."""
UNKNOWN = Levels()
"""Nothing is known."""


NOTABLE = 3.0
"""Log Bayes factor below which there is nothing to speak of: of a candidate alone, and between explanations as good."""
UNNAMED = "unknown"
"""What a report calls something that the catalogue does not know."""


@dataclass(frozen=True)
class Replication:
    """How probable a name is in each half of the rows (in time), and whether its amplitudes there agree.

    shown: whether each half could show it at all: what happens between two sessions is in neither.
    """

    halves: tuple[float, float]
    agree: bool
    shown: tuple[bool, bool] = (True, True)

    @property
    def least(self) -> float:
        """Smallest probability among the halves that could show it; 1 where none could."""
        return min((p for p, seen in zip(self.halves, self.shown, strict=True) if seen), default=1.0)

    @property
    def replicated(self) -> bool:
        """True if each half that could show it names it, and the amplitudes agree."""
        return self.agree and self.least >= NAMED


@dataclass(frozen=True)
class Alternative:
    """Another explanation, and how probable it is that it is there; tested: whether this recording could tell;
    kind: of its driver, None where that is not known."""

    effect: str
    place: tuple[str, ...]
    probability: float
    log_bayes_factor: float
    experiment: str = ""
    tested: bool = True
    kind: DriverKind | None = None

    @property
    def nameless(self) -> bool:
        """Whether it is something that the catalogue does not know."""
        return self.effect == UNNAMED


@dataclass(frozen=True)
class OpenQuestion:
    """The two likeliest explanations of a finding, as ``plan --discriminate`` names them.

    experiment: what the catalogue says of the first; levels: of columns that they read and that can be held, what the recording
    saw; tool: rms (mm) by which the finding moves the tool, 0 where no other question is open.
    """

    explanations: tuple[str, str]
    experiment: str
    levels: Mapping[str, tuple[float, ...]]
    tool: float = 0.0


@dataclass(frozen=True, repr=False)
class Finding(Shown):
    """One named effect at its place (or places with one cause).

    explanation, experiment: what its entry of the catalogue says. family: the effect, where it was found at all its places
    under one size; replication: None where the halves hold too little. levels: what is known of where it is and what drives
    it; ``probability`` is that of its law, 0 for ``empirical``, which has none; tested: whether the law's form could be.
    question: what more rows would tell; None where its law is sure, or no rows would.
    ``to_frame()``: its coefficients, one a row: ``coefficient``, ``value``, ``std`` (1-sigma), ``unit``.
    """

    effect: str
    place: tuple[str, ...]
    probability: float
    certainty: float
    log_bayes_factor: float
    equivalents: tuple[Alternative, ...]
    parameters: Mapping[str, Quantity]
    settings: tuple[Mapping[str, float], ...]
    flip_lambda: float | None
    explanation: str
    experiment: str
    family: str = ""
    replication: Replication | None = None
    levels: Levels = UNKNOWN
    tested: bool = True
    question: OpenQuestion | None = None

    @property
    def nameless(self) -> bool:
        """Whether only its place and its driver are known."""
        return self.effect == Empirical.slug

    @property
    def prior_dependent(self) -> bool:
        """Whether tolerances that are wider would do without the name."""
        return self.flip_lambda is not None


@dataclass(frozen=True)
class Lead:
    """What leads, less probable than not: an effect, its place, what is known of it, the probability of its law."""

    effect: str
    place: tuple[str, ...]
    levels: Levels
    probability: float


@dataclass(frozen=True)
class Form:
    """How a remainder goes with its driver, as a hypothesis.

    kind: ``order`` of rows, ``steps``, ``linear``, ``quadratic`` or ``periodic`` (``cycles`` over the driver's range),
    all with the share of the remainder that it explains; or what something without a name does: ``line``,
    ``curve``, ``product`` or ``warp``.
    """

    kind: str
    share: float = 0.0
    cycles: int = 0


@dataclass(frozen=True)
class Remainder:
    """What no finding explains: where, with which driver, in which form, how large (in sigma)."""

    place: tuple[str, ...]
    driver: str
    form: Form
    size_sigma: float
    gain: Mapping[str, float] = field(default_factory=dict)
    """By how much modelling it lowers the rms of held-out rows, by kind of reading (mm, rad)."""


@dataclass(frozen=True)
class SetOfEffects:
    """Effects with their places, and how probable it is that these and no others are there."""

    effects: tuple[tuple[str, tuple[str, ...]], ...]
    probability: float


@dataclass(frozen=True)
class Together:
    """A driver that surely acts at one of some places at least, likeliest first, although none of them is sure by itself."""

    driver: DriverKind
    places: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class BlockProof:
    """Rms of readings after over before on rows held out together, how many they are, and the same of the tool's position;
    extrapolates: whether they lie at the end of what was seen."""

    name: str
    rows: int
    ratio: float
    pose: float | None = None
    extrapolates: bool = False

    def worse_than(self, other: BlockProof | None) -> bool:
        """Whether either is worse than before, and than after another model where that is worse than before, too."""
        readings, pose = (1.0, 1.0) if other is None else (max(other.ratio, 1.0), max(other.pose or 1.0, 1.0))
        return self.ratio > NO_WORSE * readings or (self.pose or 0.0) > NO_WORSE * pose


@dataclass(frozen=True)
class Proof:
    """How the extended model does where it was not fitted, and what stands against chance."""

    held_out: str
    blocks: tuple[BlockProof, ...]
    ratio: float
    ratio_interval: tuple[float, float]
    placebo_gain: float | None
    black_box_ratio: float | None
    injected_recovered: bool | None


WHOLE = "whole"
"""All that was found is applied."""


@dataclass(frozen=True)
class PoseError:
    """Rms error of the tool's position on held-out rows after a rigid refit, mm: of plain calibration, and of a model."""

    plain: float
    model: float


@dataclass(frozen=True)
class Applied:
    """Which model ``improved.yaml`` holds, and how it was judged on rows that were not fitted.

    model: ``whole`` (all that was found, averaged over explanations), ``robot`` (less what the sensor may or may not do),
    ``names``, ``forms`` (without names), ``sure-names`` (place and driver known), or ``plain`` (the fit held to the
    drawing). held_out: the split; pose: None where no sensor reads the tool's position; ratio: of the rms of readings, over
    that of the better plain calibration. whole_pose, whole_ratio: the same of all that was found. baselines: rms error of the
    tool's position, mm, with the ``ordinary`` fit and the one held to the ``drawing``.
    """

    model: str
    held_out: str
    pose: PoseError | None
    ratio: float
    whole_pose: PoseError | None
    whole_ratio: float
    baselines: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, repr=False)
class Diagnosis(Written, Fitted):
    """The whole outcome.

    nominal: the machine that was diagnosed, with the values of its file.

    noise: in stated sigmas, and inflation: how many times wider than stated the tolerances of each class of parts look,
    both in the posterior. sets: the likeliest sets of effects; inclusion: every effect at every place with its probability;
    leading: what is less probable than not, but leads; disagreement: largest difference of a probability between the
    posterior's chains; applied: what ``after`` holds, and why; missing: what this machine likely has and the recording cannot
    show; together: drivers that surely act although no place of theirs is sure. ``truepose.identification.report.results``
    writes it down. examined: what ``diagnose`` was asked to say of the posterior besides; prior_notes: where the prior is
    from, if a fleet left it.

    It stands for its ``machine``, the improved one, in every function that takes a machine.
    ``report(path)`` writes the report, ``save(directory)`` ``diagnosis.json``, ``improved.yaml`` and ``report.html``; the
    constants are in ``after.to_frame()``.
    ``to_frame()``: findings, one a row: ``effect``, ``place``, ``probability`` (of the law; NaN where none is known),
    ``place_probability``, ``driver`` (what it varies with), ``driver_probability``, ``or_else`` (explanations that are as
    good), ``amplitudes`` (with 1-sigma and unit), ``explanation``, ``experiment`` (that would separate it).
    """

    nominal: Machine
    recording: Recording
    verdict: str
    concealed: bool
    alarms: Mapping[str, Alarm]
    alarms_after: Mapping[str, Alarm]
    findings: tuple[Finding, ...]
    remainder: Remainder | None
    candidates: tuple[Alternative, ...]
    evidence_map: Mapping[str, float]
    untestable: tuple[Untestable, ...]
    free: Estimate
    before: Estimate
    after: Estimate
    fits: Mapping[str, FitSummary]
    proof: Proof | None
    terms: tuple[PlacedEffect, ...]
    outlier_rows: tuple[int, ...]
    noise: float
    inflation: Mapping[PartClass, float]
    sets: tuple[SetOfEffects, ...] = ()
    inclusion: tuple[Alternative, ...] = ()
    leading: tuple[Lead, ...] = ()
    disagreement: float = 0.0
    budget_spent: bool = False
    """Whether the chains ended with their budget of work, before they agreed or were long enough."""
    stopped: bool = False
    """Whether somebody asked the search to end before that."""
    applied: Applied | None = None
    missing: tuple[Missing, ...] = ()
    together: tuple[Together, ...] = ()
    examined: Any = None
    prior_notes: tuple[str, ...] = ()

    @property
    def structure(self) -> Alarm:
        """What residuals still follow: the driver and the share of them that it explains."""
        return self.alarms_after["structure"]
