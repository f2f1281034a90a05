"""An arm, its calibrated machine file, and a nominal controller: plain numpy, so that programs are judged by other code.

Joints are revolute, in the modified Denavit-Hartenberg convention of the machine file; mm and rad.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from support import plain_kinematics
from truepose.arrays import Array

KEYS = ("beta", "alpha", "d", "theta", "r")
# like an IRB 120: lower arm upright and wrist in front at zero
DRAWN = np.array(
    [
        [0, 0, 0, 0, 290],
        [0, -90, 0, -90, 0],
        [0, 0, 270, 0, 0],
        [0, -90, 70, 0, 302],
        [0, 90, 0, 0, 0],
        [0, -90, 0, 180, 72],
    ],
    dtype=float,
)
RANGES = np.array([(-165, 165), (-110, 110), (-110, 70), (-160, 160), (-120, 120), (-400, 400)], dtype=float)
TOOL = (12.0, -7.0, 93.0, 3.0, -5.0, 20.0)
SCALE = 8e-4
"""Of the reading of axis 4 of the real arm."""
RAPID_MODULE = """MODULE weld
  ! CONST robtarget no:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  TASK PERS wobjdata fix:=[FALSE,TRUE,"a; b",[[100,0,0],[1,0,0,0]],[[0,50,0],[0.70710678,0,0,0.70710678]]];
  PERS wobjdata held:=[TRUE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  PERS wobjdata turning:=[FALSE,FALSE,"STN1",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  LOCAL CONST robtarget p10 := [ [ 400 , 1.5 , 2E2 ],
      [ 1 , 0 , 0 , 0 ],
      [ 0 , 0 , 0 , 0 ] , [ 9E+09 , 9E9 , 9E9 , 9E9 , 9E9 , 9E9 ] ];
  CONST robtarget many{2}:=[[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],
    [[4,5,6],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]];
  CONST robtarget track:=[[1,2,3],[1,0,0,0],[0,0,0,0],[1500,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget named:=[[x0,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget twice:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget part:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget spun:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget odd:=[[1,2,3],[0.5,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget arc:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget sets:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST jointtarget home:=[[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    TPWrite "MoveL p10";
    MoveAbsJ home\\NoEOffs,v500,fine,tool0;
    MoveL p10,v100\\V:=50,z10,gun\\WObj:=fix;
    MoveC many{1},many{2},v100,fine,gun;
    ArcL\\On,arc,v100,seam1,weld1\\Weave:=w,fine,gun\\WObj:=fix;
    MoveLDO sets,v100,z10,gun,do1,1;
    MoveL Offs(p10,0,0,50),v100,z10,gun\\WObj:=fix;
    MoveL twice,v100,z10,gun\\WObj:=fix;
    MoveL twice,v100,z10,gun;
    MoveL part,v100,z10,gun\\WObj:=held;
    MoveL spun,v100,z10,gun\\WObj:=turning;
    MoveL [[7,8,9],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,z10,gun\\WObj:=cell;
    p10.trans.z := 5;
  ENDPROC
ENDMODULE
"""


def frame(xyz_rpy: tuple[float, ...]) -> Array:
    """(4, 4) of x y z in mm and roll pitch yaw in deg."""
    return plain_kinematics.frame(xyz_rpy[:3], np.radians(xyz_rpy[3:]))


@dataclass(frozen=True)
class Arm:
    """Six joints (6, 5) in rad and mm and a tool (4, 4); ``scale`` is what axis 4 reads too little."""

    rows: Array
    tool: Array
    scale: float = 0.0

    def frames(self, q: Array) -> list[Array]:
        """Frames of the joints, then the tool's, (4, 4) in the base."""
        out = [np.eye(4)]
        for k, row in enumerate(self.rows):
            out.append(out[-1] @ plain_kinematics.step(row, q[k] * (1 + self.scale * (k == 3))))
        return [*out[1:], out[-1] @ self.tool]

    def pose(self, q: Array) -> Array:
        return self.frames(q)[-1]

    def with_tool(self, tool: Array) -> Arm:
        return Arm(self.rows, tool, self.scale)

    def inverse(self, pose: Array, start: Array) -> Array:
        """Joints (6,) next to ``start`` at a pose, by Newton's method with differences."""
        q = start.copy()
        for _ in range(30):
            gap = difference(self.pose(q), pose)
            if np.max(np.abs(gap) / [500, 500, 500, 1, 1, 1]) < 1e-14:
                break
            slope = np.array([(difference(self.pose(q + e), pose) - gap) / 1e-7 for e in 1e-7 * np.eye(6)]).T
            q = q - np.linalg.solve(slope, gap)
        return q


def difference(pose: Array, goal: Array) -> Array:
    """(6,) mm and rad from a goal to a pose."""
    turn = Rotation.from_matrix(pose[:3, :3] @ goal[:3, :3].T).as_rotvec()
    return np.concatenate([pose[:3, 3] - goal[:3, 3], turn])


def rows_of(drawn: Array) -> Array:
    """Degrees to rad."""
    return drawn * np.where(np.isin(np.arange(5), (0, 1, 3)), np.pi / 180, 1.0)


def arms(seed: int = 5, size: float = 1.0) -> tuple[Arm, Arm]:
    """The drawing, and a real arm that differs by tenths of a mm and of a degree."""
    rng = np.random.default_rng(seed)
    wrong = DRAWN + size * rng.normal(0.0, [0.05, 0.1, 0.3, 0.1, 0.3], DRAWN.shape)
    return Arm(rows_of(DRAWN), frame(TOOL)), Arm(rows_of(wrong), frame(TOOL), SCALE * size)


def machine_file(where: Path, real: Arm, extra: str = "") -> Path:
    """The calibrated machine file of a real arm, with the drawing under ``nominal:``."""
    path = where / "calibrated.yaml"
    degrees = real.rows * np.where(np.isin(np.arange(5), (0, 1, 3)), 180 / np.pi, 1.0)
    joints = [
        f"    - {{name: q{k + 1}, kind: revolute, "
        + ", ".join(f"{key}: {value!r}" for key, value in zip(KEYS, row.tolist(), strict=True))
        + f", range: {RANGES[k].tolist()}}}"
        for k, row in enumerate(degrees)
    ]
    drawn = rows_of(DRAWN)
    nominal = [
        f"  q{k + 1}.{key}: {value!r}"
        for k, row in enumerate(drawn.tolist())
        for key, value in zip(KEYS, row, strict=True)
    ]
    effects = f"effects:\n  - {{effect: actuator-scale, place: [q4], parameters: {{s: {{value: {real.scale}, unit: '1'}}}}}}\n"
    text = [
        "schema: truepose/machine/1", "name: arm", "gravity: [0, 0, -9.80665]", "mechanism:", "  type: serial", "  joints:",
        *joints, f"frames: {{tool: {{in: flange, xyz: {list(TOOL[:3])}, rpy: {list(TOOL[3:])}}}}}", "nominal:", *nominal,
    ]  # fmt: skip
    path.write_text("\n".join(text) + "\n" + (extra or effects))
    return path


def joints(count: int, seed: int = 3) -> Array:
    """(count, 6) random joints, away from the borders of the ranges and from the singular poses of a real arm."""
    rng = np.random.default_rng(seed)
    low, high = np.radians(RANGES).T
    _, real = arms()
    out: list[Array] = []
    while len(out) < count:
        q = rng.uniform(0.9 * low, 0.9 * high)
        pose, steps = real.pose(q), 1e-6 * np.eye(6)
        slope = np.array([difference(real.pose(q + e), pose) / 1e-6 for e in steps]).T
        if np.linalg.svd(slope / np.array([[300.0]] * 3 + [[1.0]] * 3), compute_uv=False)[-1] > 0.1:
            out.append(q)
    return np.array(out)


def shape(arm: Arm, q: Array) -> tuple[bool, bool, bool]:
    """Whether the wrist is behind axis 1, and behind the lower arm, and axis 5 below zero."""
    frames = arm.frames(q)
    turned = Rotation.from_euler("z", -q[0]).as_matrix()
    shoulder, elbow, wrist = (turned @ frames[k][:3, 3] for k in (1, 2, 4))
    along = elbow - shoulder
    behind = float((wrist - elbow) @ [along[2], 0.0, -along[0]]) < 0
    return bool(wrist[0] < 0), behind, bool(q[4] < 0)


def status_turn(arm: Arm, q: Array) -> tuple[int, int]:
    """KUKA's S and T of joints."""
    overhead, elbow, wrist = shape(arm, q)
    return overhead + 2 * elbow + 4 * wrist, sum(1 << k for k in range(6) if q[k] < 0)


def quadrants(arm: Arm, q: Array) -> tuple[int, int, int, int]:
    """ABB's cf1, cf4, cf6 and cfx of joints."""
    overhead, elbow, wrist = shape(arm, q)
    cf1, cf4, cf6 = (int(np.floor(q[k] / (np.pi / 2))) for k in (0, 3, 5))
    return cf1, cf4, cf6, 4 * overhead + 2 * elbow + wrist


def numbers_of(pose: Array, how: str) -> str:
    """A pose (4, 4) in mm as a dialect writes it, with every digit."""
    turn = Rotation.from_matrix(pose[:3, :3])
    x, y, z = pose[:3, 3].tolist()
    if how == "kuka":
        a, b, c = turn.as_euler("ZYX", degrees=True).tolist()
        return f"{{X {x!r},Y {y!r},Z {z!r},A {a!r},B {b!r},C {c!r}}}"
    if how == "rapid":
        i, j, k, w = turn.as_quat().tolist()
        return f"[[{x!r},{y!r},{z!r}],[{w!r},{i!r},{j!r},{k!r}]]"
    return "p[" + ", ".join(repr(float(v)) for v in [x / 1000, y / 1000, z / 1000, *turn.as_rotvec()]) + "]"
