"""Compiled Python for the processes of a run: in a folder of its own, where there is none beside the sources.

With ``PYTHONDONTWRITEBYTECODE``, and packages that were installed without it, each of the many processes that tests start
would compile all that it imports: three seconds.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import tempfile
from pathlib import Path

import pytest

_NOT_BESIDE = "PYTHONDONTWRITEBYTECODE"
_FOLDER = "PYTHONPYCACHEPREFIX"


def share_bytecode(config: pytest.Config) -> None:
    """Give workers, and what they start, a folder that goes with the run."""
    numpy = importlib.util.find_spec("numpy")
    installed = numpy is not None and numpy.cached is not None and Path(numpy.cached).exists()
    if installed or not sys.dont_write_bytecode:  # of a worker it was lifted already
        return
    folder, patch = tempfile.TemporaryDirectory(prefix="truepose-bytecode-"), pytest.MonkeyPatch()
    patch.setitem(os.environ, _FOLDER, folder.name)
    patch.delitem(os.environ, _NOT_BESIDE, raising=False)
    config.add_cleanup(patch.undo)
    config.add_cleanup(folder.cleanup)


__all__ = ["share_bytecode"]
