"""Processes that work for a command end with it, however it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="no SIGKILL")
WORK = """
import os, sys, time
from pathlib import Path
from truepose.pool import Cores, each

def work(folder):
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(60)

if __name__ == "__main__":
    list(each(work, [sys.argv[1]] * 4, Cores(2)))
"""
PATIENCE = 60.0
"""Seconds; a process that nobody watches over goes on for the 60 s of its task."""


def _lives(process: int) -> bool:
    """Whether it is there and no zombie, which waits for nobody but its parent."""
    try:
        return " Z " not in Path(f"/proc/{process}/stat").read_text().rpartition(")")[2][:4]
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
def test_workers_of_a_command_that_is_killed_end(tmp_path: Path) -> None:
    script, seen = tmp_path / "script.py", tmp_path / "seen"
    script.write_text(WORK)
    seen.mkdir()
    with subprocess.Popen([sys.executable, script, seen]) as command:
        until = time.monotonic() + PATIENCE
        while len(list(seen.iterdir())) < 2 and time.monotonic() < until:
            time.sleep(0.1)
        workers = [int(path.name) for path in seen.iterdir()]
        assert len(workers) == 2 and all(map(_lives, workers))
        killed = time.monotonic()
        command.send_signal(signal.SIGKILL)
    while any(map(_lives, workers)) and time.monotonic() < killed + PATIENCE / 2:
        time.sleep(0.1)
    assert not any(map(_lives, workers))
