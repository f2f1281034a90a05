"""Finer values of continuous settings around those of the likeliest set.

Some settings are points of a continuum (the lag of a warm part), of which the catalogue holds a few values. Where one of them
is part of the likeliest set, values on both sides of it become candidates too, and the posterior is drawn among all of them;
the next time half as far from the best one.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from truepose.identification.signatures.candidates import Catalogue
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine

PARTS, CLOSE = 4, 0.02
"""Into how many parts the way to a neighbour is divided by new values, and the share of a value within which a neighbour is as
good."""


def refined(machine: Machine, cat: Catalogue, accepted: Iterable[int]) -> Catalogue:
    """The catalogue with values around those of accepted candidates; the very same one where nothing is to be added."""
    for index in [i for i in accepted if i not in cat.stated]:
        for name in cat.candidates[index].effect.continuous:
            added = _between(machine, cat, index, name)
            if added:
                cat = cat.with_more(added, [index])
    return cat


def _between(machine: Machine, cat: Catalogue, index: int, name: str) -> list[PlacedEffect]:
    """Candidates with values of a setting between a candidate's own and its neighbours on both sides."""
    here = cat.candidates[index]
    if name not in here.settings_map:
        return []
    own, rest = float(here.settings_map[name]), dict(here.settings_map) | {name: 0.0}
    values = [
        float(c.settings_map[name])
        for c in cat.candidates
        if c.at_place == here.at_place and name in c.settings_map
        if dict(c.settings_map) | {name: 0.0} == rest
    ]
    near = [
        max((v for v in values if v < own), default=own),
        min((v for v in values if v > own), default=own),
    ]
    new = [
        float(f"{own + share * (other - own):.3g}")
        for other in near
        if abs(other - own) > CLOSE * max(abs(own), abs(other))
        for share in np.arange(1, PARTS) / PARTS
    ]
    labels = {c.label for c in cat.candidates}
    settings = [dict(here.settings_map) | {name: value} for value in dict.fromkeys(new)]
    made = [PlacedEffect.at(here.effect, machine, here.place, one) for one in settings]
    return [placed for placed in made if placed.label not in labels]
