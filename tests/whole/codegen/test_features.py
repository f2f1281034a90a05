"""Features of the generated C: what is asked for is there, nothing else is, and it computes the same."""

from __future__ import annotations

import ctypes
import re
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from support.examples import by_day
from support.generated_c import COMPILER, WARNINGS, Built, build, needs_compiler
from support.generated_machines import machine_of
from truepose.arrays import Array
from truepose.cli import app
from truepose.codegen.c import generate
from truepose.codegen.features import FEATURES, Features
from truepose.codegen.printer import Real
from truepose.models.file.machine_file import checked_machine
from truepose.models.file.yaml_document import parse_document
from truepose.models.leaves.starting.start import bundled_start
from truepose.models.leaves.starting.written import files_of
from truepose.models.load import build_machine
from truepose.models.machine.machine import Machine

CASES: list[tuple[str, Real, str]] = [
    ("arm", "double", "warm"),
    ("arm", "float", "warm,p"),
    ("arm", "double", "cold,branches,p"),
    ("arm", "double", "branches,batch"),
    ("nano", "double", "warm"),
    ("scara", "double", "warm"),
    ("turns", "double", "warm,batch"),
    ("rails", "double", "warm"),
    ("hybrid", "float", "cold"),
]
chosen = pytest.mark.parametrize(("name", "real", "features"), CASES, ids=["-".join(case) for case in CASES])


@cache
def with_features(where: Path, name: str, real: Real, features: str) -> Built:
    """A machine's C with some features, every file compiled with every warning an error."""
    assert COMPILER is not None
    directory = where / f"{name}_{real}_{features}"
    generate(machine_of(where, name), directory, real, features=Features.of(features))
    sources = sorted(file.name for file in directory.glob(f"{name}_*.c"))
    command = [COMPILER, *WARNINGS, "-O0", "-shared", "-fPIC", *sources, "-lm", "-o", "lib.so"]
    subprocess.run(command, cwd=directory, check=True)
    library = ctypes.CDLL(str(directory / "lib.so"))
    return replace(build(where, name, real), directory=directory, library=library)


def asked(built: Built, feature: str) -> bool:
    return built.define(f"HAS_{feature.upper()}") == 1


@needs_compiler
@chosen
def test_the_header_says_what_is_there(root_directory: Path, name: str, real: Real, features: str) -> None:
    built = with_features(root_directory, name, real, features)
    for feature in FEATURES:
        assert asked(built, feature) == (feature == "warm" or feature in features.split(",")), feature
    header = (built.directory / f"{name}_kin.h").read_text()
    for function, feature in (("ik_all", "branches"), ("fk_n", "batch")):
        assert hasattr(built.library, f"{name}_{function}") == asked(built, feature)
    assert (f"{name}_ik_all" in header) == asked(built, "branches")
    assert (f"{name}_BRANCHES 16" in header) == asked(built, "branches")
    for file in built.directory.glob("*.c"):  # what nothing uses is not there
        text = file.read_text()
        for function in re.findall(r"^(?:static|SMALL|APART|RARE|LINE_FUNCTION)[^\n(=]*?(\w+)\(", text, re.M):
            assert len(re.findall(rf"\b{function}\b", text)) > 1, f"{file.name}: {function}"


def example_of(
    machine: Machine, real: Real, where: Path, wrong: str = ""
) -> subprocess.CompletedProcess[str]:
    """What the example prints of a machine's smallest C; ``wrong`` has functions that replace generated ones."""
    assert COMPILER is not None
    name = machine.name
    generate(machine, where, real, features=Features.of("warm"))
    (where / "wrong.c").write_text(f'#include "{name}_kin.h"\n' + wrong)
    replaced = re.findall(rf"int ({name}_\w+)\(.*{{", wrong)
    renamed = [f"-D{function}=right_{function}" for function in replaced]
    subprocess.run([COMPILER, *WARNINGS, *renamed, "-O0", "-c", f"{name}_kin.c"], cwd=where, check=True)
    linked = [COMPILER, "-O0", "example.c", "wrong.c", f"{name}_kin.o", "-lm", "-o", "example"]
    subprocess.run(linked, cwd=where, check=True)
    return subprocess.run([where / "example"], capture_output=True, text=True, check=False)


