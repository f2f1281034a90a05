"""What is shipped, and what the README promises: the wheel, the links, the commands, the lines of Python."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from typer.testing import CliRunner

from support import ROOT
from truepose.cli import app

FOLDERS = ("models", "identification", "codegen")
GUIDE = (ROOT / "docs" / "reference" / "architecture.md").read_text(encoding="utf-8")
(PLUGIN,) = [
    block
    for block in re.findall(r"^```python\n(.*?)^```", GUIDE, re.DOTALL | re.MULTILINE)
    if '"travel-cubic"' in block
]
DATA = {
    "truepose/py.typed",
    "truepose/models/machines/telescope/machine.yaml",
    "truepose/models/machines/telescope/recording.csv",
    "truepose/models/machines/telescope/truth.json",
    "truepose/shown/templates/page.html.j2",
    "truepose/shown/templates/scene.js",
    "truepose/codegen/templates/kin.c.j2",
}


def _run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """A Python process that must end well; ``cwd`` is no part of the project's folders."""
    environment = os.environ | {"PYTHONWARNINGS": "default"}
    done = subprocess.run(
        [sys.executable, *arguments], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done


def _tracked() -> list[str]:
    """Paths that git tracks, relative to the root."""
    command = ["git", "-c", "safe.directory=*", "-C", str(ROOT), "ls-files", "-z"]
    try:
        listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no git checkout")
    return [name for name in listed.split("\0") if name and (ROOT / name).exists()]


def _installed(name: str) -> str | None:
    """Where a tracked file goes in the wheel; None for what is not shipped."""
    top = name.split("/", maxsplit=1)[0]
    if top in FOLDERS:
        return f"truepose/{name}"
    inside = name.removeprefix("src/")
    return inside if inside != name and not (ROOT / name).is_symlink() else None


@pytest.mark.nightly
def test_the_wheel_holds_the_tracked_files_and_nothing_else(tmp_path: Path) -> None:
    """Nothing else: no file of the examination, the studies and the tests, either."""
    expected = {place for name in _tracked() if (place := _installed(name)) is not None}
    assert expected >= DATA
    _run("-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path), cwd=ROOT)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        shipped = {name for name in archive.namelist() if ".dist-info/" not in name}
        licence = [name for name in archive.namelist() if name.endswith("/licenses/LICENSE")]
    assert {"not shipped": expected - shipped, "not tracked": shipped - expected} == {
        "not shipped": set(),
        "not tracked": set(),
    }
    assert licence


PLUGGED = ["--plugin", "travel_cubic.py"]
"""The options that load the guide's effect."""


def _command(*words: str) -> str:
    """What a command of truepose prints."""
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_the_effect_of_the_guide_is_a_plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "travel_cubic.py").write_text(PLUGIN, encoding="utf-8")
    telescope = ROOT / "models" / "machines" / "telescope"
    poses = [str(telescope / "machine.yaml"), str(telescope / "recording.csv")]
    _command("simulate", *poses, "-o", "out.csv", *PLUGGED, "--effect", "travel-cubic@rho2:k=0.001[1/mm^2]")
    assert (tmp_path / "out.csv").is_file()
    assert "Scale that changes along the travel" in _command("effects", "travel-cubic", *PLUGGED)


def test_links_of_the_documents_lead_somewhere() -> None:
    results = (ROOT / "proof").glob("*/results/*.md")
    named = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    documents = [*named, *(ROOT / "docs").rglob("*.md"), *results]
    links = [
        (document, target)
        for document in documents
        for target in re.findall(r"\]\((?!https?:)([^)#]+)", document.read_text(encoding="utf-8"))
    ]
    assert {document for document, _ in links} >= {ROOT / "README.md"}
    assert not [
        f"{document.name}: {target}" for document, target in links if not (document.parent / target).exists()
    ]


def _mentioning(*words: str) -> set[str]:
    """Modules of the package that mention a word."""
    sources = [path for folder in (*FOLDERS, "src/truepose") for path in _modules(ROOT / folder)]
    assert len(sources) > 50
    found = {path for path in sources if any(w in path.read_text(encoding="utf-8") for w in words)}
    return {path.relative_to(ROOT).as_posix() for path in found}


def _modules(folder: Path) -> list[Path]:
    """Python files below a folder, not through links."""
    return [path for path in folder.rglob("*.py") if folder.resolve() in path.resolve().parents]


def test_nothing_but_the_demo_and_the_report_knows_of_the_truth() -> None:
    report = "identification/report/"
    assert {n for n in _mentioning("truth.json") if not n.startswith(report)} == {"src/truepose/demo.py"}
    assert not _mentioning("telescope_simulator")


README = (ROOT / "README.md").read_text(encoding="utf-8")


COMMANDS = [
    line
    for block in re.findall(r"^```sh\n(.*?)^```", README, re.DOTALL | re.MULTILINE)
    for line in block.splitlines()
]


def test_the_tests_command_of_the_readme_is_that_of_ci() -> None:
    (command,) = [line for line in COMMANDS if "pytest" in line]
    assert command in (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    assert os.access(ROOT / ".ci" / "run", os.X_OK)
