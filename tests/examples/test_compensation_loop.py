"""The example's controller: calibrated, generated, compiled and run on simulated machines that share no code with it."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support import ROOT
from support.generated_c import needs_compiler

pytestmark = pytest.mark.nightly

EXAMPLE = ROOT / "examples" / "compensation_loop"


def module(name: str) -> Any:
    return importlib.import_module(f"examples.compensation_loop.{name}")


def case_of(name: str) -> Any:
    """The example's case with fewer ticks, all of them looked at, and the physics named instead of searched for."""
    case = replace(module("__main__").CASES[name], ticks=120, looked=1)
    known: dict[str, list[str]] = {
        "nanopositioner": [],
        "telescope": ["platform-deformation@platform:form=3"],
        "polisher": ["thermal-expansion@leg1+leg2+leg3:alpha=0", "joint-compliance@q5:c=0"],
    }
    return replace(case, effects=known[name])


@needs_compiler
@pytest.mark.parametrize(
    ("name", "most"),
    [
        # the paper estimates 50 nm; the cavity, which is what was measured, ends within its readings' noise of 10 nm
        ("nanopositioner", (50.0, 10.0)),
        # twelve targets of 5 um fix the tool's place to 1.5 um an axis, and its orientation to some 20 urad
        ("telescope", (5.0, 20.0)),
        # 5 um a coordinate of three targets; the robot's balls are 5 um off where the machine file has none
        ("polisher", (15.0, 2.0)),
    ],
)
def test_the_real_machine_stands_where_it_was_meant_to(
    name: str, most: tuple[float, float], tmp_path: Path
) -> None:
    case = case_of(name)
    done, errors = module("__main__").run(case, tmp_path, free_running=True, optimise="-O0")
    assert done.ticks["ticks"] == len(done.command) == 120
    assert done.ticks["refused"] == 0
    for error, bound in zip(errors["nominal"], most, strict=True):
        after = np.max(errors["compensated"][error])
        assert after < bound, error
        assert after < 0.1 * np.max(errors["nominal"][error]), error
    text = "\n".join(module("__main__").lines(name, case, done, errors))
    assert "| compensated |" in text and "a tick computes" in text and "deadlines" not in text


SPOT = "nanopositioner.reflection"
"""Of a study's folder, but on truepose alone, as its own case below says."""


@pytest.mark.parametrize(
    "path",
    [EXAMPLE / "controller.py", EXAMPLE / "paths.py", ROOT / "benchmarks" / f"{SPOT.replace('.', '/')}.py"],
    ids=lambda path: path.stem,
)
def test_the_controller_knows_no_simulator(path: Path) -> None:
    imported = {
        alias
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in (
            [node.module or "."] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names]
        )
    }
    own = {name for name in imported if name.startswith("truepose.")}
    plain = {"numpy", "numpy.typing", "collections.abc", "scipy.spatial.transform"}
    assert imported - own <= {*sys.stdlib_module_names, *plain, SPOT}


@needs_compiler
def test_a_path_that_is_none_is_refused_by_row(tmp_path: Path) -> None:
    machine, controller = module("real_machines").Nanopositioner(points=1), module("controller")
    drawing, _ = machine.write(tmp_path)
    program = controller.build(controller.load_machine(drawing), tmp_path, "-O0")
    (tmp_path / "path.csv").write_text("q1,q2,q3,q4,q5,q6\n0,0,0,0,0,0\n0,0,0,high,0,0\n")
    arguments = [str(program), "--free-running", str(tmp_path / "path.csv"), str(tmp_path / "commands.csv")]
    done = subprocess.run(arguments, check=False, capture_output=True, text=True)
    assert done.returncode == 2
    assert "path.csv: row 2: expected numbers" in done.stderr
    assert not (tmp_path / "commands.csv").exists()
