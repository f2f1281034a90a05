"""Calibration as one call: the estimate that was asked for, and the free fit beside it.

``map`` holds parameters by their tolerances; ``huber`` is ``map`` with a loss that bends for outliers.
``ols`` trusts readings alone (directions they do not see stay at the drawing); ``liu``, ``ridge`` and ``pcr``
do so too, but give up a little of their unbiasedness where columns are nearly dependent
(the leaf ``shrinking``).

``gn`` starts undamped, ``lm`` damped; where one finds no minimum the other is tried, and a note says so.
Solvers that keep bounds are leaves (``ipopt``).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from truepose.arrays import Array
from truepose.errors import ConvergenceError, InputError
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.bounds import Bounds, bounds_of
from truepose.identification.fit.estimate import FREE_WIDENING, blame, estimate, result, untied
from truepose.identification.fit.estimated import Estimate, Fitted
from truepose.identification.fit.leastsquares import Solution
from truepose.identification.fit.problem import Prior, Problem, prior_of
from truepose.identification.fit.reading_errors import estimate_reading_errors
from truepose.identification.fit.relinearised import linear_estimators, relinearised
from truepose.identification.fit.set_ups import held_but, kept_covariance, prior_but, with_set_ups, with_zeros
from truepose.identification.fit.summary import Judgement, judged
from truepose.identification.fit.tool_pose import calibrated_pose
from truepose.identification.prediction.covariance import Covariance
from truepose.identification.prediction.predictor import FIT, Predictor
from truepose.identification.recording.recording import Recording
from truepose.leaves import modules_named
from truepose.models.file.sections import ExpectedPose
from truepose.models.machine.machine import Machine
from truepose.shown.result import Written
from truepose.wording import meant

DAMPING = {"gn": 0.0, "lm": 1e-4}
"""Initial damping."""
TIGHT = 1e-13
"""What is left to gain of half the sum of squares: the same readings told otherwise give the same digits."""
BIAS = "std is the estimator's 1-sigma with {} taken as known; its bias towards the drawing is not in it"


@dataclass(frozen=True, repr=False)
class Calibration(Written, Fitted):
    """The fit, the free fit (None when it found no minimum), and what was fitted how.

    kept: what the machine file knows of what was held, where some constants alone were fitted.

    It stands for its ``machine``, the calibrated one, in every function that takes a machine. ``report(path)`` writes the
    report, ``save(directory)`` ``calibrated.yaml``, ``fit.json`` and ``report.html``.
    ``to_frame()``: the constants of the fit, with the columns of ``Estimate.to_frame``.
    """

    fit: Estimate
    free: Estimate | None
    recording: Recording
    notes: tuple[str, ...]
    method: dict[str, str]
    kept: Covariance | None = None

    @property
    def judgement(self) -> Judgement:
        """Whether it may be called a calibration."""
        return judged(self.fit)

    @cached_property
    def pose(self) -> ExpectedPose | None:
        """What the fit is worth to the tool, against what stood in the machine file; None where that is not judged."""
        return calibrated_pose(self.fit, self.recording, "the machine file" if self.only else "the drawing")

    @property
    def only(self) -> str:
        """What alone was fitted, in words; empty where everything was that is not exactly known."""
        return self.method.get("only", "")


def calibrate(
    machine: Machine,
    recording: Recording,
    *,
    estimator: str = "map",
    solver: str = "gn",
    tuning: float | None = None,
    only: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> Calibration:
    """Fit the machine with the effects of its file.

    ``only``: frames, parts or constants (``base``, ``q4``, ``q4.theta``), or the zeros of all joints (``offset``), that alone
    are fitted; all else, effects included, is held as the file has it (``truepose.identification.fit.set_ups``).

    ``tuning`` is Liu's d, ridge's k or the number of components where it is not to be chosen by rule (see ``relinearised``).
    Raises InputError for an estimator or solver that does not exist or do not go together, for bounds that cannot be kept
    and for too few rows, ConvergenceError naming the parameters responsible.
    """
    biased = _checked(estimator, solver)
    only = with_zeros(machine, only)
    machine = with_set_ups(held_but(machine, only) if only else machine, recording)
    progress("fitting")
    corrected = estimate_reading_errors(machine, recording)
    work = _Work(machine, corrected, solver, bounds_of(machine, machine.effects), only)
    method = {"estimator": estimator, "solver": solver, **({"only": ", ".join(only)} if only else {})}
    fit, notes = work.linear(estimator, tuning) if biased else work.unbiased(estimator)
    if biased and fit.shrunk is not None:
        method |= {"scaling": "tolerance", linear_estimators()[estimator][0]: f"{fit.shrunk.tuning:.6g}"}
    progress("fitting without tolerances")
    free, more = work.free(fit.p)
    why = "the mechanism cannot be assembled there; the row was left out"
    before = [*recording.notes, *work.predictor.cautions]
    before += [f"{recording.where(k)}: {why}" for k in fit.unassembled]
    at_bounds = work.bounds.notes(fit.prior, fit.p, kept=solver not in DAMPING)
    kept = kept_covariance(machine, work.tolerances) if only else None
    return Calibration(fit, free, recording, (*before, *notes, *at_bounds, *more), method, kept)


def bounded_solvers() -> dict[str, Callable[..., Solution]]:
    """Return the solvers that keep bounds, by name: functions of a problem, where it starts, and its ``bounds``."""
    return {name: solve for leaf in modules_named("solving") for name, solve in leaf.SOLVERS.items()}


def _checked(estimator: str, solver: str) -> bool:
    """Whether the estimator is a biased one, where it exists and goes with the solver."""
    _check("estimator", estimator, ("map", *linear_estimators(), "huber"))
    _check("solver", solver, (*DAMPING, *bounded_solvers()))
    biased = estimator in linear_estimators() and estimator != "ols"
    if biased and solver not in DAMPING:
        raise InputError(
            f"--solver: found {solver!r} with --estimator {estimator}, which relinearises by itself and keeps no "
            "bounds; expected gn or lm, or the estimators map, ols or huber"
        )
    return biased


@dataclass(frozen=True)
class _Work:
    """One machine and recording, to be fitted in one way or another; each gives its estimate and notes."""

    machine: Machine
    recording: Recording
    solver: str
    bounds: Bounds
    only: tuple[str, ...] = ()

    @cached_property
    def predictor(self) -> Predictor:
        return Predictor(self.machine, self.recording, self.machine.effects, visits=FIT)

    @cached_property
    def start(self) -> Array:
        return aligned_start(self.predictor)

    @cached_property
    def tolerances(self) -> Prior:
        prior = prior_of(self.machine, self.machine.effects)
        return prior_but(prior, self.machine, self.only) if self.only else prior

    @cached_property
    def flat(self) -> Prior:
        """The same parameters without tolerances; what is exactly known stays so."""
        sigma: Array = np.where(self.tolerances.sigma > 0, np.inf, 0.0)
        return replace(self.tolerances, sigma=sigma)

    @cached_property
    def near(self) -> Estimate:
        """The fit under tolerances, where estimators that have none start."""
        return self.fitted()[0]

    @cached_property
    def independent(self) -> tuple[Prior, Array, str]:
        """Parameters that the readings tell apart, without tolerances; where they start; what was held."""
        near = self.near
        prior = untied(Problem(self.predictor, self.tolerances, near.p, ~self.recording.validation))
        start = np.where(prior.sigma > 0, near.p, self.tolerances.mean)
        held = len(self.tolerances.free) - len(prior.free)
        note = (
            f"the readings alone cannot tell all {len(self.tolerances.free)} parameters apart: {held} of them were "
            "held at the drawing, those that depend on others or show less than a tenth of a sigma a tolerance"
        )
        return prior, start, note

    def unbiased(self, estimator: str) -> tuple[Estimate, list[str]]:
        """By ols, map or huber."""
        if estimator == "ols":
            return self.least_squares()
        return self.fitted(loss="huber" if estimator == "huber" else "gauss")

    def fitted(self, solver: str | None = None, **options: Any) -> tuple[Estimate, list[str]]:
        """By the solver asked for; of gn and lm by the other where that one finds no minimum."""
        solver = solver or self.solver
        own = {"start": self.start, "predictor": self.predictor, "prior": self.tolerances, "tolerance": TIGHT}
        machine, recording = self.machine, self.recording
        fitting: Callable[..., Estimate] = partial(
            estimate, machine, recording, machine.effects, **{**own, **options}
        )
        if solver not in DAMPING:
            return fitting(solver=partial(bounded_solvers()[solver], bounds=self.bounds)), []
        try:
            return fitting(damping=DAMPING[solver]), []
        except ConvergenceError as first:
            other = next(name for name in DAMPING if name != solver)
            try:
                fit = fitting(damping=DAMPING[other])
            except ConvergenceError:
                raise first from None
        return fit, [f"{solver} found no minimum, {other} did; this is its result"]

    def linear(self, name: str, tuning: float | None = None) -> tuple[Estimate, list[str]]:
        """A linear estimator, relinearised from the fit under tolerances.

        Where it finds no rest, parameters that depend on others are held at the drawing, and a note says so.
        """
        try:
            return self._linear(self.flat, self.near.p, name, tuning)
        except ConvergenceError:
            prior, start, note = self.independent
            fit, notes = self._linear(prior, start, name, tuning)
            return fit, [*notes, note]

    def _linear(self, prior: Prior, p: Array, name: str, tuning: float | None) -> tuple[Estimate, list[str]]:
        problem = Problem(self.predictor, prior, p, ~self.recording.validation)
        start = np.zeros(len(prior.free))
        try:
            solution, known = relinearised(problem, start, self.tolerances, name, tuning)
        except InputError as exc:
            raise InputError(f"{', '.join(self.recording.files)}: {exc}") from None
        if not solution.status.ok or known is None:
            raise ConvergenceError(blame(solution, prior))
        fit = result(problem, solution, self.machine.effects)
        if name == "ols":
            return fit, []
        return replace(fit, shrunk=known), [BIAS.format(linear_estimators()[name][0])]

    def least_squares(self) -> tuple[Estimate, list[str]]:
        """Readings alone; unseen directions stay at the drawing."""
        if self.solver in DAMPING:
            with contextlib.suppress(ConvergenceError):  # curved valleys are walked down by damped steps
                return self._linear(self.flat, self.near.p, "ols", None)
        try:
            # widening infinite tolerances only says that valleys may be flat
            return self.fitted(prior=self.flat, widen=FREE_WIDENING)
        except ConvergenceError:
            prior, start, note = self.independent
            fit, notes = self.fitted(prior=prior, start=start)
            return fit, [*notes, note]

    def free(self, start: Array) -> tuple[Estimate | None, list[str]]:
        """The fit that tolerances, and no bounds, hardly hold; none, and a note, where it finds no minimum."""
        damped = self.solver if self.solver in DAMPING else "lm"
        try:
            return self.fitted(damped, start=start, widen=FREE_WIDENING)[0], []
        except ConvergenceError as exc:
            what = f"the fit with {FREE_WIDENING:g} times wider tolerances, for comparison,"
            return None, [f"{what} has no result: {exc}"]


def _check(what: str, name: str, known: Sequence[str]) -> None:
    if name not in known:
        hint = meant(name, known)
        ending = f"; {hint}" if hint else ""
        raise InputError(f"--{what}: found {name!r}, expected one of {', '.join(known)}{ending}")
