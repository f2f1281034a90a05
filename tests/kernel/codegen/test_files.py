"""The files of generated C: they build and run, need nothing but math, and are the same each time."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from support.generated_c import Built, cases, needs_compiler, run_example
from support.generated_machines import machine_of
from truepose.codegen.c import generate
from truepose.codegen.printer import Real
from truepose.codegen.texts import identifiers
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Actuator, Joint, Mechanism, Parameter, Step


def four_bar() -> Machine:
    """A planar loop in space: five closure equations too many for what moves."""
    lengths = {"crank.length": 40.0, "coupler.length": 120.0, "frame.length": 100.0, "rocker.length": 110.0}
    crank, coupler, frame, rocker = ((Step("tx", name),) for name in lengths)
    joints = (
        Joint("crank", "revolute", "base", "b1"),
        Joint("knee", "revolute", "b1", "b2", crank, home=(0.9,)),
        Joint("pivot", "revolute", "base", "b3", frame, home=(1.6,)),
        Joint("end", "revolute", "b3", "b4", rocker, home=(0.5,)),
        Joint("weld", "fixed", "b2", "b4", coupler),
    )
    parameters = tuple(Parameter(name, "mm", value, 0.1) for name, value in lengths.items())
    turn = Actuator("crank", "crank", "rad", "rad", range=(-2.5, 2.5))
    axes = {"x": "mm", "y": "mm", "z": "mm", "rx": "rad", "ry": "rad", "rz": "rad"}
    frames = tuple(Parameter(f"{f}.{a}", unit, 0.0) for f in ("base", "tool") for a, unit in axes.items())
    return Machine("fourbar", Mechanism(parameters, joints, (turn,), "b2"), frames, ())


@needs_compiler
@pytest.mark.parametrize("real", ["double", "float"])
def test_a_loop_with_more_equations_than_unknowns(tmp_path: Path, real: Real) -> None:
    generate(four_bar(), tmp_path, real)
    run_example(tmp_path, "-O1")


@pytest.mark.nightly
@needs_compiler
@cases(("arm", "turns"))
def test_example_runs_clean_under_sanitizers(built: Built, sanitizers: list[str]) -> None:
    run_example(built.directory, "-O0", "-g", *sanitizers)


def test_nothing_but_math_is_needed(tmp_path: Path) -> None:
    files = generate(machine_of(tmp_path, "arm"), tmp_path / "out")
    code = next(f for f in files if f.name == "arm_kin.c").read_text()
    assert re.findall(r"#include (\S+)", code) == ['"arm_kin.h"', "<math.h>"]
    for word in ("malloc", "static real", "truepose 0"):
        assert not re.search(rf"\b{word} \w+ ?[;=]", code)


def test_identifiers_stay_apart() -> None:
    assert identifiers(["a.b", "a-b", "a_b_2", "scale@rho4:s"]) == ["a_b", "a_b_3", "a_b_2", "scale_rho4_s"]


def test_the_same_bytes_from_the_same_input(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "rails")
    first, second = (generate(machine_of(tmp_path, "rails"), tmp_path / part, "float") for part in ("a", "b"))
    assert [str(f.relative_to(tmp_path / "a")) for f in first] == [
        "rails_kin.h",
        "rails_kin.c",
        "example.c",
        "rails_batch.h",
        "rails_batch.c",
        "rails_state.h",
        "rails_state.c",
        "CMakeLists.txt",
        "README.md",
        "test_vectors.csv",
        "wrappers/rails_kin.py",
        "wrappers/rails_kin.hpp",
        "wrappers/rails_sfun.c",
    ]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
    assert not list(tmp_path.glob(".*"))
    texts = [f.read_bytes() for f in second]
    (tmp_path / "a" / "mine.c").write_text("kept")
    generate(machine, tmp_path / "a", "double")
    same = {f.name for f, text in zip(first, texts, strict=True) if f.read_bytes() == text}
    assert same == {
        "rails_batch.h",
        "rails_batch.c",
        "rails_state.h",
        "CMakeLists.txt",
        "test_vectors.csv",
        "rails_kin.hpp",
        "rails_sfun.c",
    }
    assert (tmp_path / "a" / "mine.c").read_text() == "kept"
