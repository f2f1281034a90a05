"""What is exported is read again: by others it is the same machine, and what would be another one is not published."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support import MACHINES, ROOT
from support.command import input_error
from support.effect_machines import TEXTS, read_machines
from support.examples import by_day
from support.exported import EXTRA, machine_named, mujoco_module, read_table, readings_of, tool_of
from support.generated_machines import BODIES
from support.machine_texts import machine_from
from truepose.arrays import Array
from truepose.errors import ReadBackError
from truepose.identification.compensation.inverse import PoseSolver, base_frame
from truepose.models.leaves.export.write import Format, LinkFormat, export, formats, render
from truepose.models.leaves.starting.mjcf import mjcf_start
from truepose.models.leaves.starting.start import bundled_names, bundled_start
from truepose.models.leaves.starting.written import files_of
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

FILES = [*sorted(MACHINES.glob("*.yaml")), *sorted((ROOT / "models" / "machines").glob("*/machine.yaml"))]
NAMES = [
    *BODIES,
    *EXTRA,
    "carriage",
    *(f"effects/{name}" for name in TEXTS),
    *(f"arms/{name}" for name in bundled_names()),
    *(str(file.relative_to(ROOT)) for file in FILES),
]
BY_DAY = {
    *BODIES,
    *EXTRA,
    "carriage",
    "arms/ur5e",
    "arms/gantry",
    "models/machines/nanopositioner/machine.yaml",
}
TABLES = ("iso230",)
TABLED = {
    "nano",
    "mounted",
    "carriage",
    "effects/stage",
    "effects/cavity",
    "arms/gantry",
    "tests/machines/distance.yaml",
    "models/machines/nanopositioner/machine.yaml",
}
"""Machines whose axes move along or turn about those of the base, one of each letter, in ranges."""
SUFFIXES = {"urdf": ".urdf", "mjcf": ".xml", "ur-kinematics": ".yaml", **dict.fromkeys(TABLES, ".csv")}
ROWS = 10
SAME_AGAIN = 1e-9
"""mm on arms of metres, of which a file that init writes has fourteen digits."""
SAME = {"iso230": 5e-9}
"""mm on arms of a metre: six decimals of um and urad. Others hold doubles."""


@pytest.fixture(scope="module")
def effect_machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.getbasetemp() / "exported")


def machine_called(name: str, folder: Path, others: Mapping[str, Machine]) -> Machine:
    if name in (*BODIES, *EXTRA, "carriage"):
        return drawn(folder, name)
    kind, _, own = name.partition("/")
    if kind == "effects":
        return others[own]
    if kind == "arms":
        return machine_from(folder, files_of(bundled_start(own))[0], own)
    return load_machine(ROOT / name)


def drawn(folder: Path, name: str) -> Machine:
    return machine_named(folder, name, CARRIAGE if name == "carriage" else None)


def rows_of(machine: Machine, file: Path, format: str) -> Array:
    """Return readings (n, nq) where a format holds the machine: a table at its positions."""
    if format in TABLES:
        rng, actuators = np.random.default_rng(4), machine.mechanism.actuators
        table = read_table(file.read_text())
        positions = [rng.choice(table.rows[axis][:, 0], ROWS) for axis in table.axes]
        return np.column_stack(
            [p if a.unit == "mm" else np.radians(p) for p, a in zip(positions, actuators, strict=True)]
        )
    return readings_of(machine, ROWS)


def is_held(name: str, machine: Machine, format: str) -> bool:
    """Return what docs/reference/export.md states of machines and formats."""
    if format in TABLES:
        return name in TABLED
    open_, actuators = not (machine.mechanism.rods or machine.mechanism.closing), machine.mechanism.actuators
    if format == "ur-kinematics":
        return open_ and [a.unit for a in actuators] == ["rad"] * 6
    return open_ and all(a.reading_unit == a.unit for a in actuators)


@pytest.mark.parametrize("name", by_day(NAMES, *BY_DAY))
@pytest.mark.parametrize("format", tuple(formats))
def test_a_machine_is_read_where_it_stands_or_refused(
    name: str, format: str, tmp_path: Path, effect_machines: Mapping[str, Machine]
) -> None:
    """Of effects, which formats hold in part, tests of each format tell."""
    machine = machine_called(name, tmp_path, effect_machines).with_effects(())
    file = tmp_path / f"out{SUFFIXES[format]}"
    if not is_held(name, machine, format):
        with input_error(r"found .*, expected "):
            export(machine, file, format)
        assert not file.exists()
        return
    done = export(machine, file, format)
    assert done.left_out == {}
    rows = rows_of(machine, file, format)
    poses, good = PoseSolver(machine).forward(rows)
    assert good.all() and len(good) == ROWS
    tool = tool_of(machine, file, format)
    base = np.eye(4) if format == "mjcf" else base_frame(machine)
    for q, pose in zip(rows, poses, strict=True):
        apart = np.abs(base @ tool(q) - pose)
        assert np.max(apart[:3, 3]) <= SAME.get(format, 1e-9)
        assert np.max(apart[:3, :3]) <= 1e-11


@pytest.mark.parametrize("name", by_day(NAMES, *BY_DAY))
def test_an_exported_mjcf_starts_the_same_machine(
    name: str, tmp_path: Path, effect_machines: Mapping[str, Machine]
) -> None:
    """The same joints in the same ranges, the same masses, and the same pose of the tool in the base."""
    mujoco_module()
    machine = machine_called(name, tmp_path, effect_machines).with_effects(())
    if not is_held(name, machine, "mjcf"):
        return
    done = export(machine, tmp_path / "out.xml", "mjcf")
    rows = rows_of(machine, tmp_path / "out.xml", "mjcf")
    (tool,) = re.findall(r'<site name="(.*)" />', done.text)
    start = mjcf_start(tmp_path / "out.xml", tool)
    text = files_of(start)[0]
    again = machine_from(tmp_path, text, "again")
    # a branch beside the way to the tool
    own, other = (
        {a.reading: a for a in m.mechanism.actuators if a.reading != "look"} for m in (machine, again)
    )
    assert own.keys() == other.keys()
    for reading, actuator in own.items():
        assert (other[reading].range is None) == (actuator.range is None)
        np.testing.assert_allclose(other[reading].range or 0.0, actuator.range or 0.0, rtol=1e-9)
    kg = sum(mass.kg for mass in machine.masses)
    assert sum(mass.kg for mass in again.masses) == pytest.approx(kg, rel=1e-9)
    order = [machine.mechanism.readings.index(name) for name in again.mechanism.readings]
    expected, good = PoseSolver(machine).forward(rows)
    poses, closed = PoseSolver(again).forward(rows[:, order])
    assert good.all() and closed.all()
    apart = np.abs(base_frame(machine) @ poses - expected)
    assert np.max(apart[:, :3, 3]) <= SAME_AGAIN
    assert np.max(apart[:, :3, :3]) <= SAME_AGAIN / 1000.0


CARRIAGE = """  type: graph
  bodies: [base, bridge, head, camera]
  flange: head
  joints:
    - {name: pan, kind: prismatic, parent: base, child: bridge, xyz: [1, 2, 300], axis: [0.0003, 1, 0],
       actuated: true, range: [50, 450.123456789]}
    - {name: lift, kind: revolute, parent: bridge, child: head, xyz: [10, 0, 80], axis: [0, 0.001, -1],
       actuated: true, range: [-90, 120]}
    - {name: look, kind: revolute, parent: bridge, child: camera, xyz: [0, 9, 0], mimic: {joint: pan, ratio: 0.2}}
