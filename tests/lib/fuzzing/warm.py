"""Everything that commands import, imported once, so that a trial is a copy of a process that has it."""

from __future__ import annotations

import importlib
import os
import pkgutil


def warmed() -> None:
    """Import the product, and let pint read its units."""
    os.environ["OMP_NUM_THREADS"] = os.environ["TRUEPOSE_THREADS"] = "1"
    os.environ["TRUEPOSE_CC"] = ""  # no compiler: other processes' work would be counted
    import truepose
    from truepose.models.units import is_unit

    for module in pkgutil.walk_packages(truepose.__path__, "truepose."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    assert is_unit("mm")


__all__ = ["warmed"]
