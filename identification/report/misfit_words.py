"""A misfit far from noise alone, in words: how large, and whether it speaks for a misstated sigma or something missing."""

from __future__ import annotations

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.report.numbers import known, significant

HIGH, LOW = 1.3, 0.77
"""chi2 per degree of freedom beyond which it is said: far from 1."""
ALIKE = 1.25
"""Factor within which the square of the noise that was found is the misfit."""


def misfit_clause(diagnosis: Diagnosis) -> str:
    """Of the model that the diagnosis ends with, to be said at the end of the verdict's first sentence; else nothing."""
    chi2 = diagnosis.fits["after"].chi2_per_dof
    if not known(chi2) or LOW <= chi2 <= HIGH:
        return ""
    return (
        f", with chi2 per degree of freedom {significant(chi2)}, which speaks for {_reason(diagnosis, chi2)}"
    )


def _reason(diagnosis: Diagnosis, chi2: float) -> str:
    size = significant(chi2**0.5, 2)
    if chi2 < LOW:
        return (
            f"a stated sigma that is too large (residuals are {size} of it), or readings that were averaged"
        )
    if not noise_explains(diagnosis, chi2):
        return "something missing: noise does not explain it"
    if diagnosis.findings:
        return (
            f"a stated sigma that is too small ({size} times), or for something smaller beside what is named"
        )
    return (
        f"a stated sigma that is too small ({size} times): noise of that size explains it, and no effect does"
    )


def noise_explains(diagnosis: Diagnosis, chi2: float) -> bool:
    """Whether the noise that the posterior found makes the misfit, and nothing without a name is left beside it."""
    return diagnosis.verdict != "unknown" and 1.0 / ALIKE < chi2 / diagnosis.noise**2 < ALIKE
