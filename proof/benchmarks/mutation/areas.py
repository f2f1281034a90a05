"""Where mutants are drawn from: parts of the product, or the lines that changed since a revision."""

from __future__ import annotations

import random
import re
import subprocess
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path

from .mutants import Mutant, mutants_of

AREAS: Mapping[str, tuple[str, ...]] = {
    "models": ("models/*.py", "models/machine/*.py", "models/file/*.py"),
    "plug-ins": ("models/effects/*.py", "models/sensors/*.py", "models/builders/*.py"),
    "fit": ("identification/fit/*.py", "identification/prediction/*.py"),
    "posterior": ("identification/*.py", "identification/posterior/*.py", "identification/signatures/*.py"),
    "diagnosis": ("identification/diagnosis/*.py",),
    "recording": ("identification/recording/**/*.py",),
    "report": ("identification/report/**/*.py", "src/truepose/shown/*.py"),
    "tasks": ("identification/compensation/*.py", "identification/identifiability/*.py"),
    "codegen": ("codegen/*.py", "codegen/evaluation/*.py"),
    "commands": ("src/truepose/*.py", "src/truepose/commands/*.py"),
    "leaves": ("models/leaves/**/*.py", "identification/leaves/**/*.py", "codegen/leaves/**/*.py"),
}
PRODUCT = tuple(dict.fromkeys(pattern for patterns in AREAS.values() for pattern in patterns))


def sample(root: Path, area: str, count: int, seed: int) -> list[Mutant]:
    """So many mutants of an area, in an order that the seed gives; only what Python takes."""
    return _drawn(root, f"{area} {seed}", _mutants(root, AREAS[area]), count)


def changed(root: Path, revision: str, count: int, seed: int) -> list[Mutant]:
    """So many mutants of the product's lines that are other than at a revision of git."""
    lines = _changed_lines(root, revision)
    every = (m for m in _mutants(root, PRODUCT) if m.line in lines.get(m.file, ()))
    return _drawn(root, f"{revision} {seed}", every, count)


def _drawn(root: Path, seed: str, mutants: Iterator[Mutant], count: int) -> list[Mutant]:
    every = list(mutants)
    random.Random(seed).shuffle(every)
    return list(islice((mutant for mutant in every if mutant.compiles(root)), count))


def _mutants(root: Path, patterns: tuple[str, ...]) -> Iterator[Mutant]:
    files = {path.relative_to(root).as_posix() for pattern in patterns for path in root.glob(pattern)}
    for file in sorted(files):
        yield from mutants_of(root, file)


def _changed_lines(root: Path, revision: str) -> dict[str, set[int]]:
    """Numbers of lines by file, as they are now."""
    command = ["git", "diff", "--unified=0", "--no-color", revision, "--", "*.py"]
    text = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True).stdout
    out: dict[str, set[int]] = {}
    lines: set[int] = set()
    for line in text.splitlines():
        if line.startswith("+++ "):
            lines = out.setdefault(line[4:].partition("/")[2], set())
        elif hunk := re.match(r"@@ \S+ \+(\d+)(?:,(\d+))? @@", line):
            first, count = int(hunk[1]), int(hunk[2] or 1)
            lines |= set(range(first, first + count))
    return out


__all__ = ["AREAS", "changed", "sample"]
