"""What a plug-in adds to the catalogue stays in its process: without care a later test would diagnose with it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from truepose.models.machine.builder import builders
from truepose.models.machine.effect import effects
from truepose.models.machine.sensor import sensors
from truepose.models.registry import PREFIX, Registry


@contextmanager
def forgotten() -> Iterator[None]:
    """Names that are registered within, and files that are loaded, are not known afterwards."""
    known = set(sys.modules)
    registries: tuple[Registry[Any], ...] = (effects, sensors, builders)
    before = [{name: registry.get(name, "") for name in registry} for registry in registries]
    try:
        yield
    finally:
        for registry, entries in zip(registries, before, strict=True):
            registry._entries = entries
    for name in set(sys.modules) - known:
        if name.startswith(PREFIX):
            del sys.modules[name]


__all__ = ["forgotten"]
