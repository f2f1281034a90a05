"""A disk that is full, whatever still fits: the old result stays whole, one line says why, and nothing is left behind."""

from __future__ import annotations

import re
import signal
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from kills.cases import CASES
from kills.inputs import write_inputs
from kills.room import everything, make_room, result, run

from truepose.cli import app

resource = pytest.importorskip("resource", reason="no limits of files")
FITS = (400, 1000)
"""Bytes that a file may have."""
WRITERS = ("init", "check --fix", "codegen", "predict", "export")


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("full") / "in"
    write_inputs(folder)
    return folder


def _limited(size: int, _: list[str]) -> None:
    """Run the command in the child process whose files may not grow further."""
    sys.dont_write_bytecode = True  # Python would keep modules that are cut off
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # then it is an error like any other
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
    app()


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_loses_nothing(name: str, inputs: Path, tmp_path: Path) -> None:
    (case,) = (case for case in CASES if case.name == name)
    make_room(tmp_path / "room", inputs, None)
    room = tmp_path / "room"
    assert run(case, 1, room).code == case.code
    old, names = dict(result(room)), everything(room)
    for size in FITS:
        assert max(map(len, old.values())) > size
        done = run(replace(case, run=partial(_limited, size)), 2, room)
        assert done.code == 2, done.said
        lines = [line for line in done.said.splitlines() if not line.startswith("note: ")]
        assert len(lines) == 1 and re.match("error: .*File too large", lines[0]), done.said
        assert dict(result(room)) == old and everything(room) == names
