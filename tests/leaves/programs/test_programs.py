"""A corrected program, read by a parser of this file's own and run by a nominal controller in numpy, brings the real arm
where the program meant; what is no number of a target stays as it was, byte for byte."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import Result

from support.command import invoke, run
from support.program_robots import (
    arms,
    difference,
    frame,
    joints,
    machine_file,
    numbers_of,
    quadrants,
    status_turn,
)
from truepose.arrays import Array
from truepose.identification.leaves.programs.correct import edited

DRAWN, REAL = arms()
NUMBER = r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?"


def corrected(where: Path, file: str, text: str, *options: str) -> tuple[str, Result]:
    """A program's text after ``truepose compensate``, and what the command said as data."""
    machine = machine_file(where, REAL)
    (where / file).write_bytes(text.encode("latin-1"))
    out = where / f"out{Path(file).suffix}"
    done = invoke("compensate", machine, where / file, "-o", out, "--json", "--anyway", *options)
    return (out.read_bytes().decode("latin-1") if out.exists() else ""), done


@dataclass(frozen=True)
class Written:
    """A way of writing: text of a target of joints, pattern of its numbers, and what they mean: pose (4, 4), configuration."""

    file: str
    line: Callable[[int, Array], str]
    target: str
    pose: Callable[[list[float]], Array]
    configuration: Callable[[list[float]], tuple[int, ...] | None]
    of_joints: Callable[[Array], tuple[int, ...] | None]


def pose_of(xyz: list[float], turn: Rotation) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn.as_matrix(), xyz
    return out


def krl(k: int, q: Array) -> str:
    pose = DRAWN.pose(q)
    a, b, c = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX", degrees=True)
    x, y, z = pose[:3, 3]
    s, t = status_turn(DRAWN, q)
    style = ("LIN {{{}}} C_DIS ; weld {}", "PTP {{E6POS: {}}}", "  SLIN {{{}}}\t;{}", "E6POS XP{1}={{{0}}}")[
        k % 4
    ]
    e = ",E1 0.0,E2 0.0" if k % 4 else ""
    return style.format(f"X {x:.9f},Y {y:.9f}, Z {z:.9f},A {a:.9f},B {b:.9f},C {c:.9f},S {s},T {t}{e}", k)


def rapid(k: int, q: Array) -> str:
    pose = DRAWN.pose(q)
    x, y, z = pose[:3, 3]
    i, j, k3, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
    cf = ",".join(str(n) for n in quadrants(DRAWN, q))
    literal = f"[[{x:.9f},{y:.9f}, {z:.9f}],[{w:.12f},{i:.12f},{j:.12f},{k3:.12f}],[{cf}],[9E9,9E9,9E9,9E9,9E+09,9E9]]"
    style = ("CONST robtarget p{1}:={0};", "  MoveL {0},v100,z10,tool\\WObj:=wobj0; ! point {1}")[k % 2]
    return style.format(literal, k)


def script(k: int, q: Array) -> str:
    pose = DRAWN.pose(q)
    numbers = [*pose[:3, 3] / 1000, *Rotation.from_matrix(pose[:3, :3]).as_rotvec()]
    told = ", ".join(f"{n:.12f}" for n in numbers)
    near = ", ".join(f"{v:.9f}" for v in q)
    if k % 2:
        return f"  p{k} = p[{told}]\n  movej([{near}])\n  movep(p{k})"
    return f"  movej([{near}])\n  movel(p[{told}], a=1.2, v=0.25) # {k}"


WRITTEN = {
    "kuka": Written(
        "job.src", krl,
        r"X @,Y @, Z @,A @,B @,C @,S @,T @".replace("@", f"({NUMBER})"),
        lambda n: pose_of(n[:3], Rotation.from_euler("ZYX", n[3:6], degrees=True)),
        lambda n: (int(n[6]), int(n[7])), lambda q: status_turn(DRAWN, q),
    ),
    "rapid": Written(
        "job.mod", rapid,
        r"\[\[@,@, @\],\[@,@,@,@\],\[@,@,@,@\],".replace("@", f"({NUMBER})"),
        lambda n: pose_of(n[:3], Rotation.from_quat([n[4], n[5], n[6], n[3]])),
        lambda n: tuple(int(v) for v in n[7:]), lambda q: quadrants(DRAWN, q),
    ),
    "urscript": Written(
        "job.script", script, r"\bp\[" + ", ".join([f"({NUMBER})"] * 6) + r"\]",
        lambda n: pose_of([1000 * v for v in n[:3]], Rotation.from_rotvec(n[3:])), lambda n: None, lambda q: None,
    ),
}  # fmt: skip
HEADS = {
    "kuka": ("&ACCESS RVP\r\nDEF job( ) ; {X 1,Y 2}\r\n", "\r\nEND\r\n"),
    "rapid": ("MODULE job\r\n! [[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]\r\n", "\r\nENDMODULE"),
    "urscript": ("def job():\r\n  # p[1, 2, 3, 4, 5, 6]\r\n", "\r\nend\r\n"),
}


