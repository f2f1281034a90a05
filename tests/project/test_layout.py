"""The package installs and runs from any tree: a clone, an unpacked sdist, a clone whose links are small text files."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

from support import ROOT

pytestmark = pytest.mark.nightly

FOLDERS = ("models", "identification", "codegen")
LINKS = tuple(f"src/truepose/{folder}" for folder in FOLDERS)
PLACES = """\
import sys
import truepose
import truepose.cli
import truepose.models
folder = truepose.models.__path__[0]
print(truepose.__file__, folder, sep="\\n")
"""
WORK = f"""\
{PLACES}
assert callable(truepose.diagnose)
sys.argv = ["truepose", "codegen", f"{{folder}}/machines/nanopositioner/machine.yaml", "-o", "out"]
truepose.cli.main()
"""


def _run(*command: str | Path, cwd: Path, **environment: str) -> str:
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | environment
    done = subprocess.run(command, cwd=cwd, env=clean, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def _git(*arguments: str) -> str:
    try:
        return _run("git", "-c", "safe.directory=*", *arguments, cwd=ROOT)
    except (OSError, AssertionError):
        pytest.skip("no git checkout")


def _unpacked(folder: Path) -> Path:
    """The sdist, unpacked."""
    _run(sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", folder, cwd=ROOT)
    (archive,) = folder.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        packed.extractall(folder, filter="data")
    (tree,) = (path for path in folder.iterdir() if path.is_dir())
    return tree


def _cloned_without_links(folder: Path) -> Path:
    """What ``git clone -c core.symlinks=false`` checks out, with the files as they are now."""
    tree = folder / "clone"
    _git("-c", "core.symlinks=false", "checkout-index", "-a", f"--prefix={tree}/")
    for name in _git("ls-files", "-z").split("\0"):
        if name and (ROOT / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, tree / name)
    assert all((tree / link).is_file() and not (tree / link).is_symlink() for link in LINKS)
    return tree


TREES = {"sdist": _unpacked, "no links": _cloned_without_links}


def _room(folder: Path) -> Path:
    """An environment of its own with pip and the dependencies of this one; its Python."""
    builder = venv.EnvBuilder()
    builder.create(folder)
    python = builder.ensure_directories(folder).env_exe
    own = _run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder).strip()
    # a path file read last, so that what is installed there is found first
    (Path(own) / "zz_dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    return Path(python)


def _works(python: Path, scratch: Path, **environment: str) -> list[Path]:
    """Where the package and its models are; a diagnosis is there, and the controller's C is written."""
    found = _places(python, scratch, WORK, **environment)
    assert (scratch / "out" / "nanopositioner_kin.c").is_file()
    return found


def _places(python: Path, scratch: Path, script: str = PLACES, **environment: str) -> list[Path]:
    """Where a Python finds the package and its models."""
    package, models, *_ = map(Path, _run(python, "-c", script, cwd=scratch, **environment).splitlines())
    return [package.parent, models]


@pytest.fixture(scope="module", params=TREES)
def tree(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return TREES[request.param](tmp_path_factory.mktemp("tree"))


def _install(python: Path, *what: str, cwd: Path) -> None:
    options = ("--no-build-isolation", "--no-deps", "--ignore-installed", "-q")
    _run(sys.executable, "-m", "pip", "--python", str(python), "install", *options, *what, cwd=cwd)


def test_a_tree_without_links_installs_for_those_who_edit_it(tree: Path, tmp_path: Path) -> None:
    """What is found there is what runs where it stands, in the next test."""
    python = _room(tmp_path / "room")
    _install(python, "-e", ".", cwd=tree)
    assert _places(python, tmp_path) == [tree / "src" / "truepose", tree / "models"]


def test_a_tree_without_links_runs_where_it_stands(tree: Path, tmp_path: Path) -> None:
    found = _works(Path(sys.executable), tmp_path, PYTHONPATH=str(tree / "src"))
    assert found == [tree / "src" / "truepose", tree / "models"]


def _wheel(tree: Path, folder: Path) -> Path:
    """The wheel built from a tree."""
    _run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=tree)
    (wheel,) = folder.glob("*.whl")
    return wheel


def _held(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.fixture(scope="module")
def own_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _wheel(ROOT, tmp_path_factory.mktemp("here"))


def test_every_tree_gives_the_same_wheel(tree: Path, own_wheel: Path, tmp_path: Path) -> None:
    assert _held(_wheel(tree, tmp_path)) == _held(own_wheel)


def test_the_wheel_that_every_tree_gives_installs_and_runs(own_wheel: Path, tmp_path: Path) -> None:
    scratch, room = tmp_path / "scratch", tmp_path / "room"
    scratch.mkdir()
    python = _room(room)
    _install(python, str(own_wheel), cwd=tmp_path)
    package, models = _works(python, scratch)
    assert package.is_relative_to(room) and models == package / "models"
