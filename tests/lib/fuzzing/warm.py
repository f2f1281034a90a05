"""Everything that commands import, imported once, so that a trial is a copy of a process that has it."""

from __future__ import annotations

import gc
import importlib
import os
import pkgutil
from importlib.util import find_spec


def warmed() -> None:
    """Import the product, and let pint read its units."""
    os.environ["OMP_NUM_THREADS"] = os.environ["TRUEPOSE_THREADS"] = "1"
    os.environ["TRUEPOSE_CC"] = ""  # no compiler: other processes' work would be counted
    import truepose
    from truepose.models.units import is_unit

    if find_spec("mujoco"):
        os.environ["MUJOCO_GL"] = "disable"  # else it looks for a screen
        importlib.import_module("mujoco")

    for module in pkgutil.walk_packages(truepose.__path__, "truepose."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    assert is_unit("mm")
    gc.collect()
    gc.freeze()  # else each copy's collector touches, and so copies, all pages


__all__ = ["warmed"]
