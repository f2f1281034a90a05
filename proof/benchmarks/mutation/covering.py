"""Which tests run which lines, and how long they take: collected once, a file of tests after the other, and kept."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TypedDict

import pytest
from joblib import Parallel, delayed

from .mutants import Mutant

DISTANT = re.compile("wrappers|embedded|packaging|real_|_by_others|fuzz")
"""Tests of other compilers and of real recordings: they take minutes and say little of one line."""
LAST = "test_golden_diagnoses"
LINES_A_SECOND = 1e4
"""A test that runs so many lines more is as little wanted as one that takes a second longer."""
SLOW = 40.0
"""CPU seconds beyond which a test is run against no mutant."""


class Record(TypedDict):
    """What `recorder` writes of a test: CPU seconds, and the lines that it runs by file, those of its fixtures again."""

    test: str
    seconds: float
    passed: bool
    lines: dict[str, list[int]]
    setup: dict[str, list[int]]


@dataclass(frozen=True)
class Coverage:
    """Records of tests that passed in time."""

    tests: tuple[Record, ...]

    @cached_property
    def by_line(self) -> dict[tuple[str, int], list[Record]]:
        """The tests that run a line."""
        out: dict[tuple[str, int], list[Record]] = {}
        for record in self.tests:
            for file, lines in record["lines"].items():
                for line in lines:
                    out.setdefault((file, line), []).append(record)
        return out

    @cached_property
    def by_fixture(self) -> dict[tuple[str, int], set[str]]:
        """The files of tests some fixture of which runs a line: it may be another test that asked for it first."""
        out: dict[tuple[str, int], set[str]] = {}
        for record in self.tests:
            for file, lines in record["setup"].items():
                for line in lines:
                    out.setdefault((file, line), set()).add(_file(record))
        return out

    def chosen(self, root: Path, mutant: Mutant, budget: float) -> tuple[list[str], float]:
        """Tests that run a mutant, or may by a fixture, and their CPU seconds: at most ``budget``.

        The most specific and fastest come first. Where only imports run the line, these are the tests of lines that
        use its name and of files that mention it; where none does, the tests of the module and of files that mention it.
        """
        lines = [(mutant.file, line) for line in mutant.lines] or list(_using(root, mutant.names))
        own = {record["test"]: record for line in lines for record in self.by_line.get(line, ())}
        if not mutant.lines:
            told = _mentioning(root, mutant.names)
            own |= {record["test"]: record for record in self.tests if _file(record) in told}
        if not own:  # another process runs it, started by tests that name the module or run the rest of it
            told = _mentioning(root, (Path(mutant.file).stem,))
            own = {r["test"]: r for r in self.tests if mutant.file in r["lines"] or _file(r) in told}
        files = {name for line in lines for name in self.by_fixture.get(line, ())}
        shared = [r for r in self.tests if r["test"] not in own and _file(r) in files]
        out, total = [], 0.0
        for record in (*sorted(own.values(), key=_cost), *sorted(shared, key=_cost)):
            if total + record["seconds"] <= budget:
                out.append(record["test"])
                total += record["seconds"]
        return out, total


def _file(record: Record) -> str:
    return record["test"].partition("::")[0]


def _cost(record: Record) -> tuple[bool, float, str]:
    count = sum(map(len, record["lines"].values()))
    return LAST in record["test"], record["seconds"] + count / LINES_A_SECOND, record["test"]


@cache
def _texts(root: Path) -> dict[str, list[str]]:
    """Lines of the product's modules."""
    folders = [root / name for name in ("models", "identification", "codegen", "src")]
    files = [path for folder in folders for path in folder.rglob("*.py")]
    return {str(p.resolve().relative_to(root)): p.read_text(encoding="utf-8").splitlines() for p in files}


@cache
def _mentioning(root: Path, names: tuple[str, ...]) -> set[str]:
    """Files of tests in which a name stands."""
    words = [re.compile(rf"\b{name}\b") for name in names]
    texts = {file: (root / file).read_text(encoding="utf-8") for file in _test_files(root)}
    return {file for file, text in texts.items() if any(w.search(text) for w in words)}


def _test_files(root: Path) -> list[str]:
    """Files of tests, as pytest names them."""
    return sorted(path.relative_to(root).as_posix() for path in (root / "tests").rglob("test_*.py"))


def _using(root: Path, names: tuple[str, ...]) -> Iterator[tuple[str, int]]:
    """Lines of the product that use a module's names."""
    words = [re.compile(rf"\b{name}\b") for name in names]
    for file, lines in _texts(root).items():
        yield from ((file, n) for n, line in enumerate(lines, 1) if any(w.search(line) for w in words))


def collect(tree: Path, records: Path, workers: int) -> Coverage:
    """Run every file of tests in a copy of the tree, but for those that have their record."""
    records.mkdir(parents=True, exist_ok=True)
    files = [file for file in _test_files(tree) if not DISTANT.search(file)]
    wanted = [file for file in files if not (records / f"{_flat(file)}.jsonl").exists()]
    Parallel(n_jobs=workers, verbose=5 if wanted else 0)(delayed(_record)(tree, records, f) for f in wanted)
    texts = [path.read_text(encoding="utf-8") for path in sorted(records.glob("*.jsonl"))]
    if not all(texts):
        raise RuntimeError(
            f"{records}: some files of tests were not run, their records are empty; see their logs"
        )
    found: list[Record] = [json.loads(line) for text in texts for line in text.splitlines() if line]
    return Coverage(tuple(r for r in found if r["passed"] and r["seconds"] <= SLOW))


def _flat(file: str) -> str:
    """The name of a file's record: all lie in one folder."""
    return file.removeprefix("tests/").removesuffix(".py").replace("/", ".")


def _record(tree: Path, records: Path, file: str) -> None:
    name = _flat(file)
    partial = records / f"{name}.part"
    partial.write_text("", encoding="utf-8")
    environment = settings(tree) | {"MUTATION_RECORD": str(partial), "MUTATION_LIMIT": str(SLOW)}
    plugin = ["-p", "benchmarks.mutation.recorder", "-p", "no:cacheprovider"]
    command = [sys.executable, "-m", "pytest", "-q", *plugin, file]
    with (records / f"{name}.log").open("w") as log:
        code = subprocess.run(
            command, cwd=tree, env=environment, stdout=log, stderr=log, check=False
        ).returncode
    if code == pytest.ExitCode.NO_TESTS_COLLECTED:  # all of its tests run at night
        partial.write_text("\n", encoding="utf-8")
    partial.rename(records / f"{name}.jsonl")


def settings(tree: Path) -> dict[str, str]:
    """The environment in which the tests of a copy run on its own code."""
    path = os.pathsep.join(map(str, (tree / "src", tree, tree / "proof")))
    return os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
