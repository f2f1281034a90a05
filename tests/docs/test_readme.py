"""The README's lines of Python run as they stand there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from support import ROOT

README = ROOT / "README.md"
(SNIPPET,) = re.findall(
    r"^```python\n(.*?)^```", README.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
)


def test_the_lines_do_the_whole_job(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As a script in an empty folder."""
    assert len([line for line in SNIPPET.splitlines() if line]) == 8
    monkeypatch.chdir(tmp_path)
    exec(compile(SNIPPET, str(README), "exec"), {"__name__": "snippet"})
    said = capsys.readouterr().out
    assert said.startswith("missing-physics") and "platform-deformation" in said
    assert (tmp_path / "result" / "improved.yaml").is_file()
    assert (tmp_path / "controller" / "telescope_kin.c").is_file()


def test_it_is_one_and_a_half_screens_with_a_picture() -> None:
    text = README.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 90
    assert re.search(r"!\[[^\]]{40,}\]\(docs/figures/report-\w+\.png\)", text)
