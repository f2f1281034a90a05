"""Processes that tests start find compiled Python: lib/support/bytecode.py."""

from __future__ import annotations

import subprocess
import sys

PROBE = """
import sys
from pathlib import Path
import numpy
assert not sys.dont_write_bytecode or Path(numpy.__cached__).is_file(), "numpy is compiled at every start"
"""


def test_a_process_need_not_compile_what_is_installed() -> None:
    done = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
