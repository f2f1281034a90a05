"""Constants of masses and springs in a linearised problem: seen only through effects of loads, they must not stand for one.

The derivative by a payload's kg is compliance times the change of the load. At a fit that has the compliance it looks
like the compliance itself, so that a set without it could buy the whole signal with a payload a tolerance or two heavier.
But a set without it has no such derivative. So the columns are those of the effects that every set has; the others
are weighed with masses as fitted, and what masses leave open shows in the 1-sigma of the fit that follows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prediction.sensor_rows import Block
from truepose.identification.signatures.point import Point


def blocks_of_every_set(predictor: Predictor, here: Point) -> Iterator[Block]:
    """Blocks at a point; by constants of masses, the derivatives are those of what the file states."""
    counts, p = here.used * here.weights, here.among(predictor.model.names)
    names = [parameter.name for parameter in predictor.machine.pulling if parameter.free]
    at = [predictor.model.names.index(name) for name in names]
    stated = {effect.label for effect in predictor.machine.effects}
    own = {name for effect in here.effects if effect.label not in stated for name in effect.parameter_names}
    found = [name in own for name in predictor.model.names]
    if not at or not any(found):
        yield from predictor.blocks(p, here.x, counts)
        return
    without = np.where(found, 0.0, p)
    pairs = zip(predictor.blocks(p, here.x, counts), predictor.blocks(without, here.x, counts), strict=True)
    for block, plain in pairs:
        columns = block.dense.copy()
        place = np.array(at) if block.at is None else np.searchsorted(block.at, at)  # no mass follows ports
        columns[:, :, place] = plain.dense[:, :, place]
        yield replace(block, dense=columns)
