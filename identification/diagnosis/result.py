"""What a diagnosis says, as data: everything that diagnosis.json and the report are written from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from truepose.identification.diagnosis.alarms import Alarm, Structure
from truepose.identification.diagnosis.candidates import Untestable
from truepose.identification.diagnosis.unnamed import UNNAMED
from truepose.identification.fit.estimate import Estimate
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine import Machine


@dataclass(frozen=True)
class Quantity:
    """A value with its 1-sigma and unit."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Alternative:
    """Another explanation with its share of the probability."""

    effect: str
    place: tuple[str, ...]
    probability: float
    log_bayes_factor: float
    experiment: str = ""

    @property
    def nameless(self) -> bool:
        """Whether it is something that the catalogue does not know."""
        return self.effect == UNNAMED


@dataclass(frozen=True)
class Finding:
    """One named effect at its place (or places with one cause)."""

    effect: str
    place: tuple[str, ...]
    probability: float
    certainty: float
    log_bayes_factor: float
    equivalents: tuple[Alternative, ...]
    parameters: Mapping[str, Quantity]
    settings: tuple[Mapping[str, float], ...]
    prior_dependent: bool
    flip_lambda: float | None
    explanation: str
    separating_experiment: str


@dataclass(frozen=True)
class Remainder:
    """What no finding explains: where, with which driver, in which form, how large (in sigma)."""

    place: tuple[str, ...]
    driver: str
    form: str
    size_sigma: float


@dataclass(frozen=True)
class BlockProof:
    """Rms after over before on rows held out together, and how many they are."""

    name: str
    rows: int
    ratio: float


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


@dataclass(frozen=True)
class FitSummary:
    """rms by kind (internal units), chi2 per degree of freedom, validation rms, worst parameter."""

    rms: Mapping[str, float]
    chi2_per_dof: float
    validation_rms: Mapping[str, float] | None
    worst_parameter_sigma: float
    worst_parameter: str
    worst_allowed: float


@dataclass(frozen=True)
class Diagnosis:
    """The whole outcome; ``truepose.identification.report.results`` writes it down."""

    machine: Machine
    recording: Recording
    verdict: str
    concealed: bool
    alarms: Mapping[str, Alarm]
    alarms_after: Mapping[str, Alarm]
    structure: Structure
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
    notes: tuple[str, ...]
