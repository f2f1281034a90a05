"""What ``truepose`` offers: its names, listed, imported when used, known to type checkers."""

from __future__ import annotations

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import truepose

ENGINE = ("identification.recording.recording", "models.load", "codegen.c", "pool")
SOURCE = Path(truepose.__file__).read_text(encoding="utf-8")


def test_completion_offers_the_public_names_and_nothing_else() -> None:
    assert dir(truepose) == sorted(truepose.__all__)
    assert 12 <= len(dir(truepose)) <= 28
    used = "import truepose, truepose.cli, truepose.models.load; print(dir(truepose) == sorted(truepose.__all__))"
    done = subprocess.run([sys.executable, "-c", used], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"


def test_type_checkers_see_every_name() -> None:
    (block,) = [
        node
        for node in ast.parse(SOURCE).body
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
    ]
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    homes = {alias.name: node.module for node in imports for alias in node.names}
    assert homes.keys() | {"__version__"} == set(truepose.__all__)
    for name, home in homes.items():
        assert getattr(truepose, name) is getattr(import_module(str(home)), name)


def test_importing_the_package_imports_nothing_heavy() -> None:
    heavy = "[m for m in ('numpy', 'pandas', 'casadi', 'typer') if m in sys.modules]"
    probe = f"import sys, truepose; truepose.InputError, dir(truepose); print({heavy})"
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize(
    ("module", "left"),
    [
        ("cli", (*(f"truepose.{m}" for m in ENGINE), "pandas", "rich", "joblib")),
        ("pool", ("distributed", "dask")),
        ("files", ("pandas", "numpy")),
        ("commands.common", ("truepose.identification", "truepose.models")),
    ],
)
def test_what_only_type_checkers_need_is_not_imported(module: str, left: tuple[str, ...]) -> None:
    """The command line takes its engine when a command runs: help and refusals do not wait for it."""
    probe = f"import sys, truepose.{module}; print([m for m in {left!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