def known_arm(name: str, folder: Path) -> Machine:
    text = files_of(bundled_start(name))[0]
    return build_machine(checked_machine(folder / "arm.yaml", parse_document(text, folder / "arm.yaml")))


@needs_compiler
@pytest.mark.parametrize(("name", "real"), [("arm", "float"), ("planar", "double"), ("redundant", "float")])
def test_the_example_runs(root_directory: Path, tmp_path: Path, name: str, real: Real) -> None:
    """Where the guess alone has to do, the example's is near enough, and loops start closed there."""
    ran = example_of(machine_of(root_directory, name), real, tmp_path)
    assert ran.returncode == 0, ran.stdout


@needs_compiler
@pytest.mark.parametrize(
    "name", by_day(["ur5e", "ur10", "irb120", "iiwa7", "puma560", "gantry", "gough"], "ur5e", "gough")
)
def test_the_example_runs_for_arms_whose_zero_is_singular_and_others(tmp_path: Path, name: str) -> None:
    ran = example_of(known_arm(name, tmp_path), "double", tmp_path)
    assert ran.returncode == 0, ran.stdout


@needs_compiler
@chosen
def test_it_computes_what_all_features_compute(
    root_directory: Path, name: str, real: Real, features: str
) -> None:
    built, whole = with_features(root_directory, name, real, features), build(root_directory, name, real)
    slack = 1e-9 if real == "double" else 1e-3
    rows, rng = built.samples(), np.random.default_rng(5)
    for row, other in zip(rows, np.roll(rows, 1, axis=0), strict=True):
        q, pose = row[: built.n], row[built.n :]
        zs = [None, built.model.z_home + rng.uniform(0, 2, len(built.model.z_home))]
        for z in zs if len(built.model.z_home) else [None, np.zeros(1)]:
            for function, size in (("fk", 12), ("jac", 6 * built.n), ("compensate", built.n)):
                code, found = built.call(function, q, out=np.zeros(size), z=z)
                same, expected = whole.call(function, q, out=np.zeros(size), z=z)
                assert (code, same) == (0, 0), function
                np.testing.assert_allclose(found, expected, rtol=slack, atol=slack)
        near = q + 0.001 * (other[: built.n] - q)
        code, found = built.ik(pose, near)
        assert code == 0
        np.testing.assert_allclose(built.fk(found)[1], pose, rtol=0, atol=1e-6 if real == "double" else 3e-3)


@needs_compiler
@pytest.mark.parametrize(
    ("name", "features"), [("arm", "branches,batch"), ("rails", "warm"), ("turns", "warm,batch")]
)
def test_other_parameters_are_refused_where_they_are_built_in(
    root_directory: Path, name: str, features: str
) -> None:
    built = with_features(root_directory, name, "double", features)
    row, p = built.samples()[2], built.model.p_home
    q, pose = row[: built.n], row[built.n :]
    calls: list[tuple[str, list[Array], int]] = [
        ("fk", [q], 12),
        ("fk_from", [q, pose], 12),
        ("ik", [pose, q], built.n),
        ("jac", [q], 6 * built.n),
        ("compensate", [q], built.n),
    ]
    nan = np.full(max(1, len(built.model.z_home)), np.nan)
    for function, inputs, size in calls:
        before = np.full(size, -7.0)
        for given in ({"p": p}, {"z": nan}):
            code, after = built.call(function, *inputs, out=before, **given)
            assert code == 4, function
            np.testing.assert_array_equal(after, before)
    if asked(built, "batch"):
        poses, codes = np.full(2 * 12, -7.0), np.zeros(2, dtype=np.int32)
        arrays = [p, None, np.tile(q, 2), poses, codes]
        at = [None if a is None else a.ctypes.data_as(ctypes.c_void_p) for a in arrays]
        assert getattr(built.library, f"{name}_fk_n")(*at[:2], 2, *at[2:]) == 2
        assert codes.tolist() == [4, 4] and set(poses) == {-7.0}


