"""All sources of right pairs by name, in the order in which cases take them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..pairs import Pair
from .examined import examined, names
from .gough import gough
from .serial import forms, serial
from .tables import FAMILIES

SENSORS = ("position", "pose", "targets")
MOST = 3
"""Effects at once, at most."""


@dataclass(frozen=True)
class Source:
    """make(rng, effects=, still=, unknown=) gives a pair; it may raise ValueError where nothing could be measured.

    Sources of one group are alike; groups take turns.
    """

    name: str
    group: str
    make: Callable[..., Pair]


def sources() -> tuple[Source, ...]:
    """Own arms in all their forms, own platforms, the challenge's machines, MuJoCo's."""
    out = [Source(name, name.split("-")[0], _taking(partial(examined, name))) for name in names()]
    for family in FAMILIES:
        for form in forms(family):
            kinds = (*SENSORS, "ballbar") if form == "serial" else ("pose", "position")
            out += [_arm(family, form, kind) for kind in kinds]
    for form in ("6-ups", "6-pus"):
        for kind in (*SENSORS, "ballbar") if form == "6-ups" else SENSORS:
            out.append(Source(f"own {form} {kind}", f"own {form}", _taking(partial(gough, form, kind))))
    return tuple(out)


def turns(rng: np.random.Generator) -> Callable[[int], Source]:
    """The k-th source of a case: groups in a drawn order, over and over; within a group one at random."""
    groups: dict[str, list[Source]] = {}
    for source in sources():
        groups.setdefault(source.group, []).append(source)
    order = [list(groups)[int(k)] for k in rng.permutation(len(groups))]
    picks = rng.random(1000)

    def of(k: int) -> Source:
        own = groups[order[k % len(order)]]
        return own[int(picks[k % len(picks)] * len(own))]

    return of


def _taking(maker: Callable[..., Pair]) -> Callable[..., Pair]:
    def made(rng: np.random.Generator, **settings: object) -> Pair:
        return maker(rng, **{k: v for k, v in settings.items() if k != "unknown"})

    return made


def _arm(family: str, form: str, kind: str) -> Source:
    def made(rng: np.random.Generator, **settings: object) -> Pair:
        return serial(family, form, kind, rng, **settings)  # type: ignore[arg-type]

    return Source(f"{family} {form} {kind}", f"{family} {form}", made)


__all__ = ["MOST", "Source", "sources", "turns"]
