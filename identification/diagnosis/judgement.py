"""The alarms of a model, and whether it fails by them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from truepose.identification.diagnosis.alarms import (
    Alarm,
    Structure,
    prior_conflict,
    residual_alarm,
    structure_alarm,
)
from truepose.identification.fit.estimate import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.linearisation import Linearisation

CLEAR_P = 1e-3
"""An alarm below this p is no chance: the model fails."""
SIGMA_OFF = 3.0


@dataclass(frozen=True)
class Judgement:
    """The three alarms of a model on a recording, and what its residuals depend on most."""

    alarms: Mapping[str, Alarm]
    structure: Structure

    @property
    def misfits(self) -> bool:
        """Whether the model lacks fit against replicates, or by more than a stated sigma wrong by three would make."""
        lack = self.alarms["residual"]
        return lack.p < CLEAR_P and (lack.about == "replicates" or lack.statistic > SIGMA_OFF**2)


def judged(ordinary: Estimate, fit: Estimate, lin: Linearisation, recording: Recording) -> Judgement:
    """Of ``fit``, with ``lin`` there; ``ordinary`` is the fit whose misfit counts, and says how large the noise is."""
    noise = max(float(np.sqrt(max(ordinary.chi2_per_dof, 1e-300))), 1.0)
    structure = structure_alarm(fit, recording)
    alarms = {
        "residual": residual_alarm(ordinary, recording),
        "prior_conflict": prior_conflict(lin, noise),
        "structure": structure.alarm,
    }
    return Judgement(alarms, structure)
