"""The likeliest set, what has no name included, fitted without linearisation; and what of it may be applied.

A model may predict readings better and leave the tool worse, where a form without a name took what the robot does. So
models are tried: all that was found, less what the sensor is said to do and may not, names alone, forms alone, sure names
alone. Of those whose held-out readings and tool's position are no worse than those of the fit held to the drawing, the best is
applied; without one, that fit is. Forms without a name, and laws that these outweigh, must make nothing worse at the ends of
what was seen either (outermost poses, heaviest loads, warmest rows), and geometry may not leave its tolerances to meet them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from truepose.arrays import Array, Mask
from truepose.errors import ConvergenceError
from truepose.identification.diagnosis.holdout import (
    VALIDATION,
    Block,
    Comparison,
    Trial,
    held_out_blocks,
    trial,
)
from truepose.identification.diagnosis.null_fits import Fits
from truepose.identification.diagnosis.result import WHOLE, Applied
from truepose.identification.diagnosis.search import Found, chosen, noise_at, start_from
from truepose.identification.fit.bounds import within_bounds
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.problem import Prior, prior_of
from truepose.identification.fit.summary import summarise, worst_allowed
from truepose.identification.fit.tolerance_classes import WEIGHED, part_classes
from truepose.identification.posterior.spike_slab import LONG_SET
from truepose.identification.prior import STATED
from truepose.models.effects.base import PlacedEffect

Split = tuple[str, list[Block]]
ORDINARY, DRAWING = "ordinary", "drawing"
"""The fit that tolerances hardly hold, and the one that is held to the drawing."""
AS_GOOD = 1.01
"""Ratio of held-out errors up to which a larger model is as good as a smaller one."""
DETERMINED = 0.5
"""Variance, in squared tolerances, below which readings tell more of a combination of constants than tolerances do."""
FEW = 40
"""Most candidates that a mean over sets has beside the likeliest one."""


def fitted(found: Found, accepted: Mapping[int, float], exclude: Mask) -> Estimate | None:
    """The nonlinear fit with candidates (index to spread), tolerances as wide as the mode's; None where it has no minimum."""
    cat = found.catalogue
    terms = [replace(cat.candidates[i], spread=spread) for i, spread in accepted.items()]
    try:
        return estimate(
            found.signatures.machine, found.signatures.recording, terms, start=start_from(found.fit, terms),
            exclude=exclude, prior=_prior(found, terms), noise=noise_at(found.problem, found.mode),
        )  # fmt: skip
    except ConvergenceError:
        return None


def _prior(found: Found, terms: list[PlacedEffect]) -> Prior:
    """Tolerances widened as the mode has them."""
    machine, problem = found.signatures.machine, found.problem
    prior = prior_of(machine, terms)
    sigma, count = prior.sigma.copy(), len(machine.parameters)
    wider = problem.spike_slab.unknowns.widening[found.mode.point.widening]
    factors = dict(zip(problem.classes, wider, strict=True))
    free = [k for k in range(count) if sigma[k] > 0.0]
    classes = part_classes([prior.names[k] for k in free], [prior.parts[k] for k in free])
    for k, one in zip(free, classes, strict=True):
        sigma[k] *= 1.0 if one.kind in WEIGHED else factors.get(one, 1.0)
    # steps of amplitudes in their own 1-sigma: sizes apart by orders of magnitude must not pass for rounding
    scale = np.where((np.arange(len(sigma)) >= count) & (sigma > 0.0), sigma, prior.scale)
    return replace(prior, sigma=sigma, scale=scale)


@dataclass(frozen=True)
class Model:
    """Candidates with their spreads, and the fit with them."""

    accepted: Mapping[int, float]
    fit: Estimate

    def held(self, found: Found) -> tuple[int, ...]:
        """Return the candidates that are in the fit."""
        held = {e.label for e in self.fit.effects}
        return tuple(i for i in self.accepted if found.catalogue.candidates[i].label in held)


def refit(found: Found, accepted: Mapping[int, float], exclude: Mask) -> Model | None:
    """The model of these candidates, with physical bounds kept; None where no minimum is found.

    What bounds leave nothing of (a compliance that would be negative) is no part of it.
    """
    recording = found.signatures.recording
    fit = fitted(found, accepted, exclude)
    try:
        fit = fit and within_bounds(fit, recording, exclude)
    except ConvergenceError:
        return None
    if fit is None:
        return None
    nothing = {e.label for e in fit.fitted_effects() if not any(e.amplitudes)}
    left = {i: s for i, s in accepted.items() if found.catalogue.candidates[i].label not in nothing}
    if len(left) < len(accepted):
        return refit(found, left, exclude)
    return Model(accepted, fit)


