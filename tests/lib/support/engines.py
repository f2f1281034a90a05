"""The compiled engine for problems of any size, or for none."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.generated_c import LEVEL
from truepose.codegen.evaluation import batch, compiled


def compile_all(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    """Even the smallest functions are compiled, and kept in this folder alone."""
    monkeypatch.setattr(batch, "FEWEST_ROWS", 0)
    monkeypatch.setattr(batch, "LEAST_WORK", 0.0)
    monkeypatch.setenv("TRUEPOSE_CACHE", str(cache))


def compile_hastily(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    """The same, by day hardly optimised, where large functions are asked for what they say."""
    compile_all(monkeypatch, cache)
    monkeypatch.setattr(compiled, "FLAGS", tuple(LEVEL if flag == "-O2" else flag for flag in compiled.FLAGS))


def compile_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything stays on the virtual machine."""
    monkeypatch.setattr(batch, "FEWEST_ROWS", 10**12)
