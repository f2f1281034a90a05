"""What an effect's file imports; contracts: ``truepose.models.machine.effect`` and ``truepose.models.machine.placed``."""

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from truepose.models.file.driver import DriverKind
from truepose.models.file.yaml_document import read_document
from truepose.models.machine.effect import Site, effects
from truepose.models.machine.placed import (
    SERIES,
    Coefficient,
    Effect,
    Observed,
    Place,
    PlacedEffect,
    Settings,
    Shifts,
)

__all__ = [
    "SERIES",
    "Coefficient",
    "DriverKind",
    "Effect",
    "Observed",
    "Place",
    "PlacedEffect",
    "Settings",
    "Shifts",
    "Site",
    "bundle",
    "effects",
]  # fmt: skip
E = TypeVar("E", bound=type[Effect])


def bundle(slug: str) -> Callable[[E], E]:
    """Register the class that follows under its slug, with what ``catalogue.yaml`` says of it in words.

    It has no settings unless it states ``setting_ranges``.
    """

    def describe(effect: E) -> E:
        effect.slug = slug
        if effect.setting_ranges is None:
            effect.setting_ranges = {}
        for field, words in _catalogue()[slug].items():
            setattr(effect, field, tuple(words) if isinstance(words, list) else words)
        effects.add(slug)(effect)
        return effect

    return describe


@cache
def _catalogue() -> Mapping[str, Mapping[str, Any]]:
    return read_document(Path(__file__).with_name("catalogue.yaml"))
