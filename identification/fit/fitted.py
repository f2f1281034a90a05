"""What every result of a fit offers: the machine that was found, its predictions and its residuals."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

from truepose.models.machine.machine import Machine
from truepose.shown.result import Declared, Shown

if TYPE_CHECKING:
    import pandas as pd

    from truepose.identification.recording.load import Sources
    from truepose.identification.recording.recording import Recording


machine_of: Declared[Machine] = Declared("an estimate, a calibration or a diagnosis")
predicted_frame: Declared[pd.DataFrame] = Declared("an estimate, a calibration or a diagnosis")
residual_frame: Declared[pd.DataFrame] = Declared("an estimate, a calibration or a diagnosis")
residual_figure: Declared[Any] = Declared("an estimate, a calibration or a diagnosis")


class Fitted(Shown):
    """A result that stands for the machine it found, wherever a function takes a machine."""

    @cached_property
    def machine(self) -> Machine:
        """The machine as it is read from the file that is written: constants, effects and covariance. Raises InputError."""
        return machine_of(self)

    def predict(self, rows: Recording | Sources) -> pd.DataFrame:
        """Predict readings and poses of the machine that was found, with the columns of ``truepose.predict``."""
        return predicted_frame(self, rows)

    @property
    def residuals(self) -> pd.DataFrame:
        """Prediction minus reading of each channel, in the machine file's units; ``fitted``: whether the row was fitted.

        The index is that of ``Recording.to_frame``. NaN where a row cannot be assembled.
        """
        return residual_frame(self)

    def plot(self) -> Any:
        """Draw the residuals of each row; a ``matplotlib.figure.Figure``. Raises InputError without matplotlib."""
        return residual_figure(self)
