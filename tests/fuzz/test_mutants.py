"""Mutants of every kind of file: read, or refused in one line; never a traceback or half a result."""

from __future__ import annotations

import contextlib
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from fuzzing.kinds import KINDS, Seed
from fuzzing.mutants import mutants
from support.examples import examples
from truepose.cli import app

LONG = {"calibrate", "codegen", "compensate", "drift", "export", "identifiability", "plan"}
"""Commands that read what others read, and work on it for long."""
KIND = {name: make for name, make in KINDS.items() if name != "plug-ins"}  # which are their user's own code


@cache
def _seeds(kind: str, folder: Path) -> list[Seed]:
    return KIND[kind](folder)


@pytest.mark.parametrize("kind", KIND)
@settings(max_examples=examples(25), deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_mutants_are_read_or_refused(
    kind: str, data: Any, tmp_path_factory: pytest.TempPathFactory, tmp_path: Path
) -> None:
    pytest.importorskip({"MJCF": "mujoco", "workbooks": "python_calamine"}.get(kind, "rosbags"))
    seed = data.draw(st.sampled_from(_seeds(kind, tmp_path)))
    short = [command for command in seed.commands if command[0] not in LONG]
    command = data.draw(st.sampled_from(short or seed.commands))
    folder = tmp_path_factory.mktemp("mutant")
    seed.laid_out(folder, data.draw(mutants(seed)))
    (folder / "out").mkdir()
    with contextlib.chdir(folder):
        found = CliRunner().invoke(app, list(command))
    assert found.exit_code in (0, 2, 3), found.output
    assert found.exception is None or isinstance(found.exception, SystemExit)
    assert "Traceback" not in found.output
    if found.exit_code and command[0] != "check":
        assert found.stderr.count("error: ") == 1 and not list((folder / "out").iterdir())
