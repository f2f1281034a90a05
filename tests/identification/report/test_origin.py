"""Where a report says that it comes from: files with their digests, the day of the recording, instruments, the command."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from support.reports import of, recorded, rows
from truepose.identification.report.closing import origin_section
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.shown.document import Section, Table
from truepose.version import VERSION

TWO = ("/far/off/a.csv", "day 2/b c.csv")


def told(section: Section) -> list[list[str]]:
    return rows(of(section.blocks, Table)[0])


def origin(machine: Machine, options: tuple[str, ...] = (), **more: Any) -> list[list[str]]:
    return told(origin_section(machine, replace(recorded(machine), **more), "calibrate", options))


def test_files_stand_with_their_digests_and_the_command_that_does_the_same(machine: Machine) -> None:
    assert machine.file is not None
    files = {"files": TWO, "digests": ("12ab", ""), "dates": ("2026-03-14", "")}
    assert origin(machine, ("--solver lm",), **files) == [
        ["truepose", VERSION],
        ["command, or what does the same", "truepose calibrate arm.yaml a.csv b\\ c.csv --solver lm"],
        ["machine file", f"arm.yaml, SHA-256 {machine.file.digest}"],
        ["recording", "a.csv, SHA-256 12ab"],
        ["recording", "b c.csv, SHA-256 not a file"],
        ["recorded on", "2026-03-14"],
        ["instrument", "position (3 columns), stated 1 sigma: position 10.0 µm each"],
    ]
    assert machine.file.digest


@pytest.mark.parametrize(
    ("dates", "said"),
    [
        ((), "not stated in the recording"), (("", ""), "not stated in the recording"),
        (("2026-03-14", "2026-03-14"), "2026-03-14"), (("2026-03-15", "2026-03-14"), "2026-03-15, 2026-03-14"),
    ],
)  # fmt: skip
def test_each_day_is_told_once(machine: Machine, dates: tuple[str, ...], said: str) -> None:
    found = {row[0]: row[1] for row in origin(machine, files=TWO, dates=dates)}
    assert found["recorded on"] == said


def test_a_machine_and_a_table_in_memory_are_no_files(machine: Machine) -> None:
    found = origin(replace(machine, file=None))
    assert found[1][1] == "truepose calibrate MACHINE a&b.csv"
    assert found[2] == ["machine file", "arm, SHA-256 not a file"]
    assert found[3] == ["recording", "a&b.csv, SHA-256 not a file"]


def test_every_sensor_is_told_with_what_it_states(tmp_path: Any, machine: Machine) -> None:
    path = tmp_path / "two.yaml"
    assert machine.file is not None
    text = machine.file.path.read_text(encoding="utf-8")
    one = "sensor: {type: position, sigma: {xyz: 0.01}}"
    assert one in text
    path.write_text(text.replace(one, "sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.001}}"))
    posed = load_machine(path)
    assert origin(posed)[-1] == [
        "instrument",
        "pose (6 columns), stated 1 sigma: position 10.0 µm, rotation 17.5 µrad each",
    ]
    assert origin(replace(posed, sensors=()))[-1] == ["instrument", "none"]
    both = replace(posed, sensors=(*posed.sensors, *machine.sensors))
    assert (
        origin(both)[-1][1].count(" columns), stated 1 sigma: ") == 2
        and "each; position (3" in origin(both)[-1][1]
    )
