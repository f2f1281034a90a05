"""Generated directories that are committed: a change of a template shows as a change of ``tests/golden``.

Each case is a machine (``machine.yaml``) with what is generated from it, byte for byte; of long files that say little
more than those of ``arm3`` only size and SHA-256 are kept, in ``digests.txt``. After a change that is meant:

    pytest tests/kernel/codegen/test_golden.py --update-golden

writes the directories anew; what then differs is for the reviewer. Python files have the ending ``.txt`` added, so that
tools for this project's own code leave them alone.
"""

from __future__ import annotations

import difflib
import hashlib
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from support import TESTS
from truepose.codegen.c import generate
from truepose.codegen.printer import Real
from truepose.models.load import load_machine

GOLDEN = TESTS / "golden"
CASES: dict[str, Real] = {"arm3": "float", "stage": "double", "hexapod": "double"}
WHOLE = {
    "arm3": ("",),
    "stage": ("_kin.c", "_kin.h", "README.md"),
    "hexapod": ("_kin.h", "_batch.c", "README.md", "CMakeLists.txt"),
}
"""Endings of the files that are committed whole."""
_LINES = 24
_OWN_PROCESS = """
import hashlib, sys
from pathlib import Path
from truepose.codegen.c import render
from truepose.models.load import load_machine
for case, real in zip(sys.argv[2::2], sys.argv[3::2]):
    machine = load_machine(Path(sys.argv[1]) / case / "machine.yaml")
    for name, text in render(machine, real).items():
        print(case, name, hashlib.sha256(text.encode()).hexdigest())
"""


def generated(case: str, where: Path) -> dict[str, bytes]:
    """Contents by name of a file in the directory, written by ``generate``."""
    machine = load_machine(GOLDEN / case / "machine.yaml")
    files = generate(machine, where / case, CASES[case])
    return {file.relative_to(where / case).as_posix(): file.read_bytes() for file in files}


def digest(name: str, content: bytes) -> str:
    """Its line in ``digests.txt``."""
    return f"{hashlib.sha256(content).hexdigest()} {len(content)} {name}"


def committed_as(case: str, files: dict[str, bytes]) -> dict[str, bytes]:
    """Contents by name in ``tests/golden/CASE``."""
    whole = {name: content for name, content in files.items() if name.endswith(WHOLE[case])}
    lines = [digest(name, content) for name, content in sorted(files.items()) if name not in whole]
    out = {f"{name}.txt" if name.endswith(".py") else name: content for name, content in whole.items()}
    return {**out, "digests.txt": "".join(f"{line}\n" for line in lines).encode()} if lines else out


def update(case: str, files: dict[str, bytes]) -> None:
    """Write what is to be committed; files that are no longer generated go."""
    for stale in sorted((GOLDEN / case).rglob("*"), reverse=True):
        if stale.is_file() and stale.name != "machine.yaml":
            stale.unlink()
    for name, content in files.items():
        (GOLDEN / case / name).parent.mkdir(exist_ok=True)
        (GOLDEN / case / name).write_bytes(content)


def difference(name: str, committed: bytes, new: bytes) -> str:
    """Where two contents differ, in a few lines."""
    old_lines, new_lines = (text.decode().splitlines() for text in (committed, new))
    marked = difflib.unified_diff(
        old_lines, new_lines, f"committed {name}", f"generated {name}", "", "", 1, ""
    )
    lines = list(marked)
    more = [f"... and {len(lines) - _LINES} lines more"] if len(lines) > _LINES else []
    return "\n".join([*lines[:_LINES], *more]) or f"{name}: the ends of lines differ"


@pytest.mark.parametrize("case", CASES)
def test_generated_directory_is_as_committed(
    case: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    new = committed_as(case, generated(case, tmp_path))
    if request.config.getoption("--update-golden"):
        update(case, new)
    folder = GOLDEN / case
    there = {
        file.relative_to(folder).as_posix(): file.read_bytes() for file in folder.rglob("*") if file.is_file()
    }
    old = {name: content for name, content in there.items() if name != "machine.yaml"}
    found = [f"{name} is no longer generated" for name in sorted(old.keys() - new.keys())]
    found += [f"{name} is not committed" for name in sorted(new.keys() - old.keys())]
    found += [
        difference(name, old[name], new[name])
        for name in sorted(old.keys() & new.keys())
        if old[name] != new[name]
    ]
    told = "\n".join(found)
    assert not found, f"tests/golden/{case} (pytest --update-golden, if this is meant):\n{told}"


@pytest.mark.nightly
def test_bytes_depend_on_the_machine_file_alone(tmp_path: Path) -> None:
    """Not on the order of sets, what ran before, or which kernels the mathematical libraries choose for a processor."""
    rows = [
        f"{case} {name} {hashlib.sha256(content).hexdigest()}"
        for case in CASES
        for name, content in generated(case, tmp_path).items()
    ]
    arguments = [str(GOLDEN), *(word for case in CASES.items() for word in case)]
    other_processor = {
        "OPENBLAS_CORETYPE": "Nehalem",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F",
    }
    for seed, added in ("1", {}), ("2", other_processor if platform.machine() == "x86_64" else {}):
        environment = {**os.environ, **added, "PYTHONHASHSEED": seed}
        ran = subprocess.run(
            [sys.executable, "-c", _OWN_PROCESS, *arguments],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert ran.returncode == 0, ran.stderr
        assert ran.stdout.splitlines() == rows
