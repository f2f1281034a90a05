"""From a fleet's summary to the prior of the next machine."""

from __future__ import annotations

import numpy as np

from truepose.identification.learned_prior import MOST, EffectPrior, LearnedPrior, PlacePrior, ToleranceNote
from truepose.identification.leaves.fleet.statistics import Tree, statistics, trees
from truepose.identification.leaves.fleet.summary import Summary

SMALLEST = 1e-4
"""Share of a size below which it is written as this."""


def learned(summary: Summary) -> LearnedPrior:
    """What the fleet says of machines to come; without machines the prior of ``truepose.identification.prior``.

    ``truepose.identification.leaves.fleet.prior_file.write_prior(path, learned(summary))`` writes the file.
    """
    effects = {effect: _effect(tree) for effect, tree in sorted(trees(summary).items())}
    kinds = summary.mechanisms
    tolerances = {
        f"{one.mechanism}: {one.parts}" if len(kinds) > 1 else one.parts: ToleranceNote(
            deviations=one.deviations,
            ratio=short(one.ratio.value),
            low=short(one.ratio.low),
            high=short(one.ratio.high),
        )
        for one in statistics(summary).tolerances
    }
    return LearnedPrior(
        schema="truepose/prior/1",
        machines=summary.machines,
        mechanisms=kinds,
        effects=effects,
        tolerances=tolerances,
    )


def _effect(tree: Tree) -> EffectPrior:
    places: dict[str, dict[str, PlacePrior]] = {}
    for k, (mechanism, place) in enumerate(tree.places):
        of = tree.hierarchy.place(k)
        places.setdefault(mechanism, {})[place] = PlacePrior(
            machines=tree.machines[k],
            found=short(tree.found[k]),
            frequency=short(of.mean),
            usual=short(float(1.0 / (1.0 + np.exp(-of.usual)))),
            odds=_odds(of.log_factor),
        )
    return EffectPrior(
        machines=max(tree.machines),
        odds=_odds(tree.hierarchy.elsewhere.log_factor),
        sizes=tuple(max(short(share), SMALLEST) for share in tree.hierarchy.sizes.tolist()),
        places=places,
    )


def _odds(log_factor: float) -> float:
    return short(float(np.clip(np.exp(log_factor), 1.0 / MOST, MOST)))


def short(value: float) -> float:
    """Four digits: the file is made for reading, and what is read is what was learned."""
    return float(f"{value:.4g}")


__all__ = ["learned"]
