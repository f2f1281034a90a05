"""What a corrected program says: decimals, configurations, tools, large corrections, and what is refused, in the command."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from scipy.spatial.transform import Rotation
from typer.testing import Result

from support.command import invoke, refused
from support.program_robots import RAPID_MODULE, arms, joints, machine_file, quadrants, status_turn
from truepose.arrays import Array

DRAWN, REAL = arms()
Q = joints(1)[0]
POSITION = DRAWN.pose(Q)[:3, 3]


def run(
    where: Path, text: str, file: str = "job.src", *options: str, real: bool = True
) -> tuple[Result, str]:
    machine = machine_file(where, REAL if real else DRAWN)
    (where / file).write_text(text, newline="")
    out = where / f"out{Path(file).suffix}"
    done = invoke("compensate", machine, where / file, "-o", out, "--anyway", *options)
    return done, out.read_text() if out.exists() else ""


def told(where: Path, text: str, *options: str, file: str = "job.src") -> tuple[dict[str, Any], str]:
    """What is said of a corrected program as data, and the program."""
    done, out = run(where, text, file, *options, "--json")
    return json.loads(done.stdout), out


def krl(q: Array) -> str:
    pose = DRAWN.pose(q)
    x, y, z = pose[:3, 3]
    a, b, c = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX", degrees=True)
    s, t = status_turn(DRAWN, q)
    return f"PTP {{X {x:.3f},Y {y:.3f},Z {z:.3f},A {a:.3f},B {b:.3f},C {c:.3f},S {s},T {t}}}\n"


def test_numbers_get_the_decimals_that_a_correction_needs_and_no_fewer_than_they_had(tmp_path: Path) -> None:
    done, out = run(tmp_path, krl(Q))
    assert done.exit_code == 0
    decimals = [len(text) for text in re.findall(r"\.(\d+)", out)]
    assert decimals[:3] and all(3 <= d <= 4 for d in decimals[:3]) and all(3 <= d <= 6 for d in decimals[3:])


def test_an_axis_that_passes_zero_takes_its_turn_bit_with_it(tmp_path: Path) -> None:
    """Axis 6 stands a hair above zero; the real arm's zero of it is off, so that its command is below."""
    q = Q.copy()
    q[5] = 1e-4
    said, out = told(tmp_path, krl(q))
    moved = re.search(r"T (\d+)", out)
    assert moved is not None
    bit = int(moved[1]) >> 5 & 1
    assert said["reconfigured"] == ([1] if bit else [])
    other = Q.copy()
    other[5] = -1e-4
    _, mirrored = run(tmp_path, krl(other), "job.src")
    assert re.search(r"T (\d+)", mirrored)[1] == moved[1]  # type: ignore[index]  # the same command, the same bit


def test_a_configuration_that_no_joints_have_is_left_and_said(tmp_path: Path) -> None:
    text = krl(Q)
    t = int(re.search(r"T (\d+)", text)[1])  # type: ignore[index]
    wrong = re.sub(r"T \d+", f"T {t ^ 2 ^ 4}", text)
    said, out = told(tmp_path, text + wrong)
    assert [one["line"] for one in said["left"]] == [2] and "configuration" in said["left"][0]["why"]
    assert out.splitlines()[1] + "\n" == wrong and said["targets"] == 1


def test_motions_that_do_not_look_at_a_configuration_need_none(tmp_path: Path) -> None:
    """LIN keeps the status that the robot has, whatever a generated program writes; so does MoveL behind ConfL\\Off."""
    taught = krl(Q)
    line = re.sub(r"S \d+,T \d+", "S 0,T 0", taught.replace("PTP", "LIN"))
    for text, count in ((taught + line, 2), (taught + line.replace("LIN", "PTP"), 1)):
        said, out = told(tmp_path, text)
        assert said["targets"] == count
    assert "S 0,T 0" in out
    x, y, z, w = Rotation.from_matrix(DRAWN.pose(Q)[:3, :3]).as_quat().tolist()
    pose = f"[{POSITION.tolist()},{[w, x, y, z]}"
    first, other = (
        f"{pose},{cf},[9E9,9E9,9E9,9E9,9E9,9E9]]" for cf in (list(quadrants(DRAWN, Q)), [3, 3, 3, 0])
    )
    moves = f"MoveL {first},v100,fine,tool0x;\nMoveL {other},v100,fine,tool0x;\n"
    for head, count in (("ConfL\\Off;\n", 2), ("", 1)):
        assert told(tmp_path, head + moves, file="job.mod")[0]["targets"] == count


