"""Prior numbers of a diagnosis: how many effects machines have, of which kind and size, and how far sigma is off.

One table for all machines. ``ONLY_ALIKE`` and ``PART_OF_IT`` were fitted on simulated machines of development
seeds, the others chosen before anything was examined with them; none on the examination.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from truepose.identification.posterior.conditional import Sizes
from truepose.identification.posterior.sampler import Richness

Array = NDArray[np.float64]
UNNAMED_SHARE = 0.2
"""Probability that something that is there has no name in the catalogue."""
FAMILY_SHARE = 0.2
"""Probability that an effect which is there acts at all its places, where it has three or more."""
ONLY_ALIKE, PART_OF_IT = 0.3, 1.0
"""Odds that what looks like an effect is something else, of another form: by itself, and beside something without a name."""
IN_FAMILY = 0.5
"""Probability that a place of a family that is there has the effect, before its own amplitude is seen."""
FURTHER = 0.5
"""Probability that a cause which is there has a further term (another harmonic, another form)."""
RICHNESS = Richness((0.02, 0.08, 0.3), tuple(np.log([0.5, 0.35, 0.15]).tolist()), 24)
"""Simple, usual and rich machines: 0.5, 2 and 7 effects are expected."""
_SIZES, RARER = np.geomspace(1e-3, 10.0, 9), 2.0
_SHARES = np.minimum(1.0, _SIZES**-RARER)
SIZES = Sizes(_SIZES, np.log(_SHARES / np.sum(_SHARES)))
"""Every size up to the largest expected one is as likely; beyond it, ten times larger is a hundred times rarer."""


def beyond_usual(size: float) -> float:
    """How many times rarer an effect of this size (in units of the largest usual one) is than of a usual size."""
    return float(max(size, 1.0) ** RARER)


REMAINDER = 0.5
"""Probability that there is a smooth remainder beside all effects."""
NOISE_FROM, NOISE_STEP = 0.6, 0.1
"""Smallest noise in stated sigmas, and steps of it in the log."""
REMAINDER_FROM, REMAINDER_STEP = 0.25, 2.0
"""Smallest rms of the remainder in stated sigmas, and the factor between its sizes."""
NARROWER = 0.5
"""Tolerances may also be stated too wide, all together."""
