"""Every example of the reference pages: machine files load, recordings are read, commands run."""

from __future__ import annotations

import shlex
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from support import ROOT
from support.documents import Block, blocks, complete, write_files
from truepose.cli import app
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

DOCS = ROOT / "docs"
PAGES = [DOCS / f"{name}.md" for name in ("reference/machine-file", "reference/recording")]
EXAMPLES = [(page, block) for page in PAGES for block in blocks(page)]
LANGUAGES = {"yaml", "csv", "sh", "xml"}


def of(language: str, begins: str = "") -> list[object]:
    """The examples in a language, named by page and place. Tables that commands read do not name a machine file."""
    return [
        pytest.param(page, block, id=f"{page.stem}-{block.file or k}")
        for k, (page, block) in enumerate(EXAMPLES)
        if block.language == language and block.text.startswith(begins)
    ]


def test_every_block_is_tried() -> None:
    assert {block.language for _, block in EXAMPLES} == LANGUAGES


@pytest.mark.parametrize(("page", "block"), of("yaml"))
def test_a_machine_file_loads(page: Path, block: Block, tmp_path: Path) -> None:
    write_files(page, tmp_path)
    (tmp_path / "whole.yaml").write_text(block.text, encoding="utf-8")
    machine = load_machine(tmp_path / "whole.yaml" if block.whole else complete(block.fields, page, tmp_path))
    assert machine.mechanism.actuators and machine.sensors


@pytest.mark.parametrize(("page", "block"), of("csv", begins="# "))
def test_a_recording_is_read_and_every_column_means_something(
    page: Path, block: Block, tmp_path: Path
) -> None:
    write_files(page, tmp_path)
    named = block.text.splitlines()[0].removeprefix("# ")
    machine = load_machine(tmp_path / named)
    recording = load_recording(machine, [tmp_path / block.file])
    assert len(recording) > 1
    assert not [note for note in recording.notes if "mean nothing" in note]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_commands_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_files(page, tmp_path)
    monkeypatch.chdir(tmp_path)
    known = {info.name or getattr(info.callback, "__name__", "") for info in app.registered_commands}
    missing = []
    for block in blocks(page):
        for line in block.text.splitlines() if block.language == "sh" else ():
            program, command, *rest = shlex.split(line)
            assert program == "truepose"
            if command not in known:
                missing.append(command)
                continue
            result = CliRunner().invoke(app, [command, *rest])
            assert result.exit_code == 0, f"{line}\n{result.output}"
    if missing:
        pytest.skip(f"no command {', '.join(missing)} yet")


def test_the_data_sheet_s_arm_is_that_of_the_first_example(tmp_path: Path) -> None:
    page = PAGES[0]
    write_files(page, tmp_path)
    (sheet,) = [block for block in blocks(page) if "convention: standard" in block.text]
    first = load_machine(tmp_path / "arm.yaml")
    other = load_machine(complete(sheet.fields, page, tmp_path))
    rng = np.random.default_rng(1)
    for q in rng.uniform(-2.0, 2.0, (5, 6)):
        one, two = (pose_of(machine, q) for machine in (first, other))
        assert np.allclose(one, two, atol=1e-9)


def pose_of(machine: Machine, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 4) pose of the tool."""
    model = symbolic_model(machine)
    return np.array(ca.Function("pose", [model.q, model.p], [model.pose])(q, model.p_home))
