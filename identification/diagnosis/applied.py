"""What may be applied: the model whose tool is no worse than plain calibration's on rows that were not fitted.

A model may predict readings better and leave the tool worse, where a form without a name took what the robot does. So
models are tried in turn: all that was found, less what the sensor is said to do and may not, names alone, sure names
alone. The first whose held-out readings and tool's position are no worse than plain calibration's is applied; without
one, plain calibration is. Forms without a name must make nothing worse at the ends of what was seen either (outermost poses,
heaviest loads, warmest rows), and geometry may not leave its tolerances to meet them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.errors import ConvergenceError
from truepose.identification.diagnosis.holdout import VALIDATION, Block, Comparison, Trial, trial
from truepose.identification.diagnosis.model import Shape, fitted
from truepose.identification.diagnosis.result import WHOLE, Applied, PoseError
from truepose.identification.diagnosis.search import Found
from truepose.identification.fit.bounded import within_bounds
from truepose.identification.fit.estimate import Estimate
from truepose.identification.fit.summary import worst_allowed

Mask = NDArray[np.bool_]
Split = tuple[str, list[Block]]


@dataclass(frozen=True)
class Model:
    """Candidates with their spreads, forms of the remainder, and the fit with both."""

    accepted: Mapping[int, float]
    shapes: tuple[Shape, ...]
    fit: Estimate

    def nameless(self, found: Found) -> tuple[int, ...]:
        """What has no name and is in the fit."""
        cat, held = found.catalogue, {e.label for e in self.fit.effects}
        every = (*(i for i in self.accepted if not cat.named(i)), *(s.candidate for s in self.shapes))
        return tuple(i for i in every if cat.candidates[i].label in held)


def refit(
    found: Found, accepted: Mapping[int, float], shapes: tuple[Shape, ...], exclude: Mask
) -> Model | None:
    """The model of these candidates and forms, with physical bounds kept; None where no minimum is found.

    What bounds leave nothing of (a compliance that would be negative) is no part of it.
    """
    recording = found.signatures.recording
    fit = fitted(found, accepted, shapes, exclude)
    if fit is None:
        return None
    try:
        fit = within_bounds(fit, recording, exclude)
    except ConvergenceError:
        return None
    nothing = {e.label for e in fit.fitted_effects() if not any(e.amplitudes)}
    left = {i: s for i, s in accepted.items() if found.catalogue.candidates[i].label not in nothing}
    if len(left) < len(accepted):
        return refit(found, left, shapes, exclude)
    return Model(accepted, shapes, fit)


@dataclass(frozen=True)
class Choice:
    """Held-out trials of plain calibration and of models beside it.

    before: plain calibration; sure: labels of terms that are known: where the sensor's are, readings are what is wrong.
    """

    found: Found
    before: Estimate
    outliers: Mask
    split: Split
    plain: Trial
    sure: frozenset[str]

    @classmethod
    def of(
        cls, found: Found, before: Estimate, outliers: Mask, split: Split, sure: Collection[str]
    ) -> Choice:
        """With plain calibration tried."""
        plain = trial(before, found.signatures.recording, outliers, split)
        return cls(found, before, outliers, split, plain, frozenset(sure))

    def compared(self, fit: Estimate) -> Comparison:
        """A model held out beside plain calibration."""
        recording = self.found.signatures.recording
        return trial(fit, recording, self.outliers, self.split, self._silent(fit)).against(self.plain)

    def as_it_is(self, fit: Estimate) -> Comparison | None:
        """A model on validation rows, never fitted, beside plain calibration; None where there are none."""
        name, blocks = self.split
        own = [block for block in blocks if block.name == VALIDATION]
        if not own:
            return None
        tried = trial(fit, self.found.signatures.recording, self.outliers, (name, own), self._silent(fit))
        return tried.against(self.plain)

    def judged(self, fit: Estimate) -> Comparison:
        """On validation rows where there are any, else on blocks held out in turn."""
        return self.as_it_is(fit) or self.compared(fit)

    def _silent(self, fit: Estimate) -> set[str]:
        known = {effect.label for effect in self.before.effects} | self.sure
        return {e.label for e in fit.effects if e.kind == "sensor" and e.label not in known}

    def may_be_applied(self, model: Model, names: Model | None, held: Comparison) -> bool:
        """Whether a model is no worse than plain calibration where it was not fitted.

        Physics holds everywhere; forms without a name must make nothing worse at the ends of what was seen either. What is
        worse there with names alone is not their doing.
        """
        if held.worse:
            return False
        return not (model.nameless(self.found) and (self._harms(held, names) or self.strays(model, names)))

    def _harms(self, held: Comparison, names: Model | None) -> bool:
        """Whether what stands beside names makes the ends of what was seen worse."""
        if names is None or not held.worse_beyond():
            return held.worse_beyond()
        return held.worse_beyond(self.compared(names.fit))

    def strays(self, model: Model, names: Model | None) -> bool:
        """Whether forms without a name move a constant out of its tolerance, as far as a true model never leaves one."""
        without = self.before if names is None else names.fit
        count, most = len(self.before.machine.parameters), worst_allowed(model.fit)
        own, other = model.fit.in_tolerances[:count], without.in_tolerances[:count]
        return bool(np.any((np.abs(own) > most) & (np.abs(own - other) > most)))

    def smaller(
        self, model: Model, names: Model | None, sure: Collection[int]
    ) -> Iterator[tuple[str, Model]]:
        """What else may be applied, largest first; ``sure``: candidates whose place and driver are known."""
        cat = self.found.catalogue
        silent = self._silent(model.fit)
        robot = {i: s for i, s in model.accepted.items() if cat.candidates[i].label not in silent}
        if len(robot) < len(model.accepted):
            less = refit(self.found, robot, model.shapes, self.outliers)
            if less is not None:
                yield "robot", less
        if names is not None and model.nameless(self.found):
            yield "names", names
        known = {i: s for i, s in model.accepted.items() if i in sure or i in cat.stated}
        if known and len(known) < len(model.accepted):
            certain = refit(self.found, known, (), self.outliers)
            if certain is not None:
                yield "sure-names", certain


def chosen_model(
    choice: Choice, model: Model, names: Model | None, sure: Collection[int], whole: Comparison
) -> tuple[str, Model | None, Comparison]:
    """The label of what may be applied, its model (None: plain calibration), and how it was held out.

    ``whole``: all that was found (``model``), held out.
    """
    if choice.may_be_applied(model, names, whole):
        return WHOLE, model, whole
    for label, less in choice.smaller(model, names, sure):
        held = choice.compared(less.fit)
        if choice.may_be_applied(less, names, held):
            return label, less, held
    return "plain", None, choice.plain.against(choice.plain)


def told(label: str, held: Comparison, whole: Comparison) -> Applied:
    """What is applied, for the report."""
    pose = None if held.pose is None else PoseError(*held.pose)
    first = None if whole.pose is None else PoseError(*whole.pose)
    return Applied(label, held.split, pose, held.ratio, first, whole.ratio)


__all__ = ["Choice", "Model", "chosen_model", "refit", "told"]
