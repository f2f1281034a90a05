"""Six-joint arms whose C is generated, beside a product of their transformations in numpy that shares no code with it."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from support.generated_c import LEVEL, compile_library
from support.plain_kinematics import frame, step
from truepose.arrays import Array
from truepose.codegen.c import generate
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

INSIDE = Path(__file__).parent / "inside_arm.c"
_FIELDS = ("beta", "alpha", "d", "theta", "r")


@dataclass(frozen=True)
class Arm:
    """An arm by its table: rows (6, 5) of beta, alpha (deg), d (mm), theta (deg), r (mm), and ranges (6, 2), deg.

    ``slides`` are the joints (from 0) that slide; their ranges are mm.
    """

    name: str
    table: Array
    ranges: Array
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0)
    slides: tuple[int, ...] = ()

    @property
    def text(self) -> str:
        """The machine file."""
        rows = []
        for k, (row, (low, high)) in enumerate(zip(self.table, self.ranges, strict=True), start=1):
            numbers = ", ".join(
                f"{field}: {value!r}" for field, value in zip(_FIELDS, row.tolist(), strict=True)
            )
            kind = "prismatic" if k - 1 in self.slides else "revolute"
            rows.append(f"    - {{name: q{k}, kind: {kind}, {numbers}, range: [{low}, {high}]}}\n")
        head = f"schema: truepose/machine/1\nname: {self.name}\nmechanism:\n  type: serial\n  joints:\n"
        return head + "".join(rows) + f"frames: {{tool: {{in: flange, xyz: {list(self.tool)}}}}}\n"

    def machine(self, where: Path) -> Machine:
        """The machine, by way of its file in ``where``."""
        (where / f"{self.name}.yaml").write_text(self.text)
        return load_machine(where / f"{self.name}.yaml")

    @property
    def limits(self) -> tuple[Array, Array]:
        """Joint ranges (6,), (6,), rad; mm of slides."""
        low, high = np.where(self.slide[:, None], self.ranges, np.radians(self.ranges)).T
        return low, high

    @property
    def slide(self) -> NDArray[np.bool_]:
        """(6,): whether each joint slides."""
        return np.isin(np.arange(6), self.slides)

    def readings(self, count: int, seed: int) -> Array:
        """(count, 6) anywhere within the ranges."""
        low, high = self.limits
        drawn: Array = np.random.default_rng(seed).uniform(low, high, (count, 6))
        return drawn

    def frames(self, q: Array) -> Array:
        """(n, 7, 3, 4): the frame of every joint after its turn, then the tool's, at readings (n, 6)."""
        pose, out = np.eye(4), []
        for k, (beta, alpha, d, theta, r) in enumerate(self.table):
            slides = k in self.slides
            turned = step(
                [*np.radians([beta, alpha]), d, np.radians(theta), r], 0.0 * q[:, k] if slides else q[:, k]
            )
            if slides:
                turned[:, :3, 3] += q[:, k, None] * turned[:, :3, 2]
            pose = pose @ turned
            out.append(pose)
        out.append(pose @ frame(self.tool))
        return np.stack(out, axis=1)[:, :, :3]

    def poses(self, q: Array) -> Array:
        """(n, 12) of the tool, row by row."""
        return self.frames(q)[:, -1].reshape(-1, 12)

    def jacobians(self, q: Array) -> Array:
        """(n, 6, 6) of [v; w] at the tool."""
        frames = self.frames(q)
        axes, origins = frames[:, :6, :, 2], frames[:, :6, :, 3]
        linear = np.cross(axes, frames[:, 6, None, :, 3] - origins)
        return np.concatenate([linear, axes], axis=2).transpose(0, 2, 1)


