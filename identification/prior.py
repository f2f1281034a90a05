"""The one table of prior numbers: what is likely of machines, instruments and catalogues before any reading is seen.

Every number says what it means and where it is from. Three kinds of origin:

* *chosen*: set before anything was examined with it, by judgement, and not moved since;
* *fitted*: moved until simulated machines of development seeds came out right; none on an examination or a real recording;
* a source, where the field has one.

All are for all machines. Limits at which something is *said* are no priors; they stand in the modules that say it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import expit, logit, logsumexp

from truepose.arrays import Array


@dataclass(frozen=True)
class Sizes:
    """The slab: widths (s,) that coefficients may have, in units of the largest expected one, with the log prior of each."""

    values: Array
    log_prior: Array


@dataclass(frozen=True)
class Richness:
    """How many effects machines have: levels of the probability that a slot is filled, the log prior of each, and the slots.

    The level is integrated out, so the number of effects adapts to the machine (Scott and Berger 2010, Ann. Statist. 38:2587).
    """

    filled: tuple[float, ...]
    log_prior: tuple[float, ...]
    slots: int

    def log_weights(self, number: int) -> Array:
        """(r,) log posterior of each level for a number of members."""
        p = np.array(self.filled)
        out: Array = np.array(self.log_prior) + number * np.log(p) + (self.slots - number) * np.log1p(-p)
        return out

    @cached_property
    def log_totals(self) -> Array:
        """(slots + 2,) log prior of certain slots being filled, for each number of them and one more, levels summed."""
        return np.array([logsumexp(self.log_weights(number)) for number in range(self.slots + 2)])

    def scaled(self, log_factor: float) -> Richness:
        """With the odds of every level of a slot being filled times a factor."""
        if log_factor == 0.0:
            return self
        return replace(self, filled=tuple(expit(logit(self.filled) + log_factor).tolist()))

    def slot(self, number: int) -> float:
        """Log prior odds of a certain slot being filled beside ``number`` full ones."""
        return float(self.log_totals[number + 1] - self.log_totals[number])


# -- how many effects, and which ----------------------------------------------------------------------------

RICHNESS = Richness((0.015, 0.06, 0.22), tuple(np.log([0.5, 0.35, 0.15]).tolist()), 32)
"""Simple, usual and rich machines: 0.5, 2 and 7 effects are expected. Chosen."""
URN = 4.0
"""How many causes of other kinds weigh as much as the prior shares of kinds: fewer, and like goes with like. Chosen."""
ALIKE = 1.0
"""The same within a kind, of its settings and sizes. Chosen: one draw weighs as much as what was known before."""
UNNAMED_SHARE = 0.2
"""Probability that something that is there has no name in the catalogue. Chosen."""
FURTHER = 0.5
"""Probability that a cause which is there has a further term (another harmonic, another form). Chosen: no knowledge."""
TOGETHER = 0.2
"""Prior share of an effect's places that join several parts, where parts alone are places too. Chosen."""
ELSEWHERE = 0.2
"""Prior share of what follows another place's thermometer, where the place has one of its own. Chosen."""
SET_UP = 0.9
"""Share of movements between sessions that are of frames and sensors: they are set up anew, and parts stay. Chosen."""

# -- what a fleet may say otherwise -------------------------------------------------------------------------

FLEET_ODDS = 1.5
"""1-sigma, in the log, of how far the odds of an effect in a fleet are from today's prior. Chosen: a factor of 4 to 5."""
FLEET_PLACES = 1.0
"""The same of one of its places from the others. Chosen: a factor of 3."""
FLEET_SIZES = 0.4
"""How much rarer each further step of the slab's sizes (a factor of 3) is from a fleet's usual size of an effect. Chosen."""

# -- how large they are -------------------------------------------------------------------------------------

RARER = 2.0
"""Beyond the largest expected size, ten times larger is a hundred times rarer: a power of this order. Chosen."""


def slab(smallest: float, largest: float, rarer: float) -> Sizes:
    """Every size up to the largest expected one (1) is as likely, a factor of about three apart; larger ones are rarer."""
    values = np.geomspace(smallest, largest, 1 + round(2.0 * np.log10(largest / smallest)))
    shares = np.minimum(1.0, values**-rarer)
    return Sizes(values, np.log(shares / np.sum(shares)))


SIZES = slab(1e-3, 10.0, RARER)
"""Of effects. Chosen."""
LONG = 12
"""Coefficients beyond which an effect is a long series, solved for in directions that readings see. Chosen: cost alone."""
MOVEMENT_SIZES = slab(1e-5, 100.0, 1.0)
"""Of movements between sessions, from a millionth of a tolerance to ten. Chosen: ten times larger is ten times rarer."""
STATED = 100.0
"""1-sigma, in expected sizes, of the coefficients of what the machine file states already: hardly any prior. Chosen."""
BOUND_DOUBT = 0.2
"""1-sigma, in the log, of how far physical bounds are known: drivers are logged beside where they act. Chosen."""
MOVED = 0.1
"""Usual largest movement between sessions, in tolerances (without one: in steps of 100 mm or 1 rad). Chosen."""


# -- whether a formula holds --------------------------------------------------------------------------------

FORM_ERROR = 0.1
"""1-sigma of a formula's deviation, as a share of its signal: closed forms of springs and screws hold to some percent.

Chosen."""
# -- how good the stated sigmas are -------------------------------------------------------------------------


@dataclass(frozen=True)
class Doubt:
    """How far a stated number is off, in the log: a mixture of two normals about 0, ``right`` the share of the narrow one."""

    right: float
    narrow: float
    wide: float

    def log_prior(self, step: Array | float) -> Array:
        """Of steps in the log, up to a constant."""
        narrow = np.log(self.right / self.narrow) - 0.5 * (np.asarray(step) / self.narrow) ** 2
        wide = np.log((1.0 - self.right) / self.wide) - 0.5 * (np.asarray(step) / self.wide) ** 2
        return np.asarray(np.logaddexp(narrow, wide))


SIGMA_DOUBT = Doubt(0.7, 0.1, 0.8)
"""A stated sigma is mostly right to 10 %, and sometimes off by a factor of two and more. Chosen."""
RATIO_DOUBT = Doubt(0.7, 0.1, 0.6)
"""Kinds of reading come from one instrument: mostly off by one factor, sometimes each by its own. Chosen."""
NOISE_FROM, NOISE_STEP = 0.6, 0.1
"""Smallest noise in stated sigmas, and steps of it in the log. Chosen: steps of a grid."""

# -- how good the stated tolerances are ---------------------------------------------------------------------

TOLERANCE_DOUBT = 0.6
"""1-sigma, in the log, of how far the tolerances of a kind of parts are misstated. Chosen."""
INFLATIONS = (1.0, 2.0, 4.0)
"""How many times wider than stated the tolerances of a class of parts may be. Chosen: steps of a grid."""
NARROWER = 0.5
"""Tolerances may also be stated too wide, all together. Chosen: a step of a grid."""


def noise_log_prior(values: Sequence[float]) -> tuple[float, ...]:
    """Log prior of noise scales, in stated sigmas."""
    return tuple(SIGMA_DOUBT.log_prior(np.log(values)).tolist())
