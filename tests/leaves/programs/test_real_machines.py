"""Programs of machines with loads, play and loops: what the table's way of compensation says, a program's says, too."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from support.calibrated_machines import calibrated
from support.command import run
from support.program_robots import arms, difference, joints, machine_file, numbers_of, status_turn
from truepose.identification.compensation.compensate import ideal_constants
from truepose.identification.compensation.inverse import PoseSolver, base_frame

DRAWN, REAL = arms()
LOADED = """masses:
  arm: {kg: 6.0, com: [0, 0, 100], in: link3}
  payload: {kg: 0, com: [0, 12, 60], in: tool}
drivers: [payload, approach.q2]
effects:
  - {effect: joint-compliance, place: [q2], parameters: {c: {value: 2.0e-5, unit: rad/(N*m)}}}
"""


def compensated(*words: object) -> Any:
    return json.loads(run("compensate", *words, "--anyway", "--json").stdout)


def test_joint_targets_under_a_load_are_those_of_a_table_with_that_load(tmp_path: Path) -> None:
    """The same joints as a path with a column ``payload``, which other code solves."""
    machine = machine_file(tmp_path, REAL, LOADED)
    q = np.degrees(joints(5))
    (tmp_path / "job.script").write_text(
        "\n".join(f"movej([{', '.join(f'{v:.13f}' for v in np.radians(row))}])" for row in q)
    )
    rows = "\n".join(",".join(f"{v!r}" for v in row) + ",3.0" for row in q.tolist())
    (tmp_path / "path.csv").write_text("q1,q2,q3,q4,q5,q6,payload\n" + rows + "\n")
    compensated(machine, tmp_path / "path.csv", "-o", tmp_path / "table.csv")
    said = compensated(machine, tmp_path / "job.script", "-o", tmp_path / "o.script", "--at", "payload=3")
    table = np.loadtxt(tmp_path / "table.csv", delimiter=",", skiprows=1)[:, :6]
    found = np.array([float(v) for v in re.findall(r"-?\d+\.\d+", (tmp_path / "o.script").read_text())])
    np.testing.assert_allclose(np.degrees(found.reshape(-1, 6)), table, rtol=0, atol=1e-8)
    assert said["drivers"] == {"payload": 3.0}
    bare = compensated(machine, tmp_path / "job.script", "-o", tmp_path / "bare.script")
    assert bare["drivers"] == {"payload": 0.0}
    assert (tmp_path / "bare.script").read_text() != (tmp_path / "o.script").read_text()


def test_points_of_a_hexapod_are_corrected_in_their_table(tmp_path: Path) -> None:
    """Six legs close to the pose that a row means: judged by the machine's own forward kinematics, nominal and real."""
    machine = calibrated("hexapod", tmp_path)
    assert machine.file is not None
    solver = PoseSolver(machine)
    solver.p = ideal_constants(machine, solver.model)
    low, high = np.transpose([a.range or (-5.0, 5.0) for a in machine.mechanism.actuators])
    share = np.random.default_rng(2).uniform(0.3, 0.7, (4, 6))
    poses, good = solver.forward(low + share * (high - low))
    assert good.all()
    rows = []
    for pose in np.linalg.inv(base_frame(machine)) @ poses:
        turn = Rotation.from_matrix(pose[:3, :3])
        rows.append([*pose[:3, 3], *turn.as_rotvec(degrees=True)])
    (tmp_path / "points.csv").write_text(
        "x,y,z,rx,ry,rz\n" + "\n".join(",".join(f"{v:.9f}" for v in r) for r in rows)
    )
    files = (machine.file.path, tmp_path / "points.csv", "-o", tmp_path / "out.csv")
    said = compensated(*files, "--dialect", "csv")
    assert said["targets"] == 4 and said["left"] == []
    before, after = (said["largest_error"][w]["position"]["value"] for w in ("before", "after"))
    assert after < 1e-6 and before > 0.01


def test_a_dat_beside_its_src_takes_the_base_that_motions_go_by(tmp_path: Path) -> None:
    machine = machine_file(tmp_path, REAL)
    q, base = joints(1)[0], np.eye(4)
    base[:3, 3] = [250.0, -30.0, 12.5]
    inside = np.linalg.inv(base) @ DRAWN.pose(q)
    s, t = status_turn(DRAWN, q)
    literal = numbers_of(inside, "kuka")[:-1] + f",S {s},T {t}}}"
    (tmp_path / "Job.DAT").write_text(f"DEFDAT JOB\nDECL E6POS XP1={literal}\nENDDAT\n")
    (tmp_path / "Job.src").write_text(f"DEF JOB()\n$BASE={numbers_of(base, 'kuka')}\nLIN XP1\nEND\n")
    said = compensated(machine, tmp_path / "Job.DAT", "-o", tmp_path / "out.dat")
    assert said["targets"] == 1 and said["without_base"] == 0
    numbers = [float(v) for v in re.findall(r"[XYZABC] (-?[\d.]+)", (tmp_path / "out.dat").read_text())]
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("ZYX", numbers[3:], degrees=True).as_matrix()
    pose[:3, 3] = numbers[:3]
    missed = difference(REAL.pose(DRAWN.inverse(base @ pose, q)), DRAWN.pose(q))
    assert np.max(np.abs(missed[:3])) < 1e-6
