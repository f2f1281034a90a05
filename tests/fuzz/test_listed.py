"""Hostile files that once did harm are refused in one line, with the words that name what is wrong."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import pytest
from typer.testing import CliRunner

from fuzzing import seeds
from truepose.cli import app

M, R = "machine.yaml", "recording.csv"
CALIBRATE, SIMULATE = ("calibrate", M, R, "-o", "out/fit"), ("simulate", M, R, "-o", "out/seen.csv")
Edit = Callable[[str], str | bytes]


def _same(text: str) -> str:
    return text


def _instead(old: str, new: str) -> Edit:
    def edit(text: str) -> str:
        assert old in text, old
        return text.replace(old, new)

    return edit


@dataclass(frozen=True)
class Case:
    """What is done to the files of a good machine, the command, and a part of what is said; nothing where it is done."""

    words: str
    machine: Edit = _same
    recording: Edit = _same
    command: tuple[str, ...] = SIMULATE


def _field(old: str, new: str, words: str, command: tuple[str, ...] = SIMULATE) -> Case:
    return Case(words, machine=_instead(old, new), command=command)


def _rows(edit: Edit, words: str) -> Case:
    return Case(words, recording=edit, command=CALIBRATE)


def _more(text: str, headers: str, cell: str) -> str:
    head, *rows = text.splitlines()
    return "\n".join([head + headers, *(row + cell for row in rows)]) + "\n"


def _parquet(columns: dict[str, object]) -> bytes:
    stream = io.BytesIO()
    pq.write_table(pa.table(columns), stream, compression="zstd")
    return stream.getvalue()


def _chain(count: int) -> str:
    joints = "".join(
        f"    - {{name: q{k}, kind: revolute, alpha: {90 * (k % 2)}, d: 10}}\n" for k in range(count)
    )
    return f"schema: truepose/machine/1\nname: arm\nmechanism:\n  type: serial\n  joints:\n{joints}"


def _bomb(text: str) -> str:
    letters = "abcdefghij"
    lines = [f"a: &a [{', '.join('1' * 9)}]"]
    lines += [f"{now}: &{now} [{', '.join([f'*{last}'] * 9)}]" for last, now in pairwise(letters)]
    return "\n".join(lines) + "\n"


TOWER = "(((9**99*m)**99)**99)"
NUMBER = "expected a finite number (mm), found"
CASES: tuple[Case, ...] = (
    _rows(_instead("q2 [rad]", f"q2 [{TOWER}]"), f"unknown unit '{TOWER}'"),
    _rows(lambda t: f"q1{' ' * 130000}[x,q2\n1,2\n", "missing column 'q1'"),
    _rows(lambda t: f"q1{' [' * 65000},q2\n1,2\n", "missing column 'q1'"),
    _rows(lambda t: f"q1{' [' * 65000} q2\n1 2\n", "missing column 'q1'"),
    _rows(lambda t: _more(t, "".join(f",temprature.link{k}" for k in range(9000)), ",1" * 9000), ""),
    _rows(lambda t: "q1,q2\n" + "1,1\n" * 3000000, "rows, expected at most 2,000,000"),
    _rows(lambda t: 'q1,q2\n"' + "1,2\n" * 10**6, "field larger than field limit"),
    _rows(lambda t: _parquet({"q2": [1.0]}).replace(b"q2", b"q\xff"), "no text in UTF-8"),
    _rows(lambda t: _parquet({"q2": [1.0]})[:-20], "cannot read the file"),
    _rows(_instead(",60.0,", f",{'9' * 400},"), "expected a finite number"),
    _rows(lambda t: _more(t, ",temperature.air", ",1e300"), "found 1e+300, expected at most 1e+20 by size"),
    Case("found 1,000 entries, expected at most 300", machine=lambda t: _chain(1000)),
    Case("too large once its aliases are written out", machine=_bomb),
    Case("values, expected at most 500,000", machine=lambda t: t + f"a: [{'1,' * 25000000}1]\n"),
    Case("duplicate key 'name'", machine=lambda t: t + "name: other\n"),
    Case(
        "adds nothing as it stands, expected a value of b (rad)",
        command=(*SIMULATE, "--effect", "backlash@q1"),
    ),
    Case("found b = -1 rad, expected a value >= 0", command=(*SIMULATE, "--effect", "backlash@q1:b=-1")),
    Case("has no place 'platform'", command=(*SIMULATE, "--effect", "gravity-sag@platform:c=1e-6")),
    Case("at most 1e+12 by size", command=(*SIMULATE, "--effect", "backlash@q1:b=1e300")),
    _field("xyz: 0.02", f"xyz: 1 {TOWER}", f"found '1 {TOWER}'"),
    _field("r: 300,", "r: 300, r: 301,", "duplicate key 'r'"),
    _field("r: 300", f"r: {'9' * 400}", "a number of 400 characters"),
    _field("length: 0.1", f"length: {'9' * 400}", "a number of 400 characters"),
    _field("[99, 101]", f"[99, {'9' * 400}]", "a number of 400 characters"),
    _field("r: 300", "r: 1e300", "at most 1e+12 by size in mm, found 1e+300"),
    _field("length: 0.1", "length: 1e-300", "between 1e-12 and 1e+12 in mm, found 1e-300"),
    _field(
        "{xyz: 0.02}",
        "{xyz: .inf}",
        "sensor[0].sigma.xyz: expected a finite number > 0 (mm), found inf",
        CALIBRATE,
    ),
    _field("{xyz: 0.02}", "{xyz: 1e-300}", "between 1e-12 and 1e+12", CALIBRATE),
    _field("kg: 35.0", "kg: 1e300", "at most 1e+12", CALIBRATE),
    _field("-9.81", "1e-300", "expected [0, 0, 0] or an acceleration of at least 1e-06 m/s^2", CALIBRATE),
    _field("gear_ratio: 100", "gear_ratio: 0", "expected a finite number that is not 0 (1), found 0"),
    _field("screw_pitch: 5", "screw_pitch: 0", "expected a finite number that is not 0 (mm), found 0"),
    _field("in: world", "in: nonsense", "frames.base.in: found 'nonsense', expected 'world'"),
    _field("in: flange", "in: nonsense", "frames.tool.in: found 'nonsense', expected flange"),
    _field("b: {value: 0.01", "b: {value: -0.01", ""),
    _field("r: 300", "r: !!bool abc", "not valid YAML: found 'abc' under a tag"),
    _field("name: arm", 'name: "\\ud800"', "found U+D800"),
    _field("name: q1", 'name: "\\ud800"', "found U+D800"),
    *(
        _field("r: 300", f"r: {number}", f"{NUMBER} '{number}'")
        for number in ("0127", "2:07", "1_000", "0x1F")
    ),
)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> seeds.Case:
    (found,) = (case for case in seeds.cases(tmp_path_factory.mktemp("seeds")) if case.name == "full")
    return found


@pytest.mark.parametrize("case", CASES, ids=[case.words[:60] or "accepted" for case in CASES])
def test_what_once_did_harm_is_refused_in_words(case: Case, good: seeds.Case, tmp_path: Path) -> None:
    for name, edit, text in ((M, case.machine, good.machine), (R, case.recording, good.recording)):
        out = edit(text)
        (tmp_path / name).write_bytes(out if isinstance(out, bytes) else out.encode("utf-8"))
    (tmp_path / "out").mkdir()
    with contextlib.chdir(tmp_path):
        found = CliRunner().invoke(app, list(case.command))
    assert found.exception is None or isinstance(found.exception, SystemExit)
    assert found.exit_code == (2 if case.words else 0), found.output
    if case.words:
        assert found.stderr.count("error: ") == 1 and case.words in found.stderr
        assert not list((tmp_path / "out").iterdir())