def likeliest_model(fits: Fits, found: Found) -> Model:
    """Return the likeliest set's model; the fit of the last expansion point, and what it holds, where that has no minimum."""
    accepted = dict.fromkeys(found.catalogue.stated, STATED) | chosen(found.problem, found.mode)
    if not accepted:
        return Model(accepted, fits.before)
    return refit(found, accepted, fits.outliers) or Model(dict(found.accepted), found.fit)


@dataclass(frozen=True)
class Choice:
    """Held-out trials of both plain calibrations and of models beside them.

    drawing: the fit held to the drawing, which is applied where nothing else may be: the ordinary fit leaves it by hundreds
    of tolerances where readings say little. ``trials``: of both, by name, and ``plain`` that of the better one, which gains are
    told against; known: labels of terms that are known: where the sensor's are, readings are what is wrong; laws: candidates
    whose law holds everywhere, the rest are forms.
    """

    found: Found
    drawing: Estimate
    outliers: Mask
    split: Split
    plain: Trial
    trials: Mapping[str, Trial]
    known: frozenset[str]
    laws: frozenset[int]
    tried: list[tuple[Estimate, Trial]] = field(default_factory=list, repr=False, compare=False)
    """What was held out before: every trial takes as many fits as there are blocks."""

    @classmethod
    def of(cls, found: Found, fits: Fits) -> Choice:
        """Try both calibrations; what the file states is known."""
        recording, before = found.signatures.recording, fits.before
        split = held_out_blocks(recording, before.used)
        own = {DRAWING: before, ORDINARY: fits.free}
        trials = {name: trial(fit, recording, fits.outliers, split) for name, fit in own.items()}
        better = trials[ORDINARY].against(trials[DRAWING]).score * AS_GOOD < 1.0
        plain = trials[ORDINARY if better else DRAWING]
        known, cat = frozenset(e.label for e in before.effects), found.catalogue
        laws = frozenset(i for i in range(len(cat.candidates)) if cat.named(i))
        return cls(found, before, fits.outliers, split, plain, trials, known, laws)

    def forms(self, model: Model) -> list[int]:
        """Return what a model's fit has without a law that is told: it is known only where it was seen."""
        return [i for i in model.held(self.found) if i not in self.laws]

    def names(self, model: Model) -> Model | None:
        """Return the model with laws that are told alone; itself where it has nothing else, None where it has none."""
        own = {i: s for i, s in model.accepted.items() if i in self.laws}
        if not own:
            return None
        return refit(self.found, own, self.outliers) if self.forms(model) else model

    @property
    def baselines(self) -> dict[str, float]:
        """Rms error of the tool's position, mm, with both calibrations; empty where no sensor reads it."""
        poses = {name: one.against(one).pose for name, one in self.trials.items()}
        return {name: pose.plain for name, pose in poses.items() if pose is not None}

    @property
    def drawing_alone(self) -> Comparison:
        """The fit held to the drawing beside the better plain calibration."""
        return self.trials[DRAWING].against(self.plain)

    def compared(self, fit: Estimate) -> Comparison:
        """A model held out beside the better plain calibration."""
        return self._tried(fit).against(self.plain)

    def beside_drawing(self, fit: Estimate) -> Comparison:
        """A model held out beside the fit held to the drawing."""
        return self._tried(fit).against(self.trials[DRAWING])

    def as_it_is(self, fit: Estimate) -> Comparison | None:
        """A model on validation rows, never fitted, beside plain calibration; None where there are none."""
        own = [block for block in self.split[1] if block.name == VALIDATION]
        return self._trial(fit, own).against(self.plain) if own else None

    def _tried(self, fit: Estimate) -> Trial:
        known = next((one for other, one in self.tried if other is fit), None)
        if known is None:
            known = self._trial(fit, self.split[1])
            self.tried.append((fit, known))
        return known

    def _trial(self, fit: Estimate, blocks: list[Block]) -> Trial:
        recording, split = self.found.signatures.recording, (self.split[0], blocks)
        return trial(fit, recording, self.outliers, split, self._silent(fit))

    def applied(self, label: str, held: Comparison, whole: Comparison) -> Applied:
        """Return what is deployed and how it was held out; ``whole``: all that was found."""
        held_out = held.split, held.pose, held.ratio
        return Applied(label, *held_out, whole.pose, whole.ratio, self.baselines)

    def gain_of_forms(self, names: Model | None, whole: Comparison) -> Mapping[str, float]:
        """Return by how much forms without a name lower the rms of held-out rows beside the names, by kind (mm, rad).

        Validation rows count where there are any, else blocks held out in turn.
        """
        without = 1.0
        if names is not None:
            without = (self.as_it_is(names.fit) or self.compared(names.fit)).ratio
        if whole.ratio >= without:
            return {}
        summary = summarise(self.drawing, self.found.signatures.recording.validation)
        rms = summary.validation_rms or summary.rms
        return {kind: (without - whole.ratio) * value for kind, value in rms.items()}

    def _silent(self, fit: Estimate) -> set[str]:
        return {e.label for e in fit.effects if e.kind == "sensor" and e.label not in self.known}

    def may_be_applied(self, model: Model, names: Model | None, held: Comparison) -> bool:
        """Whether a model is no worse than the fit held to the drawing where it was not fitted (``held``).

        Physics holds everywhere; forms without a name must make nothing worse at the ends of what was seen either. What is
        worse there with names alone is not their doing.
        """
        if held.worse or not self.forms(model):
            return not held.worse
        harms = held.worse_beyond()
        if harms and names is not None:
            harms = held.worse_beyond(self.beside_drawing(names.fit))
        return not (harms or self.strays(model, names))

    def strays(self, model: Model, names: Model | None) -> bool:
        """Return True if forms without a name move geometry farther from its tolerances than a true model ever leaves it.

        Only combinations of constants count that the readings determine: constants that share what no reading tells apart may
        each be far from the drawing.
        """
        without = self.drawing if names is None else names.fit
        seen, most = determined_directions(model.fit), worst_allowed(model.fit)
        own, other = (seen @ fit.in_tolerances[: seen.shape[1]] for fit in (model.fit, without))
        return bool(np.any((np.abs(own) > most) & (np.abs(own - other) > most)))

    def others(self, model: Model, names: Model | None, sure: Collection[int]) -> Iterator[tuple[str, Model]]:
        """What else may be applied, largest first; ``sure``: candidates whose place and driver are known."""
        cat = self.found.catalogue
        silent = self._silent(model.fit)
        robot = {i: s for i, s in model.accepted.items() if cat.candidates[i].label not in silent}
        wanted = list[tuple[str, Mapping[int, float]]]()
        wanted += [("robot", robot)] if len(robot) < len(model.accepted) else []
        if names is not None and self.forms(model):
            forms = {i: s for i, s in model.accepted.items() if i not in self.laws or i in cat.stated}
            wanted += [("names", names.accepted), ("forms", forms)]
        known = {i: s for i, s in model.accepted.items() if i in sure or i in cat.stated}
        wanted += [("sure-names", known)] if known and len(known) < len(model.accepted) else []
        for label, accepted in wanted:
            other = names if label == "names" else refit(self.found, accepted, self.outliers)
            if other is not None:
                yield label, other