def program(dialect: str, count: int, more: str = "") -> str:
    """Return a program with a target for each of some joints."""
    (before, after), line = HEADS[dialect], WRITTEN[dialect].line
    return before + "\r\n".join(line(k, row) for k, row in enumerate(joints(count))) + more + after


def targets(how: Written, text: str) -> list[list[float]]:
    """Numbers of the targets of a text, but those in comments."""
    bare = re.sub(r"(?m)^\s*[;!#].*$|; \{X.*$", "", text)
    return [[float(v) for v in m.groups()] for m in re.finditer(how.target, bare)]


@pytest.mark.parametrize("dialect", WRITTEN)
def test_the_real_tool_goes_where_the_program_meant(tmp_path: Path, dialect: str) -> None:
    how, q = WRITTEN[dialect], joints(16)
    text = program(dialect, 16)
    out, done = corrected(tmp_path, how.file, text)
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    old, new = targets(how, text), targets(how, out)
    assert len(old) == len(new) == len(q)
    assert said["left"] == [] and said["targets"] == len(q) * (2 if dialect == "urscript" else 1)
    largest = 0.0
    for row, was, now in zip(q, old, new, strict=True):
        commanded = DRAWN.inverse(how.pose(now), row)  # the controller's own inverse kinematics
        assert how.of_joints(commanded) == how.configuration(now)
        missed = difference(REAL.pose(commanded), how.pose(was))
        assert np.max(np.abs(missed[:3])) < 1e-6 and np.max(np.abs(missed[3:])) < 1e-9
        largest = max(largest, float(np.linalg.norm(difference(REAL.pose(row), how.pose(was))[:3])))
    assert largest > 1.0  # mm: without the correction
    assert said["largest_error"]["before"]["position"]["value"] == pytest.approx(largest, rel=1e-6)
    assert said["largest_error"]["after"]["position"]["value"] < 1e-6


@pytest.mark.parametrize("dialect", WRITTEN)
def test_nothing_else_changes(tmp_path: Path, dialect: str) -> None:
    how = WRITTEN[dialect]
    text = program(dialect, 8, "\n\t; ! # \xe9\xff")
    out, _ = corrected(tmp_path, how.file, text)
    number = re.compile(r"(?<![\w.])[-+]?\d+\.\d{9,}")
    assert out != text
    assert number.sub("#", out) == number.sub("#", text)


@pytest.mark.parametrize("dialect", WRITTEN)
def test_an_arm_as_drawn_leaves_its_program_as_it_is(tmp_path: Path, dialect: str) -> None:
    how = WRITTEN[dialect]
    text = program(dialect, 8)
    (tmp_path / how.file).write_text(text, newline="")
    machine = machine_file(tmp_path, DRAWN)
    run("compensate", machine, tmp_path / how.file, "-o", tmp_path / "out", "--anyway")
    assert (tmp_path / "out").read_bytes() == text.encode()


KRL_JOINTS = "PTP {{A1 {:.10f},A2 {:.10f},A3 {:.10f},A4 {:.10f},A5 {:.10f},A6 {:.10f}}}"
RAPID_JOINTS = (
    "CONST jointtarget j:=[[{:.10f},{:.10f},{:.10f},{:.10f},{:.10f},{:.10f}],[9E9,9E9,9E9,9E9,9E9,9E9]];"
)
SCRIPT_JOINTS = "movej([{:.12f}, {:.12f}, {:.12f}, {:.12f}, {:.12f}, {:.12f}], a=1)"
CSV_JOINTS = "0;{:.10f};{:.10f};{:.10f};{:.10f};{:.10f};{:.10f};a, b"
JOINTS = {
    "job.src": (KRL_JOINTS, rf"A\d ({NUMBER})", 1.0),
    "job.mod": (RAPID_JOINTS, r"[\[,](-?\d+\.\d+)(?=[,\]])", 1.0),
    "job.script": (SCRIPT_JOINTS, rf"[\[ ]({NUMBER})(?=[,\]])", np.pi / 180),
    "job.csv": (CSV_JOINTS, rf";({NUMBER})(?=;)", 1.0),
}
"""Text of a line, pattern of its numbers, their unit in deg."""