def test_a_tool_without_numbers_is_the_machine_file_s_unless_the_user_says_another(tmp_path: Path) -> None:
    text = "$TOOL=TOOL_DATA[7]\n" + krl(Q)
    said, out = told(tmp_path, text)
    other, moved = told(tmp_path, text, "--tool", "12,-7,94,20,-5,3")
    assert (said["assumed_tools"], other["assumed_tools"]) == (["TOOL_DATA[7]"], []) and moved != out
    two = text + "$TOOL=TOOL_DATA[8]\n" + krl(Q)
    done, _ = run(tmp_path, two, "job.src")
    assert (
        done.exit_code == 2 and "for the tool TOOL_DATA[7], whose numbers are not known here" in done.stderr
    )


def test_large_corrections_are_pointed_out(tmp_path: Path) -> None:
    (one,) = told(tmp_path, krl(Q), "--limit", "0.001")[0]["beyond_limit"]
    assert one["line"] == 1 and one["position"]["value"] > 0.1
    spoken, _ = run(tmp_path, krl(Q), "job.src", "--limit", "0.001")
    assert re.search(r"note: corrections of more than 0.001 mm or 1 deg: line 1 \(PTP, ", spoken.stderr)


@pytest.mark.parametrize(
    ("file", "text", "options", "message"),
    [
        ("job.src", "DEF job()\nEND\n", (), r"job.src: found no target in the program"),
        ("job.src", "LIN {X 9000,Y 0,Z 0,A 0,B 0,C 0}\n", (), r"job.src:1: LIN: no target can be .*cannot take this pose"),
        ("job.src", krl(Q), ("--base", "1,2,3"), r"--base: found '1,2,3', expected 6 numbers x,y,z,a,b,c in mm and deg"),
        ("job.mod", RAPID_MODULE, ("--tool", "0,0,0,0,0,0,0"), r"--tool: found .*expected a quaternion of length 1"),
        ("job.mod", RAPID_MODULE, ("--frame", "nofix=0,0,0,1,0,0,0"), r"--frame: found the name 'nofix', .*: cell, fix, gun"),
        ("job.src", krl(Q), ("--frame", "x"), r"--frame: found 'x', expected NAME=VALUE"),
        ("job.src", krl(Q), ("--at", "payload=3"), r"--at: found the driver 'payload', expected one that effects have"),
        ("job.src", krl(Q), ("--method", "first-order"), r"--method: found 'first-order' with a robot program, expected exact"),
        ("job.src", "\ufeff".encode("utf-16").decode("latin-1"), (), r"found UTF-16 or binary data"),
        ("job.csv", "q1,q2,q3,q4,q5,q6\n0,0,0,0,30,0\n", ("--base", "0,0,0,0,0,0"), r"--base: found it with a table, expected"),
        ("job.txt", krl(Q), ("--dialect", "basic"), r"--dialect: found 'basic', expected kuka, rapid, urscript, csv"),
        ("job.csv", "a,b\n1,2\n", ("--dialect", "csv"), r"job.csv: table: missing column 'x'"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_refused_in_one_line(
    tmp_path: Path, file: str, text: str, options: tuple[str, ...], message: str
) -> None:
    machine = machine_file(tmp_path, REAL)
    (tmp_path / file).write_bytes(text.encode("latin-1"))
    out = tmp_path / f"out{Path(file).suffix}"
    assert re.search(
        message, refused("compensate", machine, tmp_path / file, "-o", out, "--anyway", *options)
    )
    assert not out.exists()


def test_a_dat_that_is_a_table_stays_a_table(tmp_path: Path) -> None:
    done, out = run(tmp_path, "q1,q2,q3,q4,q5,q6\n0,0,0,0,30,0\n", "job.dat")
    assert done.exit_code == 0 and out.startswith("q1,q2,q3,q4,q5,q6\n")