frames: {base: {in: world, xyz: [4, 5, 6], rpy: [1, 2, 3]}, tool: {in: flange, xyz: [80, 0, -150], rpy: [0, 10, 0]}}
"""
CHANGED = [
    ("urdf", "carriage", [
        r'(joint name="pan".*\n +<origin xyz="0.001 0.002 0.3)', r'(joint name="base_joint".*\n +<origin xyz="0.004)',
        r'(lower="0.05)', r'(upper="2.094)', r'(multiplier="3.4)',
    ]),
    ("mjcf", "carriage", [
        r'("bridge" pos="0.001)', r'("base" pos="\S+ \S+ \S+ quat="0.99)', r'("slide" axis="0.0003?)', r'(range="0.05)',
        r'("tool" pos="0.08)', r'(polycoef="0 3.4)',
    ]),
    ("ur-kinematics", "arm", [
        r"(forearm:\n +x: -0.6)", r"(wrist_2:(?:\n.*){3}\n +roll: 1.5)", r"(to tool: x 0.01)", r"(to tool: .* yaw 0.3)",
    ]),
    ("iso230", "carriage", [
        r"(Y,pan,50,mm,-60.0185)", r"(C,lift,-90,deg,(?:[-.0-9]+,){5}-?\d+\.)", r"(reference: pan 250.06)",
        r"(\[R\|p\], mm: 0.98)", r"(a line through 11.0)",
    ]),
]  # fmt: skip
UNREADABLE = [
    ("urdf", "carriage", '<parent link="bridge" />', '<parent link="case" />'),
    ("mjcf", "carriage", 'joint name="pan"', 'joint name="pen"'),
    ("ur-kinematics", "arm", "  forearm:", "  lower_arm:"),
    ("iso230", "carriage", "EX [um],EY [um]", "EY [um],EX [um]"),
    ("iso230", "carriage", "Y (pan)", "Y (pen)"),
]


@pytest.mark.parametrize(("format", "name", "places"), CHANGED)
def test_a_digit_too_many_makes_another_machine_which_is_not_published(
    format: str, name: str, places: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = drawn(tmp_path, name)
    said = "reads as another machine: (the frame|the range|the positions|with axis) "
    text = render(machine, format).text
    for place in places:
        check_refused(machine, format, re.sub(place, r"\g<1>7", text, count=1), said, tmp_path, monkeypatch)


@pytest.mark.parametrize(("format", "name", "was", "becomes"), UNREADABLE)
def test_what_cannot_be_read_is_not_published(
    format: str, name: str, was: str, becomes: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = drawn(tmp_path, name)
    faulty = render(machine, format).text.replace(was, becomes, 1)
    check_refused(machine, format, faulty, r"cannot be read: .*\w{3}", tmp_path, monkeypatch)


def check_refused(
    machine: Machine, format: str, faulty: str, said: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Export by a writer that gives a ``faulty`` text: it is refused in one line, and the older file stays."""
    assert faulty != render(machine, format).text
    written_by: type[Format] = formats.get(format, "format")
    with monkeypatch.context() as patch:
        if issubclass(written_by, LinkFormat):
            patch.setattr(written_by, "text", lambda *_: faulty)
        else:
            done = replace(render(machine, format), text=faulty)
            patch.setattr(written_by, "render", lambda *_: done)
        (folder / "out.txt").write_text("older")
        before = sorted(folder.iterdir())
        with pytest.raises(ReadBackError, match=rf"^\S*out.txt: what was to be written {said}") as told:
            export(machine, folder / "out.txt", format)
    assert "\n" not in str(told.value)
    assert sorted(folder.iterdir()) == before and (folder / "out.txt").read_text() == "older"
