"""The outcome of a calibration in sentences."""

from __future__ import annotations

from truepose.identification.fit.summary import FitSummary
from truepose.identification.report.before_after import sensor_unit
from truepose.identification.report.fits import stated_noise
from truepose.identification.report.misfit_words import HIGH
from truepose.identification.report.numbers import significant, unit_symbol
from truepose.models.machine.machine import Machine


def calibrated_words(name: str, summary: FitSummary) -> tuple[str, bool]:
    """The outcome in a sentence or two, and whether nothing speaks against it."""
    good = nothing_against(summary)
    said = f"{name} {_outcome(good)}: {figures(summary)}."
    return (said if good else f"{said} Something may be missing: truepose diagnose tells what."), good


def calibrated_headline(machine: Machine, summary: FitSummary) -> tuple[str, bool]:
    """The same by what is left of the first kind of reading, beside what the instrument alone makes."""
    good = nothing_against(summary)
    held = summary.validation_rms is not None
    left = (summary.validation_rms if held else summary.rms) or {}
    kind = next(iter(left), "")
    if not kind:
        return calibrated_words(machine.name, summary)
    unit = machine.residual_units[kind]
    where = "of rows that were not fitted " if held else ""
    sizes = left[kind], stated_noise(machine)[kind]
    factor, name = sensor_unit(max(sizes), unit)
    off, floor = (f"{significant(size * factor)} {unit_symbol(name)}".rstrip() for size in sizes)
    said = f"{machine.name} {_outcome(good)}: it misses the {kind} {where}by {off}; the instrument alone makes {floor}."
    return (said if good else f"{said} Something may be missing."), good


def _outcome(good: bool) -> str:
    return "is calibrated" if good else "was fitted, but the fit leaves more than noise"


def figures(summary: FitSummary) -> str:
    """Misfit and farthest parameter."""
    within = "within" if not summary.worst_parameter_sigma > summary.worst_allowed else "beyond"
    return (
        f"misfit chi2/dof {significant(summary.chi2_per_dof)}, farthest parameter"
        f" {summary.worst_parameter} at {significant(summary.worst_parameter_sigma)} tolerances"
        f" ({within} the {significant(summary.worst_allowed)} that a true model allows)"
    )


def nothing_against(summary: FitSummary) -> bool:
    """Whether misfit and farthest parameter are those of a true model."""
    within = not summary.worst_parameter_sigma > summary.worst_allowed
    return within and not summary.chi2_per_dof > HIGH
