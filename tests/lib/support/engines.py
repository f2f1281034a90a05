"""The compiled engine for problems of any size, or for none."""

from __future__ import annotations

from pathlib import Path

import pytest

from truepose.codegen.evaluation import engine


def compile_all(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    """Even the smallest functions are compiled, and kept in this folder alone."""
    monkeypatch.setattr(engine, "FEWEST_ROWS", 0)
    monkeypatch.setattr(engine, "LEAST_WORK", 0.0)
    monkeypatch.setenv("TRUEPOSE_CACHE", str(cache))


def compile_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything stays on the virtual machine."""
    monkeypatch.setattr(engine, "FEWEST_ROWS", 10**12)