def determined_directions(fit: Estimate) -> Array:
    """Return orthonormal directions (k, n) of the n constants, in tolerances, of which readings tell more than those do."""
    constants = fit.nominal.parameters
    tolerance = np.array([p.tolerance if np.isfinite(p.tolerance) else 0.0 for p in constants])
    free = np.flatnonzero(fit.prior.free < len(constants))
    at = fit.prior.free[free]
    kept = tolerance[at] > 0.0
    scale = tolerance[at[kept]]
    covariance = fit.posterior_among(free[kept]) / scale[:, None] / scale
    values, vectors = np.linalg.eigh(covariance)
    out = np.zeros((int(np.sum(values < DETERMINED)), len(constants)))
    out[:, at[kept]] = vectors[:, values < DETERMINED].T
    return out


def chosen_model(
    choice: Choice, model: Model, names: Model | None, sure: Collection[int], whole: Comparison
) -> tuple[str, Model | None, Comparison]:
    """Return the label of what is applied, its model (None: plain calibration), and how it was held out.

    It is the best of all that may be applied, and the largest of those that are as good. ``whole``: all that was found
    (``model``), held out. Long sets take long to fit: where all that was found may be applied, only names are tried beside it.
    """
    tried, less = [(WHOLE, model, whole)], choice.others(model, names, sure)
    long = len(model.fit.prior.free) > LONG_SET
    if long and names is not None and choice.may_be_applied(model, names, choice.beside_drawing(model.fit)):
        less = iter([("names", names)] if choice.forms(model) else [])
    tried += [(label, other, choice.compared(other.fit)) for label, other in less]
    held = [choice.beside_drawing(one.fit) for _, one, _ in tried]
    allowed = [t for t, h in zip(tried, held, strict=True) if choice.may_be_applied(t[1], names, h)]
    if not allowed:
        return "plain", None, choice.drawing_alone
    best = min(held.score for _, _, held in allowed)
    return next(one for one in allowed if one[2].score <= AS_GOOD * best)
