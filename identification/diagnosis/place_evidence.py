"""What a recording says of each effect at each place, for the statistics of a fleet."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Amount:
    """How large an effect is, given that it is there: mean and 1-sigma of the log of its rms coefficient in units of the
    largest expected one, and the same mean in its ``unit``, which is empty where coefficients have several."""

    log_mean: float
    log_std: float
    log_amount: float
    unit: str


@dataclass(frozen=True)
class PlaceEvidence:
    """What is said of an effect at a place (at any, where ``place`` is empty), and what of that the recording said.

    probability, prior: that it is there, after and before; log_bayes_factor: of it at the sizes that would be noticed against
    nothing, free of the prior; unseen: prior share of the other sizes; credit: its share among the explanations of what it
    would explain; sizes: how probable each size of the slab is.
    """

    effect: str
    place: tuple[str, ...]
    probability: float
    prior: float
    log_bayes_factor: float
    unseen: float
    credit: float = 1.0
    sizes: tuple[float, ...] = ()
    size: Amount | None = None
