"""Mutants of the lines that changed, and of every part of the product."""

from __future__ import annotations

import subprocess
from importlib import import_module
from pathlib import Path

from support import ROOT

areas = import_module("mutation.areas")


def _git(root: Path, *arguments: str) -> None:
    who = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    subprocess.run(["git", *who, *arguments], cwd=root, check=True, capture_output=True)


def test_mutants_since_a_revision_are_of_lines_that_changed(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    code = tmp_path / "models" / "code.py"
    code.write_text("def one():\n    return 1 + 2\n\n\ndef two():\n    return 3 + 4\n", encoding="utf-8")
    _git(tmp_path, "init", "-q")
    _git(tmp_path, "add", ".")
    _git(tmp_path, "commit", "-q", "-m", "first")
    code.write_text(code.read_text(encoding="utf-8").replace("3 + 4", "3 * 5"), encoding="utf-8")
    (tmp_path / "models" / "new.py").write_text("LIMIT = 7.0\n", encoding="utf-8")
    _git(tmp_path, "add", "-N", ".")
    found = areas.changed(tmp_path, "HEAD", 100, 1)
    assert {(m.file, m.line) for m in found} == {("models/code.py", 6), ("models/new.py", 1)}
    assert len(areas.changed(tmp_path, "HEAD", 2, 1)) == 2


def test_areas_are_all_of_the_product_each_module_once() -> None:
    folders = [ROOT / name for name in ("models", "identification", "codegen", "src")]
    product = {path for folder in folders for path in folder.rglob("*.py") if path.resolve() == path}
    listed = [
        path for patterns in areas.AREAS.values() for pattern in patterns for path in ROOT.glob(pattern)
    ]
    assert len(listed) == len(set(listed))
    alone = {path for path in product - set(listed) if path.read_text(encoding="utf-8").strip()}
    assert {path.name for path in alone} <= {"__init__.py"}
