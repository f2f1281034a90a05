"""The words of a report, for those who read one for the first time."""

from __future__ import annotations

from truepose.identification.report.document import Fold, Items

_FITS = (
    "σ: the sensor's noise, the 1-sigma that the machine file states. A residual of 1 σ is what noise alone leaves.",
    "rms: root of the mean square. Of a position it is that of the whole vector.",
    "chi2 per degree of freedom: the sum of squared residuals in σ over the number of readings less fitted constants. 1 is"
    " noise alone.",
    "tolerance: how far a constant may be from its drawing, as a 1-sigma. It is the fit's prior.",
    "validation rows, held out: rows that were not fitted, on which a model is judged.",
    "1 sigma of a constant: how well readings and tolerances together know it.",
)
_NAMES = (
    "effect: a piece of physics of the catalogue. Its place is where it acts, its driver what it varies with (load, own"
    " position, side of arrival ...), its law the formula that it follows.",
    "probability: of all explanations that were weighed, each with its prior; several may be there at once.",
    "log Bayes factor: how much likelier the readings are with an explanation than without, as a natural logarithm. 3 is 20"
    " times, 10 is 20,000 times.",
    "without a name (empirical): a smooth form that the readings want and that no effect of the catalogue explains.",
    "concealed: an ordinary fit would have looked good, because its free constants swallowed what is missing.",
    "alarm: a test that a model which lacks nothing fails once in a hundred recordings.",
)


def words_of_fits() -> Fold:
    """Of a calibration."""
    return Fold("Words of this report", [Items(_FITS)])


def words_of_diagnoses() -> Fold:
    """Of a diagnosis."""
    return Fold("Words of this report", [Items([*_NAMES, *_FITS])])