@pytest.mark.parametrize("file", JOINTS)
def test_joint_targets_put_the_flange_where_nominal_links_would(tmp_path: Path, file: str) -> None:
    q = joints(6)
    line, pattern, unit = JOINTS[file]
    head = "id;q1;q2;q3;q4;q5;q6;note\n" if file.endswith("csv") else ""
    text = head + "\n".join(line.format(*(np.degrees(row) * unit)) for row in q)
    out, done = corrected(tmp_path, file, text, *(["--dialect", "csv"] if head else []))
    assert done.exit_code == 0, done.output
    found = np.radians(np.array([float(v) for v in re.findall(pattern, out)]) / unit).reshape(-1, 6)
    for row, command in zip(q, found, strict=True):
        assert np.max(np.abs(difference(REAL.pose(command), DRAWN.pose(row))[:3])) < 1e-6


def test_a_table_of_poses_is_corrected_cell_by_cell(tmp_path: Path) -> None:
    """A table tells no configuration: the arm takes the one next to home, and then next to the row before."""
    q = np.array([0.2, 0.3, -0.2, 0.3, 0.6, -0.4]) + np.outer(
        np.linspace(0.0, 0.5, 6), [1, -1, 1, 0.5, 0.5, 2]
    )
    poses = [DRAWN.pose(row) for row in q]
    rows = [
        ",".join(f"{v:.9f}" for v in [*p[:3, 3] * 1000, *Rotation.from_matrix(p[:3, :3]).as_rotvec()])
        + ', "seam", 7'
        for p in poses
    ]
    text = "# made by hand\r\nx [um],y [um],z [um],rx [rad],ry [rad],rz [rad],what,n\r\n" + "\r\n".join(rows)
    out, done = corrected(tmp_path, "points.csv", text, "--dialect", "csv")
    assert done.exit_code == 0, done.output
    assert re.sub(r"-?\d+\.\d+", "#", out) == re.sub(r"-?\d+\.\d+", "#", text)
    for row, goal, line in zip(q, poses, out.splitlines()[2:], strict=True):
        numbers = [float(v) for v in line.split(",")[:6]]
        told = pose_of([v / 1000 for v in numbers[:3]], Rotation.from_rotvec(numbers[3:]))
        missed = difference(REAL.pose(DRAWN.inverse(told, row)), goal)
        assert np.max(np.abs(missed[:3])) < 1e-6
        assert np.max(np.abs(difference(told, goal))) > 0.1


WOBJ = frame((400.0, -120.0, 35.0, 10.0, -20.0, 75.0))
GUN = frame((30.0, 0.0, 150.0, 0.0, 80.0, 15.0))


FRAMED = {
    "kuka": ("$BASE=BASE_DATA[3]\n$TOOL=TOOL_DATA[2]\nLIN {inside}\n", r"LIN \{(.*)\}", ("BASE_DATA[3]", "TOOL_DATA[2]")),
    "rapid": (
        "CONST robtarget p1:={inside};\nMoveL p1,v100,fine,gun\\WObj:=fix;\n", r"p1:=(.*)", ("fix", "gun"),
    ),
    "urscript": (
        "movej({near})\nset_tcp(gun)\nmovel(pose_trans(fix, {inside}))\n",
        r"movel\(pose_trans\(fix, p(.*)\)\)", ("fix", "gun"),
    ),
}  # fmt: skip
"""A program with a target in frames that the user states, where its numbers are, and the names of the frames."""


