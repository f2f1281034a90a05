"""The README's snippets run as they stand there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from truepose.cli import app
from truepose.models.effects.base import effects

README = Path(__file__).resolve().parent.parent / "README.md"
SNIPPETS = re.findall(r"^```python\n(.*?)^```", README.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
PLUGIN = re.compile(r"@effects\.add\(\"(?P<slug>[^\"]+)\"\)")


@pytest.mark.parametrize("number", range(len(SNIPPETS)))
def test_the_snippet_runs(number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A script in an empty folder; an effect of one's own as a plugin."""
    monkeypatch.chdir(tmp_path)
    text = SNIPPETS[number]
    plugin = PLUGIN.search(text)
    if plugin is None:
        exec(compile(text, str(README), "exec"), {"__name__": "snippet"})
        return
    (tmp_path / "plugin.py").write_text(text, encoding="utf-8")
    try:
        listed = CliRunner().invoke(app, ["effects", plugin["slug"], "--plugin", str(tmp_path / "plugin.py")])
    finally:
        effects.discard(plugin["slug"])
    assert listed.exit_code == 0, listed.output
