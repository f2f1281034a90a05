"""Settings that are points of a continuum (the lag of a warm part), found between the points of the catalogue's grid.

The catalogue holds a few values of such a setting. Once one of them is accepted and the effect is large, the
true value between two of them fits far better, and something unnamed that bends freely would beat the name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.candidates import Catalogue
from truepose.identification.diagnosis.effect_evidence import weigh
from truepose.identification.diagnosis.signatures import Signatures
from truepose.identification.fit.estimate import Estimate
from truepose.identification.selection.scales import Grid
from truepose.models.effects.base import PlacedEffect

Array = NDArray[np.float64]
TRIALS = 9
"""Values weighed at once in each round; the next round lies between the best one's neighbours."""
ROUNDS = 3
SMOOTH = 1.0
"""Log evidence by which neighbouring values may differ from the best when no further round is needed."""
WORTHWHILE = 1.0
"""Log posterior odds that a refined value must bring: where the grid's own does as well, it stays."""


@dataclass(frozen=True)
class _Setting:
    """A setting of a candidate, and the next lower and higher value in the catalogue (its own at an end)."""

    index: int
    name: str
    low: float
    high: float


@dataclass(frozen=True)
class _Trials:
    """Values of a setting in rising order, the log Bayes factor of the effect at each, and that at its present value."""

    values: Array
    gain: Array
    present: float

    @property
    def best(self) -> int:
        return int(np.argmax(self.gain))

    def around_best(self) -> slice:
        """The best value and its neighbours, three in all."""
        middle = min(max(self.best, 1), len(self.values) - 2)
        return slice(middle - 1, middle + 2)


def refined(
    signatures: Signatures, cat: Catalogue, fit: Estimate, grid: Grid, accepted: Mapping[int, float]
) -> Catalogue:
    """The catalogue with the continuous settings of accepted terms refined; the very same one where none gains by it.

    A refined candidate takes the place of the one it came from, so that indices keep their meaning.
    """
    for index in (i for i in accepted if i not in cat.stated):
        for name in cat.candidates[index].effect.continuous:
            setting = _setting(cat, index, name)
            if setting is not None:
                cat = _refined_setting(signatures, cat, fit, grid, accepted, setting)
    return cat


def _setting(cat: Catalogue, index: int, name: str) -> _Setting | None:
    """A setting of a candidate between its neighbours in the catalogue; None without any."""
    here = cat.candidates[index]
    if name not in here.settings_map:
        return None
    own = here.settings_map[name]
    rest = dict(here.settings_map) | {name: 0.0}
    values = [
        c.settings_map[name]
        for c in cat.candidates
        if (c.effect.slug, c.place) == (here.effect.slug, here.place)
        and dict(c.settings_map) | {name: 0.0} == rest
    ]
    low = max((v for v in values if v < own), default=own)
    high = min((v for v in values if v > own), default=own)
    return _Setting(index, name, low, high) if high > low else None


def _refined_setting(
    signatures: Signatures,
    cat: Catalogue,
    fit: Estimate,
    grid: Grid,
    accepted: Mapping[int, float],
    setting: _Setting,
) -> Catalogue:
    """The catalogue with one setting of one accepted term at its likeliest value, where that is worth it."""
    terms, index = list(accepted), setting.index
    placed = [cat.candidates[i] for i in terms]
    rest = {k: accepted[i] for k, i in enumerate(terms) if i != index}
    at, low, high = terms.index(index), setting.low, setting.high
    for _ in range(ROUNDS):
        values = np.unique([float(f"{v:.3g}") for v in np.linspace(low, high, TRIALS)])
        if len(values) < 3:
            return cat
        trials = [_with_setting(signatures, cat.candidates[index], setting.name, float(v)) for v in values]
        few = signatures.of([*placed, *trials])
        wanted = [at, *range(len(placed), len(placed) + len(trials))]
        gain = weigh(few.linearise(fit), wanted, grid, rest).gain
        found = _Trials(values, gain[1:], float(gain[0]))
        near = found.around_best()
        if np.ptp(found.gain[near]) < SMOOTH:
            break
        low, high = float(values[near.start]), float(values[near.stop - 1])
    cost = log_share(found.values[near], found.gain[near], (setting.high - setting.low) / 2)
    if found.gain[found.best] + cost < found.present + WORTHWHILE:
        return cat
    return cat.replaced(index, trials[found.best], cost)


def _with_setting(signatures: Signatures, placed: PlacedEffect, name: str, value: float) -> PlacedEffect:
    settings = dict(placed.settings_map) | {name: value}
    return PlacedEffect.at(placed.effect, signatures.machine, placed.place, settings)


def log_share(values: Sequence[float] | Array, gain: Sequence[float] | Array, cell: float) -> float:
    """Log of the part of a cell of the grid that three values in a row around the best leave likely, at most 0.

    The grid's point stands for its whole cell; a value picked from it because it fits best has only that share of its
    prior. ``gain`` (3,), the log evidence at ``values`` (3,), is taken for a parabola.
    """
    curvature = -2.0 * float(np.polyfit(np.asarray(values) - np.mean(values), gain, 2)[0])
    if curvature <= 0.0:
        return 0.0
    return min(0.0, float(np.log(np.sqrt(2.0 * np.pi / curvature) / cell)))
