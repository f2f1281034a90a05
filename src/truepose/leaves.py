"""Modules that are found, not named: of the kernel's rooms and of its leaves, folders that can be deleted.

Where the kernel has a place for a leaf, it loads every module of one name: ``command`` (the command line), ``showing``
(how results are shown), ``gate`` (checks before a fit), ``loading`` (how a recording becomes rows), ``reading`` (file
formats), ``solutions`` (what generated C offers). Such a module registers what it has, or holds it under the name
that the place asks for.
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from importlib.util import find_spec
from types import ModuleType

FOLDERS = ("models", "identification", "codegen")


@cache
def rooms() -> tuple[str, ...]:
    """Return the packages of the kernel's rooms, then those of the leaves, each in the order of their names."""
    tops = [f"truepose.{folder}" for folder in FOLDERS]
    leaves = [top + ".leaves" for top in tops if find_spec(top + ".leaves") is not None]
    return tuple(name for package in (*tops, *leaves) for name in _packages(package))


def _packages(package: str) -> list[str]:
    found = pkgutil.iter_modules(importlib.import_module(package).__path__, f"{package}.")
    return sorted(module.name for module in found if module.ispkg and not module.name.endswith(".leaves"))


@cache
def modules_named(name: str) -> tuple[ModuleType, ...]:
    """Import the module ``name`` of every room that has one, and return them."""
    names = [f"{room}.{name}" for room in rooms()]
    return tuple(importlib.import_module(full) for full in names if find_spec(full) is not None)


__all__ = ["modules_named", "rooms"]
