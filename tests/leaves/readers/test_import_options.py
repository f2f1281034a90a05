"""Options of ``truepose import``: which go together, what is written beside the recording, and what is said of it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from support.command import refused, run
from truepose.models.load import load_machine

POINTS = "name,x [mm],y [mm],z [mm]\nA,1,2,3\nB,4,5,6\n"
JOINTS = "name,q1,q2\nB,20,30\nA,0,10\n"
STARS = """A caption
:NODA
:EQUAT
+40 30 00 2024 05 02 10.0 990.0 200.0 0.5 0.55 0.0065
12 00 00.0 +30 00 00.0 12 00 04.0 +30 01 00.0 13 00.0
12 00 00.0 -10 30 00.0 12 00 00.0 -10 30 00.0 06 00.0
END
"""


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in (("points.csv", POINTS), ("joints.csv", JOINTS), ("stars.dat", STARS)):
        Path(name).write_text(text, encoding="utf-8")


OF_LOG = "--offset, --every, --model: found without --log, expected the robot's log"
REFUSED = {
    "an offset without a log": ("points.csv --offset 1", OF_LOG),
    "an offset of nothing": ("points.csv --offset 0", OF_LOG),
    "a distance without a log": ("points.csv --every 0.5", OF_LOG),
    "a model without a log": ("points.csv --model m.yaml", OF_LOG),
    "two kinds of joints": (
        "points.csv --log joints.csv --joints joints.csv",
        "--log, --joints: found both, expected the joints from one of them",
    ),
    "a machine file that is there": (
        "stars.dat --machine points.csv",
        "points.csv: found a file that is there already, expected another name",
    ),
    "a machine file nowhere": ("stars.dat --machine none/m.yaml", "its directory does not exist"),
    "a name without an old one": ("points.csv --rename =b", "--rename: found '=b', expected OLD=NEW"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_does_not_go_together_is_refused(case: str) -> None:
    words, said = REFUSED[case]
    refused(f"import {words} -o out.csv", said=said)
    assert not Path("out.csv").exists()


def test_what_is_written_is_told_with_its_columns() -> None:
    """In the order of the joints, whose names the points are sought by."""
    plain = run("import points.csv -o out.csv --joints joints.csv --rename q1=a --rename x=b")
    head, first, _ = Path("out.csv").read_text(encoding="utf-8").splitlines()[-3:]
    assert plain.stdout == f"out.csv: 2 rows: {', '.join(head.split(','))}\n"
    row = dict(zip(head.split(","), first.split(","), strict=True))
    assert {key.partition(" ")[0]: float(v) for key, v in row.items() if key != "name"} == {
        "a": 20.0, "q2": 30.0, "b": 4.0, "y": 5.0, "z": 6.0,
    }  # fmt: skip
    told = json.loads(
        run("import points.csv -o out.csv --joints joints.csv --rename q1=a --rename x=b --json").stdout
    )
    assert told.pop("notes") == ["joints.csv: joined with points.csv by column 'name'"]
    assert told == {"command": "import", "rows": 2, "columns": head.split(","), "files": ["out.csv"]}


@pytest.mark.parametrize("machine", ["mount.yaml", "elsewhere/mount.yaml"])
def test_a_machine_file_is_written_beside_the_recording_or_elsewhere(machine: str) -> None:
    """And what to do next is said; the same files come whichever folder it is."""
    Path("elsewhere").mkdir()
    Path("mine.txt").write_text("mine", encoding="utf-8")
    done = run(f"import stars.dat -o stars.csv --machine {machine}")
    first, second, third = done.stdout.splitlines()
    assert first.startswith("stars.csv: 2 rows: ") and first.count("q1") == 1
    assert second == f"{machine}: a machine file to start from; the lines marked CHECK are yours to check"
    assert third == f"then: truepose diagnose {machine} stars.csv -o result"
    assert load_machine(Path(machine)).mechanism.readings
    alone = run("import stars.dat -o alone.csv --json")
    assert Path("alone.csv").read_bytes() == Path("stars.csv").read_bytes()
    assert json.loads(alone.stdout)["files"] == ["alone.csv"]
    both = json.loads(run("import stars.dat -o again.csv --machine another.yaml --json").stdout)
    assert both["files"] == ["again.csv", "another.yaml"]
    assert Path("another.yaml").read_bytes() == Path(machine).read_bytes()
    assert Path("mine.txt").read_text(encoding="utf-8") == "mine"
    assert not list(Path().glob(".*.partial"))


def test_of_what_is_no_mount_no_machine_file_is_made() -> None:
    said = refused("import points.csv -o out.csv --machine m.yaml", said="found")
    assert "expected" in said
    assert not Path("m.yaml").exists() and not Path("out.csv").exists()
