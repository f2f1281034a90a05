"""The toy of the diagnosis' README runs, and comes out as the page says."""

from __future__ import annotations

import re

import pytest

from support import ROOT

README = ROOT / "identification/diagnosis/README.md"


def test_the_toy_runs_within_its_length() -> None:
    """Both blocks assert what the page says of them."""
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 2
    assert sum(len(block.splitlines()) for block in blocks) <= 150
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, str(README), "exec"), names)
    assert isinstance(names["inclusion"], dict)
    assert names["inclusion"]["sag"] == pytest.approx(1.0 / 12.0, abs=0.02)  # "one chance in twelve"
