"""From a fleet's summary to the prior of the next machine."""

from __future__ import annotations

from truepose.identification.fleet.summary import Summary
from truepose.identification.learned_prior import LearnedPrior


def learned(summary: Summary) -> LearnedPrior:
    """What the fleet says of machines to come; without machines the prior of ``truepose.identification.prior``.

    ``truepose.identification.learned_prior.write_prior(path, learned(summary))`` writes the file.
    """
    raise NotImplementedError
