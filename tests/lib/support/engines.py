"""The compiled engine for problems of any size, or for none."""

from __future__ import annotations

import pytest

from support.generated_c import LEVEL
from truepose.codegen.evaluation import batch, compiled


def compile_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Even the smallest functions are compiled."""
    monkeypatch.setattr(batch, "FEWEST_ROWS", 0)
    monkeypatch.setattr(batch, "LEAST_WORK", 0.0)


def compile_hastily(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same, by day hardly optimised, where large functions are asked for what they say."""
    compile_all(monkeypatch)
    monkeypatch.setattr(compiled, "FLAGS", tuple(LEVEL if flag == "-O2" else flag for flag in compiled.FLAGS))


def compile_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything stays on the virtual machine."""
    monkeypatch.setattr(batch, "FEWEST_ROWS", 10**12)
