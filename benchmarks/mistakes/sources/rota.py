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
    """make(rng, effects=, still=) gives a pair; it may raise ValueError where nothing could be measured."""

    name: str
    make: Callable[..., Pair]
    own: bool = False


def sources() -> tuple[Source, ...]:
    """Own arms in all their forms, own platforms, the challenge's machines, MuJoCo's."""
    out = [Source(name, _taking(partial(examined, name))) for name in names()]
    for family in FAMILIES:
        for form in forms(family):
            kinds = (*SENSORS, "ballbar") if form == "serial" else ("pose", "position")
            out += [_arm(family, form, kind) for kind in kinds]
    for form in ("6-ups", "6-pus"):
        for kind in (*SENSORS, "ballbar") if form == "6-ups" else SENSORS:
            out.append(Source(f"own {form} {kind}", _taking(partial(gough, form, kind)), own=True))
    return tuple(out)


def _taking(maker: Callable[..., Pair]) -> Callable[..., Pair]:
    def made(rng: np.random.Generator, **settings: object) -> Pair:
        return maker(rng, **{k: v for k, v in settings.items() if k != "unknown"})

    return made


def _arm(family: str, form: str, kind: str) -> Source:
    def made(rng: np.random.Generator, **settings: object) -> Pair:
        return serial(family, form, kind, rng, **settings)  # type: ignore[arg-type]

    return Source(f"{family} {form} {kind}", made, own=True)


__all__ = ["MOST", "Source", "sources"]
