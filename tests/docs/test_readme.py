"""The README's snippets run as they stand there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from support import ROOT

README = ROOT / "README.md"
SNIPPETS = re.findall(r"^```python\n(.*?)^```", README.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("number", range(len(SNIPPETS)))
def test_the_snippet_runs(number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A script in an empty folder."""
    monkeypatch.chdir(tmp_path)
    exec(compile(SNIPPETS[number], str(README), "exec"), {"__name__": "snippet"})


def test_it_is_one_and_a_half_screens_with_a_picture() -> None:
    text = README.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 90
    assert re.search(r"!\[[^\]]{40,}\]\(docs/figures/report-\w+\.png\)", text)
