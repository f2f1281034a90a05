"""The notebooks of the examples run from top to bottom, in a kernel of their own, and are kept without outputs."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from support import ROOT

NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
TIMEOUT = 1200
"""Seconds a cell may take: twenty times what the longest takes on an idle core."""

each = pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)


@pytest.mark.nightly
@each
def test_a_notebook_runs(notebook: Path, tmp_path: Path) -> None:
    missing = [name for name in ("nbmake", "ipykernel") if importlib.util.find_spec(name) is None]
    if missing:
        pytest.skip(f"the extra 'dev' is not installed: no {', '.join(missing)}")
    own = {"JUPYTER_CONFIG_DIR": "config", "JUPYTER_RUNTIME_DIR": "runtime", "IPYTHONDIR": "ipython"}
    environment = os.environ | {name: str(tmp_path / folder) for name, folder in own.items()}
    options = ("-q", "-p", "no:cacheprovider", "-p", "nbmake", "--nbmake", f"--nbmake-timeout={TIMEOUT}")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options, str(notebook)],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0 and "1 passed" in done.stdout, done.stdout + done.stderr


@each
def test_a_notebook_is_kept_without_outputs_and_begins_with_its_title(notebook: Path) -> None:
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    assert cells[0]["cell_type"] == "markdown" and "".join(cells[0]["source"]).startswith("# ")
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert code and all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    assert len({cell["id"] for cell in cells}) == len(cells)
