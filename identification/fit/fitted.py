"""What every result of a fit offers: the machine that was found, its predictions and its residuals."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

from truepose.models.machine.machine import Machine
from truepose.shown.result import Shown, above

if TYPE_CHECKING:
    import pandas as pd

    from truepose.identification.recording.load import Sources
    from truepose.identification.recording.recording import Recording


class Fitted(Shown):
    """A result that stands for the machine it found, wherever a function takes a machine."""

    @cached_property
    def machine(self) -> Machine:
        """The machine as it is read from the file that is written: constants, effects and covariance. Raises InputError."""
        return cast(Machine, above("fitted", "machine_of")(self))

    def predict(self, rows: Recording | Sources) -> pd.DataFrame:
        """Predict readings and poses of the machine that was found, with the columns of ``truepose.predict``."""
        return cast("pd.DataFrame", above("fitted", "predicted_frame")(self, rows))

    @property
    def residuals(self) -> pd.DataFrame:
        """Prediction minus reading of each channel, in the machine file's units; ``fitted``: whether the row was fitted.

        The index is that of ``Recording.to_frame``. NaN where a row cannot be assembled.
        """
        return cast("pd.DataFrame", above("fitted", "residual_frame")(self))

    def plot(self) -> Any:
        """Draw the residuals of each row; a ``matplotlib.figure.Figure``. Raises InputError without matplotlib."""
        return above("fitted", "residual_figure")(self)