def errors(poses: Array, wanted: Array) -> Array:
    """(n, 6) [mm; rad] that take poses (n, 12) to those wanted; rad as the sine of the angle where it is small."""
    a, b = poses.reshape(-1, 3, 4), wanted.reshape(-1, 3, 4)
    turn = b[:, :, :3] @ a[:, :, :3].transpose(0, 2, 1)
    half = 0.5 * np.stack([turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
    # beyond a quarter turn the sine falls again: stay as long as it was
    back = np.trace(turn, axis1=1, axis2=2) < 1.0
    size = np.linalg.norm(half, axis=1, keepdims=True)
    half = np.where(back[:, None], half / np.maximum(size, 1e-9), half)
    return np.concatenate([b[:, :, 3] - a[:, :, 3], half], axis=1)


def search(arm: Arm, wanted: Array, starts: Array, rounds: int = 60) -> Array:
    """Solutions (m, 6) of one pose (12,) that damped least squares find from starts (n, 6); angles in (-pi, pi]."""
    scale = np.array([1.0, 1.0, 1.0, 300.0, 300.0, 300.0])
    q, damping = starts.copy(), np.full(len(starts), 1e-2)
    e = errors(arm.poses(q), wanted) * scale
    for _ in range(rounds):
        J = arm.jacobians(q) * scale[:, None]
        normal = J.transpose(0, 2, 1) @ J + damping[:, None, None] * 1e4 * np.eye(6)
        step = np.linalg.solve(normal, (J.transpose(0, 2, 1) @ e[:, :, None]))[:, :, 0]
        step *= np.minimum(1.0, 0.7 / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-30))
        new = errors(arm.poses(q + step), wanted) * scale
        better = (new**2).sum(axis=1) < (e**2).sum(axis=1)
        q, e = np.where(better[:, None], q + step, q), np.where(better[:, None], new, e)
        damping = np.clip(np.where(better, damping / 8, damping * 4), 1e-16, 1e4)
    met = np.linalg.norm(e[:, :3], axis=1) < 1e-8
    met &= np.linalg.norm(e[:, 3:], axis=1) < 1e-8
    return folded(q[met])


def folded(angles: Array) -> Array:
    """Angles less full turns, in [-pi, pi)."""
    return np.mod(angles + np.pi, 2 * np.pi) - np.pi


def apart(a: Array, b: Array) -> Array:
    """Largest difference of readings (..., 6) up to full turns."""
    return np.asarray(np.abs(folded(a - b)).max(axis=-1))


@dataclass(frozen=True)
class BuiltArm:
    """An arm's C, in double precision."""

    arm: Arm
    directory: Path
    library: ctypes.CDLL

    def function(self, tail: str) -> ctypes._NamedFuncPointer:
        """A function of the interface."""
        return self.library[f"{self.arm.name}_{tail}"]

    def ik(self, pose: Array, guess: Array, p: Array | None = None) -> tuple[int, Array]:
        """Code and joints (6,)."""
        out = np.full(6, -7.0)
        code = self.function("ik")(_at(p), None, _at(pose), _at(guess), _at(out))
        return int(code), out

    def ik_all(self, pose: Array, p: Array | None = None) -> tuple[int, Array]:
        """Code and all joints (m, 6)."""
        out, count = np.full((16, 6), -7.0), ctypes.c_int(0)
        code = self.function("ik_all")(_at(p), None, _at(pose), _at(out), ctypes.byref(count))
        return int(code), out[: count.value]

    def many(
        self, tail: str, *inputs: Array, p: Array | None = None, width: int = 6
    ) -> tuple[int, Array, NDArray[np.int32]]:
        """Failures, outputs (n, width) that start as -7, and codes (n,)."""
        arrays = [np.ascontiguousarray(a) for a in inputs]
        n = len(arrays[0])
        out, codes = np.full((n, width), -7.0), np.full(n, -1, dtype=np.int32)
        failed = self.function(tail)(_at(p), None, ctypes.c_int(n), *map(_at, arrays), _at(out), _at(codes))
        return int(failed), out, codes

    def starts(self, pose: Array) -> Array:
        """Solutions (m, 6) of the drawn arm."""
        out = np.full((8, 6), np.nan)
        count = self.library["starts_at"](_at(np.ascontiguousarray(pose)), _at(out))
        return out[:count]


def _at(array: NDArray[np.generic] | None) -> ctypes.c_void_p | None:
    return None if array is None else array.ctypes.data_as(ctypes.c_void_p)


@cache
def built(where: Path, name: str, flags: tuple[str, ...] = ()) -> BuiltArm:
    """One of ARMS, generated and compiled with ``flags`` too."""
    arm = ARMS[name]
    directory = where / "-".join(["six", name, *(flag.strip("-") for flag in flags)])
    files = generate(arm.machine(where), directory)
    assert any(file.name == f"{name}_batch.c" for file in files)
    sources = [str(INSIDE), f"{name}_batch.c"]
    inside = ["-I.", f'-DFILE_OF_ARM="{name}_kin.c"', *(["-DNO_DRAWN_ARM"] if name in GENERAL else [])]
    return BuiltArm(arm, directory, compile_library(directory, sources, LEVEL, *flags, *inside))


@cache
def counted(where: Path, name: str) -> BuiltArm:
    """One of ARMS whose C counts its evaluations of the model, in ``evaluations`` of the library."""
    made = built(where, name)
    text = (made.directory / f"{name}_kin.c").read_text()
    body = r"(static void (?:chain_of|end_of)\(const model \*m, const stand \*at, [^)]*\)\n\{\n    int j;\n)"
    text, places = re.subn(body, r"\1    ++evaluations;\n", text)
    assert places == 2
    (made.directory / "counted.c").write_text("int evaluations;\n" + text)
    return replace(made, library=compile_library(made.directory, ["counted.c"], LEVEL, name="counted.so"))


def _drawn(
    name: str,
    alpha: Sequence[float],
    d: Sequence[float],
    r: Sequence[float],
    ranges: Sequence[tuple[int, int]],
) -> Arm:
    zeros = np.zeros(6)
    return Arm(
        name,
        np.column_stack([zeros, alpha, d, zeros, r]).astype(float),
        np.array(ranges, dtype=float),
        (12, -7, 93),
    )


def _as_built(arm: Arm, name: str, seed: int) -> Arm:
    """With errors of up to 1 mm and 0.5 deg everywhere."""
    error = np.random.default_rng(seed).uniform(-1, 1, (6, 5)) * [0.5, 0.5, 1.0, 0.5, 1.0]
    return replace(arm, name=name, table=np.round(arm.table + error, 3))


_ROUND = [(-360, 360)] * 6
_OWN = [(-160, 160), (-225, 45), (-45, 225), (-110, 170), (-100, 100), (-266, 266)]
_UR = _drawn(
    "ur", (0, 90, 0, 0, 90, -90), (0, 0, -612, -572.3, 0, 0), (127.3, 0, 0, 163.9, 115.7, 92.2), _ROUND
)
_TURNED = _drawn(
    "turned",
    (0, 90, 180, 180, 90, -90),
    (0, 0, -612, -572.3, 0, 0),
    (127.3, 0, 0, 163.9, 115.7, 92.2),
    _ROUND,
)
_PUMA = _drawn("puma", (0, -90, 0, -90, 90, -90), (0, 0, 431.8, 20.3, 0, 0), (0, 0, 150, 431.8, 0, 0), _OWN)
_UPSIDE = _drawn(
    "upside", (0, -90, 180, -90, 90, -90), (0, 0, 431.8, 20.3, 0, 0), (0, 0, 150, 431.8, 0, 0), _OWN
)
_GENERAL = _drawn(
    "general", (0, -70, 40, -60, 75, -80), (0, 60, 420, 90, 50, 40), (300, 40, 60, 400, 70, 60), _ROUND
)
DRAWN = {arm.name: arm for arm in (_UR, _TURNED, _PUMA, _UPSIDE)}
BUILT = {
    name: _as_built(arm, name, seed)
    for seed, (name, arm) in enumerate((("ur_built", _UR), ("turned_built", _TURNED), ("puma_built", _PUMA)))
}
_OFFSET = _drawn(
    "offset", (0, -90, 180, -90, 90, -90), (0, 0, 540, 0, 0, 0), (0, 0, 0, -540, 150, -160), _ROUND
)
"""The wrist of FANUC's CRX-10iA: its axes do not meet."""
_RAIL = replace(
    _as_built(_GENERAL, "rail_built", 9),
    ranges=np.array([*_ROUND[:2], (-250, 400), *_ROUND[3:]]),
    slides=(2,),
)
_GANTRY = replace(
    _as_built(_PUMA, "gantry_built", 10), ranges=np.array([*3 * [(-300, 300)], *_ROUND[3:]]), slides=(0, 1, 2)
)
GENERAL = {
    arm.name: arm for arm in (_GENERAL, _OFFSET, _as_built(_OFFSET, "offset_built", 8), _RAIL, _GANTRY)
}
"""Arms similar to none with a closed form."""
ARMS = {**DRAWN, **BUILT, **GENERAL}