def framed(dialect: str) -> tuple[str, list[str]]:
    """A program with a target in a work object and with a tool, and options with their numbers."""
    q = joints(1)[0]
    inside = numbers_of(np.linalg.inv(WOBJ) @ DRAWN.with_tool(GUN).pose(q), dialect)
    if dialect == "kuka":
        inside = "{}{}}}".format(inside[:-1], ",S {},T {}".format(*status_turn(DRAWN, q)))
    elif dialect == "rapid":
        inside = f"{inside[:-1]},{list(quadrants(DRAWN, q))},[9E9,9E9,9E9,9E9,9E9,9E9]]"
    text, _, names = FRAMED[dialect]
    options = []
    for name, pose in zip(names, (WOBJ, GUN), strict=True):
        options += ["--frame", f"{name}={re.sub(r'[A-Z] |[{}p ]|[][]', '', numbers_of(pose, dialect))}"]
    return text.replace("{inside}", inside).replace("{near}", str(q.tolist())), options


def read(dialect: str, text: str) -> list[float]:
    """Numbers of the target of a program in a work object."""
    found = re.search(FRAMED[dialect][1], text)
    assert found is not None
    return [float(v) for v in re.findall(rf"(?<![A-Za-z\d]){NUMBER}", found[1])]


@pytest.mark.parametrize("dialect", WRITTEN)
def test_targets_in_a_work_object_with_a_tool_that_the_user_states(tmp_path: Path, dialect: str) -> None:
    text, options = framed(dialect)
    out, done = corrected(tmp_path, WRITTEN[dialect].file, text, *options)
    assert done.exit_code == 0, done.output
    pose = WRITTEN[dialect].pose
    was, now = (WOBJ @ pose(read(dialect, t)) for t in (text, out))
    drawn, real = (arm.with_tool(GUN) for arm in (DRAWN, REAL))
    commanded = drawn.inverse(now, joints(1)[0])
    assert np.max(np.abs(difference(real.pose(commanded), was)[:3])) < 1e-6
    assert np.max(np.abs(difference(now, was)[:3])) > 0.1


@pytest.mark.parametrize("dialect", WRITTEN)
def test_a_work_object_without_numbers_is_asked_for(tmp_path: Path, dialect: str) -> None:
    text, options = framed(dialect)
    _, done = corrected(tmp_path, WRITTEN[dialect].file, text, *options[2:])
    if dialect == "urscript":  # the joint target is corrected all the same
        (left,) = json.loads(done.stdout)["left"]
        assert left["line"] == 3 and "told in fix, whose numbers are not known here: --frame" in left["why"]
        return
    assert done.exit_code == 2
    assert re.search(
        r"job\.\w+:\d+: .*told in (BASE_DATA\[3\]|fix), whose numbers are not known here", done.stderr, re.I
    )
    assert not list(tmp_path.glob("out*"))


@pytest.mark.parametrize("dialect", WRITTEN)
@pytest.mark.parametrize("fault", ["digit", "target"])
def test_a_program_that_reads_otherwise_is_not_published(
    fault: str, dialect: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    how = WRITTEN[dialect]
    last = how.line(3, joints(4)[3])

    def faulty(*given: Any) -> str:
        text = edited(*given)
        number = list(re.finditer(r"\d\.(\d{9,})", text))[7]
        changed = text[: number.start(1)] + str(9 - int(number[1][0])) + text[number.start(1) + 1 :]
        return changed if fault == "digit" else text.replace(last[:3], "; ", 1)

    monkeypatch.setattr("truepose.identification.leaves.programs.correct.edited", faulty)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    out, done = corrected(tmp_path, how.file, program(dialect, 4))
    assert out == "" and done.exit_code == 1
    said = r"(\d+:)? what was to be written (reads as another target|has )"
    assert re.search(rf"ReadBackError: \S*out{Path(how.file).suffix}:{said}", done.stderr)


def test_targets_outside_of_what_the_calibration_saw_are_named(tmp_path: Path) -> None:
    machine = machine_file(tmp_path, REAL)
    seen = "covariance: {names: [], factor: [], seen: {q1: [-0.5, 0.5], q4: [-3.0, 3.0]}}\n"
    machine.write_text(machine.read_text() + seen)
    targets = "".join(f"PTP {{A1 {a},A2 -20,A3 30,A4 10,A5 40,A6 0}}\n" for a in (10, 40, -60))
    (tmp_path / "job.src").write_text(f"DEF job()\n{targets}END\n")
    done = run("compensate", machine, tmp_path / "job.src", "-o", tmp_path / "out.src", "--anyway")
    said = "note: 2 of 3 targets lie outside of what the calibration saw, where effects are held or extrapolated: q1 down to -"
    assert said in done.stderr and "deg (seen -28.6479 to 28.6479 deg) in 2, first at line 3\n" in done.stderr
