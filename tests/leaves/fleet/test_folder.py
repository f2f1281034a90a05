"""Which machines a folder holds, and that a key follows everything that a result depends on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from support.command import input_error
from truepose.identification.leaves.fleet.folder import Member, members


def put(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name, encoding="utf-8")


def found(folder: Path) -> dict[str, Member]:
    return {member.name: member for member in members(folder, folder / "results")}


def told(folder: Path, member: Member) -> list[str]:
    return [str(file.relative_to(folder)) for file in member.files]


def test_three_layouts_side_by_side(tmp_path: Path) -> None:
    put(tmp_path, "a/own.yaml", "a/day2.csv", "a/day1.parquet", "a/readme.md", "a/.hidden.csv")
    put(tmp_path, "b/machine.yaml", "b/other.yaml", "b/recordings/1.csv", "b/notes.csv")
    put(tmp_path, "machine.yaml", "c/1.csv", "d.csv", "results/machines/a/fit.json", "notes.md", ".git/x.csv")
    fleet = found(tmp_path)
    assert list(fleet) == ["a", "b", "c", "d"] and not any(member.why for member in fleet.values())
    assert told(tmp_path, fleet["a"]) == ["a/own.yaml", "a/day1.parquet", "a/day2.csv"]
    assert told(tmp_path, fleet["b"]) == ["b/machine.yaml", "b/recordings/1.csv"]
    assert told(tmp_path, fleet["c"]) == ["machine.yaml", "c/1.csv"]
    assert told(tmp_path, fleet["d"]) == ["machine.yaml", "d.csv"]


@pytest.mark.parametrize(
    ("files", "why"),
    [
        (["m/x.yaml", "m/y.yaml", "m/1.csv"], r"found the machine files x.yaml, y.yaml, expected one"),
        (["m/1.csv"], "found no machine file, expected machine.yaml here"),
        (["m/machine.yaml", "m/readme.md"], "found no recording here, expected at least one"),
        (["m/machine.yaml", "m/1.csv", "m/recordings/readme.md"], "found no recording in recordings"),
        (["machine.yaml", "m.csv", "m.parquet"], "found several folders or recordings of this name"),
        (["machine.yaml", "m.csv", "m/1.csv"], "found several folders or recordings of this name"),
    ],
)
def test_what_does_not_fit_says_why(files: list[str], why: str, tmp_path: Path) -> None:
    put(tmp_path, *files)
    (member,) = members(tmp_path, tmp_path / "results")
    assert member.name == "m" and member.why.startswith(why)


def test_no_machine_at_all(tmp_path: Path) -> None:
    with input_error(r"found no machine, expected a folder for each"):
        members(tmp_path, tmp_path / "results")
    put(tmp_path, "recording.csv")
    with input_error(r"expected a folder of machines, found a file"):
        members(tmp_path / "recording.csv", tmp_path)


def test_a_name_that_no_file_can_hold_is_spelt_out(tmp_path: Path) -> None:
    (tmp_path / "arm\udcff").mkdir()
    (member,) = members(tmp_path, tmp_path / "results")
    assert member.name == "arm\\udcff"
    assert member.key(tmp_path, "")


CHANGES: list[Callable[[Path], object]] = [
    lambda folder: (folder / "m/1.csv").write_text("other"),
    lambda folder: (folder / "m/1.csv").rename(folder / "m/2.csv"),
    lambda folder: (folder / "m/machine.yaml").write_text(
        "mechanism: {type: urdf, file: 'arm.urdf'} # other"
    ),
    lambda folder: (folder / "m/arm.urdf").write_text("other"),
    lambda folder: put(folder, "m/0.csv"),
]


@pytest.mark.parametrize("change", CHANGES)
def test_a_key_follows_every_file(change: Callable[[Path], object], tmp_path: Path) -> None:
    put(tmp_path, "m/1.csv", "m/arm.urdf", "m/readme.md")
    (tmp_path / "m/machine.yaml").write_text("mechanism: {type: urdf, file: 'arm.urdf'}")

    def key(settings: str = "") -> str:
        (member,) = members(tmp_path, tmp_path / "results")
        return member.key(tmp_path, settings)

    before = key()
    put(tmp_path, "m/readme.md", "m/report.html")
    assert key() == before != key("other options")
    change(tmp_path)
    assert key() != before


def test_a_key_does_not_follow_the_place(tmp_path: Path) -> None:
    keys = []
    for place in ("here", "there"):
        put(tmp_path / place, "m/machine.yaml", "m/1.csv")
        (member,) = members(tmp_path / place, tmp_path)
        keys.append(member.key(tmp_path / place, ""))
    assert keys[0] == keys[1]
