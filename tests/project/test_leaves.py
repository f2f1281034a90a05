"""Every leaf can be deleted: what is left imports, runs and passes the kernel's tests."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from support import ROOT

FOLDERS = ("models", "identification", "codegen")
LEAVES = sorted(
    str(path.relative_to(ROOT))
    for folder in FOLDERS
    for path in (ROOT / folder / "leaves").iterdir()
    if path.is_dir() and path.name != "__pycache__"
)
KERNEL_LINES = """
import importlib, pkgutil, tempfile, truepose
from pathlib import Path
from typer.testing import CliRunner
from truepose.cli import app
for module in pkgutil.walk_packages(truepose.__path__, "truepose."):
    if ".leaves." not in module.name and not module.name.endswith("__main__"):
        importlib.import_module(module.name)
folder = Path(next(iter(importlib.import_module("truepose.models").__path__))) / "machines" / "polisher"
with tempfile.TemporaryDirectory() as out:
    files = [str(folder / "machine.yaml"), str(folder / "recording.csv")]
    for words in (["--help"], ["calibrate", *files, "-o", out], ["codegen", f"{out}/calibrated.yaml", "-o", f"{out}/c"]):
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0, (words, done.output)
    print(repr(truepose.load_machine(files[0])))
"""


def without(folder: Path, leaves: Sequence[str]) -> dict[str, str]:
    """Copy the product and its tests without some leaves; the environment in which Python finds the copy."""
    skipped = {ROOT / leaf for leaf in leaves}

    def ignored(at: str, names: list[str]) -> set[str]:
        return {name for name in names if name == "__pycache__" or Path(at) / name in skipped}

    for name in (*FOLDERS, "src", "tests"):
        shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=ignored)
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, folder / name)
    return {**os.environ, "PYTHONPATH": str(folder / "src")}


def run(folder: Path, words: Sequence[str], environment: dict[str, str]) -> None:
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]


@pytest.mark.parametrize("leaf", [*LEAVES, "all"])
def test_the_kernel_runs_without(leaf: str, tmp_path: Path) -> None:
    """Imports, help, a fit and its C, in a process that finds no trace of the leaf."""
    environment = without(tmp_path, LEAVES if leaf == "all" else [leaf])
    run(tmp_path, ["-c", KERNEL_LINES], environment)


@pytest.mark.nightly
@pytest.mark.parametrize("leaf", ["all", *LEAVES])
def test_the_kernel_s_tests_are_green_without(leaf: str, tmp_path: Path) -> None:
    environment = without(tmp_path, LEAVES if leaf == "all" else [leaf])
    run(tmp_path, ["-m", "pytest", "-q", "-x", "-n", "2", "tests/kernel"], environment)


def test_no_leaf_is_named_by_the_kernel() -> None:
    """Registration alone: only the list of public names (``truepose.check``) knows where a leaf is."""
    named = [
        str(path.relative_to(ROOT))
        for folder in (*FOLDERS, "src/truepose")
        for path in sorted((ROOT / folder).rglob("*.py"))
        if "leaves" not in path.relative_to(ROOT).parts and ".leaves." in path.read_text(encoding="utf-8")
    ]
    assert set(named) <= {"src/truepose/__init__.py"}
