"""What every command says and writes for small files of every kind: a change shows as a change of ``tests/golden_commands``.

The files are those that mutants are made from (``tests/lib/fuzzing``). Pages and C have goldens of their own. After a change
that is meant:

    pytest tests/whole/commands/test_golden_commands.py --update-golden

writes what has changed anew; what then differs is for the reviewer.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fuzzing.kinds import KINDS, Seed
from support import TESTS
from support.examples import by_day
from support.golden_pages import as_committed, lines
from truepose.cli import app
from truepose.version import VERSION

GOLDEN = TESTS / "golden_commands"
WRITTEN = {".csv", ".yaml", ".json", ".txt", ".urdf", ".md", ".src", ".mod", ".script", ".gcode"}
HEAD, TAIL = 60, 10
"""Lines of a file that are kept, where it has more than both."""
ELSEWHERE = ("recordings", "MJCF")
"""Kinds whose good files are those of another kind, or are read by a library that may not be there."""
KIND = {name: make for name, make in KINDS.items() if name not in ELSEWHERE}
MACHINES = 10
CASES = [(name, k) for name in KIND for k in (range(MACHINES) if name == "machine files" else [None])]
"""Each kind, and each machine by itself."""


@cache
def _seeds(kind: str, folder: Path) -> list[Seed]:
    return KIND[kind](folder)


def _said(seeds: list[Seed], folder: Path) -> Iterator[str]:
    for n, seed in enumerate(seeds):
        for command in seed.commands:
            seed.laid_out(folder, seed.data)
            (folder / "out").mkdir()
            found = CliRunner().invoke(app, list(command))
            yield f"== {seed.file} {n}: truepose {' '.join(command)}: exit {found.exit_code}"
            yield from found.output.splitlines()
            for file in sorted((folder / "out").rglob("*")):
                if (
                    file.suffix in WRITTEN and file.name != "fit.json"
                ):  # which holds a fit that ends in a flat valley
                    yield f"-- {file.relative_to(folder)}"
                    yield from _kept(file.read_text(encoding="utf-8").splitlines())


def _kept(text: list[str]) -> list[str]:
    return text if len(text) <= HEAD + TAIL else [*text[:HEAD], f"... {len(text)} lines", *text[-TAIL:]]


def _file(kind: str, number: int | None) -> Path:
    return GOLDEN / f"{kind.replace(' ', '_')}{'' if number is None else f'_{number}'}.txt"


@pytest.mark.parametrize(
    ("kind", "number"), by_day(CASES, *(case for case in CASES if case[1] in (None, 0, 4)))
)
def test_commands_say_and_write_as_committed(
    kind: str,
    number: int | None,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / "seeds").mkdir()
    (tmp_path / "run").mkdir()
    seeds = _seeds(kind, tmp_path / "seeds")
    assert number is None or len(seeds) == MACHINES
    monkeypatch.chdir(tmp_path / "run")
    said = "\n".join(_said(seeds if number is None else [seeds[number]], tmp_path / "run"))
    new = lines(said.replace(str(tmp_path), "FOLDER").replace(VERSION, "VERSION"))
    as_committed(_file(kind, number), new, update=bool(request.config.getoption("--update-golden")))


def test_no_golden_is_left_over() -> None:
    assert set(GOLDEN.glob("*.txt")) == {_file(*case) for case in CASES}
