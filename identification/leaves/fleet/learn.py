"""From a fleet's machines to the prior of the next one, and its file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from truepose.files import atomic_write_text
from truepose.identification.learned_prior import MOST, EffectPrior, LearnedPrior, PlacePrior, ToleranceNote
from truepose.identification.leaves.fleet.pooled import Pooled
from truepose.identification.leaves.fleet.statistics import Tree, tolerances, trees
from truepose.models.file.yaml_document import document_text, flow_text

SMALLEST = 1e-4
"""Share of a size below which it is written as this."""


def learned(pooled: Pooled) -> LearnedPrior:
    """Return what the fleet says of machines to come; without machines the prior of ``truepose.identification.prior``."""
    kinds = dict(pooled.mechanisms)
    return LearnedPrior(
        schema="truepose/prior/1",
        machines=pooled.machines,
        mechanisms=kinds,
        effects={effect: _effect(tree) for effect, tree in sorted(trees(pooled).items())},
        tolerances={
            f"{one.mechanism}: {one.parts}" if len(kinds) > 1 else one.parts: ToleranceNote(
                deviations=one.deviations,
                ratio=short(one.ratio.value),
                low=short(one.ratio.low),
                high=short(one.ratio.high),
            )
            for one in tolerances(pooled)
        },
    )


def _effect(tree: Tree) -> EffectPrior:
    places: dict[str, dict[str, PlacePrior]] = {}
    for k, (mechanism, place) in enumerate(tree.places):
        of = tree.hierarchy.place(k)
        places.setdefault(mechanism, {})[place] = PlacePrior(
            machines=tree.machines[k],
            found=short(tree.found[k]),
            frequency=short(of.mean),
            usual=short(of.usual_frequency),
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


def write_prior(path: Path | str, learned: LearnedPrior) -> None:
    """Write a prior file, whole or not at all."""
    atomic_write_text(path, prior_text(learned))


def prior_text(learned: LearnedPrior) -> str:
    """A prior file as text: a line for each place, what is most frequent first."""
    document = learned.model_dump(by_alias=True, mode="json")
    effects = document.pop("effects")
    tolerances = document.pop("tolerances")
    ranked = sorted(effects.items(), key=lambda item: (-_most(item[1]), item[0]))
    lines = [
        f"# Learned from {learned.machines} machines. For `truepose diagnose MACHINE REC --prior FILE`, which takes",
        "# `odds` (how many times likelier than without this file) and `sizes`; the rest says where they are from.",
        document_text(document).rstrip(),
        "effects:" if effects else "effects: {}",
        *(line for name, effect in ranked for line in _effect_lines(name, effect)),
        "tolerances:  # true spread over the stated tolerance; for the reader, `diagnose` does not read it"
        if tolerances
        else "tolerances: {}",
        *(f"  {flow_text(name)}: {flow_text(one)}" for name, one in tolerances.items()),
    ]
    return "\n".join(lines) + "\n"


def _effect_lines(name: str, effect: Mapping[str, Any]) -> Iterator[str]:
    yield f"  {flow_text(name)}:"
    yield from (f"    {key}: {flow_text(effect[key])}" for key in ("machines", "odds", "sizes"))
    yield "    places:" if effect["places"] else "    places: {}"
    for mechanism, places in effect["places"].items():
        yield f"      {flow_text(mechanism)}:"
        ranked = sorted(places.items(), key=lambda item: (-item[1]["frequency"], item[0]))
        yield from (f"        {flow_text(place)}: {flow_text(one)}" for place, one in ranked)


def _most(effect: Mapping[str, Any]) -> float:
    every = [one["frequency"] for places in effect["places"].values() for one in places.values()]
    return max(every, default=0.0)