@needs_compiler
def test_far_guesses_are_told_from_near_ones(root_directory: Path) -> None:
    """Without restarts a guess that leads nowhere is 2, and one that leads out of the ranges 3; with them both are solved."""
    warm = with_features(root_directory, "arm", "double", "warm")
    cold = with_features(root_directory, "arm", "double", "cold,branches,p")
    rows = warm.samples(40)
    codes = []
    for row, other in zip(rows, np.roll(rows, 1, axis=0), strict=True):
        pose, guess = row[warm.n :], other[: warm.n]
        code, found = warm.ik(pose, guess)
        codes.append(code)
        if code:
            np.testing.assert_array_equal(found, -7.0)
        assert cold.ik(pose, guess)[0] == 0
    assert 2 in codes and set(codes) <= {0, 2, 3}
    beyond = rows[2][: warm.n].copy()
    beyond[2] += 2 * np.pi  # a full turn outside of its range
    assert warm.ik(rows[2][warm.n :], beyond)[0] == 3
    assert cold.ik(rows[2][warm.n :], beyond)[0] == 0


def test_unknown_and_impossible_features_are_refused(tmp_path: Path) -> None:
    machine_of(tmp_path, "scara")
    options = ["codegen", str(tmp_path / "scara.yaml"), "-o", str(tmp_path / "out"), "--features"]
    for asked_for, words in (
        ("warm,colt", ["'colt'", *FEATURES, "did you mean 'cold'?"]),
        ("warm,branches", ["found branches", "scara", "leave it out"]),
    ):
        done = CliRunner().invoke(app, [*options, asked_for])
        assert done.exit_code == 2
        assert done.stderr.count("\n") == 1
        for word in ["error: features: found", *words]:
            assert word in done.stderr, done.stderr
        assert not (tmp_path / "out").exists()


def test_fewer_features_take_their_files_away(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "scara")
    generate(machine, tmp_path / "out")
    assert (tmp_path / "out" / "scara_batch.c").exists()
    (tmp_path / "out" / "mine_batch.c").write_text("kept")
    files = generate(machine, tmp_path / "out", features="warm")
    there = {file for file in (tmp_path / "out").rglob("*") if file.is_file()}
    assert there == {*files, tmp_path / "out" / "mine_batch.c"}
    assert "batch" not in (tmp_path / "out" / "CMakeLists.txt").read_text()


@needs_compiler
@pytest.mark.parametrize(
    ("wrong", "call", "result"),
    [("fk", "p, z, q, T", "T[3] += 1e-5"), ("ik", "p, z, T, near, q", "q[0] += 1e-7"), ("ik", "p, z, T, near, q", "code = 2")],
)  # fmt: skip
def test_the_example_fails_on_wrong_code(tmp_path: Path, wrong: str, call: str, result: str) -> None:
    """A pose that is 10 nm off, joints that are 0.1 urad off, and an inverse that gives up."""
    machine = known_arm("ur5e", tmp_path)
    arguments = {
        "fk": "const double *p, const double *z, const double *q, double *T",
        "ik": "const double *p, const double *z, const double *T, const double *near, double *q",
    }[wrong]
    code = (
        f"int right_ur5e_{wrong}({arguments});\n"
        f"int ur5e_{wrong}({arguments}) {{ int code = right_ur5e_{wrong}({call}); {result}; return code; }}\n"
    )
    ran = example_of(machine, "double", tmp_path, code)
    assert ran.returncode == 1, ran.stdout
