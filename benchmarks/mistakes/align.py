"""How well a pair fits when only base and tool may move: the measure of what a mistake does and of what a fix mends.

Flange poses come from the machine file as it stands (nominal); base and tool are fitted here, by six numbers each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from truepose.errors import TrueposeError
from truepose.identification.fit.align import rigid_motion
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

from .pairs import Array, found
from .rotations import frame, inverse

Places = NDArray[np.intp]
LEVER = 300.0
"""mm: a turn counts as what it moves at this distance."""
HELD = 3.0
"""Tolerances by which base and tool may leave the drawing when they are held."""


@dataclass(frozen=True)
class Sight:
    """What a pair says: flange poses (n, 4, 4), base and tool as drawn, points (p, 3) of the tool, what was read.

    read (n, p, 3) mm, turns (n, 3, 3) or None, lengths (n,) of a ball bar about ``centre``, direct (n,) residuals of a
    sensor without a base. tolerances (12,) of base and tool, mm and rad. lost: rows that cannot be assembled.
    """

    flange: Array
    base: Array
    tool: Array
    points: Array
    read: Array | None
    turns: Array | None
    lengths: Array | None
    centre: Array
    direct: Array | None
    tolerances: Array
    lost: int


@dataclass(frozen=True)
class Misfit:
    """Root mean squares: points (mm) and turns (mm at LEVER) or lengths; infinite where nothing could be assembled."""

    points: float
    turns: float

    def over(self, right: Misfit) -> float:
        """How many times as large as the right pair's."""
        pairs = ((self.points, right.points), (self.turns, right.turns))
        ratios = [a / max(b, 1e-9) for a, b in pairs if b > 0 or a > 0]
        return float(np.sqrt(np.mean(np.square(ratios)))) if ratios else 0.0


MOUNTS = tuple(f"{f}.{a}" for f in ("base", "tool") for a in ("x", "y", "z", "rx", "ry", "rz"))
NOWHERE = Misfit(np.inf, np.inf)


def sight(folder: Path) -> Sight:
    """Of a written pair. Raises TrueposeError where it cannot be read."""
    path, tables = found(folder)
    machine = load_machine(path)
    recording = load_recording(machine, tables)
    predictor = Predictor(machine, recording)
    p = predictor.model.p_home
    x, good = predictor.assemble(p)
    poses = predictor.poses(p, x)[0][good]
    value = dict(zip(predictor.model.names, p, strict=True))
    tolerance = {name: parameter.tolerance for name, parameter in machine.geometry.items()}
    at = np.array([value.get(name, 0.0) for name in MOUNTS])
    base, tool = frame(at[:3], at[3:6]), frame(at[6:9], at[9:])
    section, scale = _section(path), _length(path)
    observed = {name: np.asarray(v)[good] for name, v in recording.observations.items()}
    read, turns, lengths = _read(section, observed)
    direct = None
    if read is None and lengths is None:
        names, values, _, _ = predictor.columns(p, x)
        direct = (values[:, 0] - recording.observations[names[0]])[good]
    return Sight(
        inverse(base) @ poses @ inverse(tool),
        base,
        tool,
        scale * _points(section),
        read,
        turns,
        lengths,
        scale * np.array(section.get("centre", [0.0, 0.0, 0.0]), dtype=float),
        direct,
        np.array([tolerance.get(name, 0.0) for name in MOUNTS]),
        int(np.sum(~good)),
    )


def _points(section: Mapping[str, Any]) -> Array:
    """(p, 3) of the tool, in the file's unit: targets, a ball or the origin."""
    if section["type"] == "targets":
        return np.array(list(section["points"].values()), dtype=float)
    return np.array([section.get("ball", [0.0, 0.0, 0.0])], dtype=float)


def _read(
    section: Mapping[str, Any], observed: Mapping[str, Array]
) -> tuple[Array | None, Array | None, Array | None]:
    """Points (n, p, 3), turns (n, 3, 3) and lengths (n,), as far as the sensor reads them."""
    kind = section["type"]
    if kind == "ballbar":
        return None, None, observed["length"]
    if kind not in ("pose", "position", "targets"):
        return None, None, None
    names = [f"{name}." for name in section["points"]] if kind == "targets" else [""]
    read = np.stack([np.column_stack([observed[f"{n}{a}"] for a in "xyz"]) for n in names], axis=1)
    if kind != "pose":
        return read, None, None
    turns = Rotation.from_rotvec(np.column_stack([observed[c] for c in ("rx", "ry", "rz")]))
    return read, turns.as_matrix(), None


def misfit(pair: Sight, *, held: bool) -> Misfit:
    """After the best base and tool; ``held``: within a few tolerances of the drawing, else anywhere."""
    if len(pair.flange) < 3:
        return NOWHERE
    if pair.direct is not None:
        return Misfit(_rms(pair.direct), 0.0)
    width = HELD * pair.tolerances if held else np.full(12, np.inf)
    if pair.lengths is not None:  # the bar's own centre is where the base is
        width = np.where(np.arange(12) < 6, HELD * pair.tolerances, width)
    free = np.flatnonzero(width > 0)
    bound = np.where(np.isinf(width[free]), np.inf, width[free])
    best = np.inf
    for base, tool in _starts(pair, width):

        def residual(step: Array, base: Array = base, tool: Array = tool) -> Array:
            return _residual(pair, *_moved(base, tool, free, step))

        if free.size == 0:
            return _parts(pair, base, tool)
        scale = np.where(free % 6 < 3, 10.0, 0.05)
        inside = _inside(pair, base, tool, free, bound)
        done = least_squares(
            residual, np.zeros(len(free)), bounds=inside, x_scale=scale, max_nfev=60, method="trf"
        )
        if done.cost < best:
            best, chosen = done.cost, _moved(base, tool, free, done.x)
    return _parts(pair, *chosen)


def _inside(pair: Sight, base: Array, tool: Array, free: Places, bound: Array) -> tuple[Array, Array]:
    """Bounds of the steps; a start elsewhere than the drawing has none on its frame."""
    moved = np.repeat([not np.array_equal(base, pair.base), not np.array_equal(tool, pair.tool)], 6)[free]
    wide = np.where(moved, np.inf, bound)
    return -wide, wide


def _starts(pair: Sight, width: Array) -> list[tuple[Array, Array]]:
    """The drawing; where the base may stand anywhere, also where the points put it, and where the turns put the tool."""
    out = [(pair.base, pair.tool)]
    loose = np.isinf(width[:6]).all()
    if not loose or pair.read is None:
        return out
    tools = [pair.tool]
    if pair.turns is not None and np.isinf(width[9:]).all():
        tools += [_turned_tool(pair)]
    for tool in tools:
        ends = _ends(pair, np.eye(4), tool)
        rotation, shift = rigid_motion(ends.reshape(-1, 3), pair.read.reshape(-1, 3))
        base = np.eye(4)
        base[:3, :3], base[:3, 3] = rotation, shift
        out.append((base, tool))
    return out


def _turned_tool(pair: Sight) -> Array:
    """The tool turned as differences of measured turns say (axes of Ri' Rj against those of Fi' Fj)."""
    assert pair.turns is not None
    own, seen = pair.flange[:, :3, :3], pair.turns
    a = Rotation.from_matrix(np.swapaxes(own[:-1], 1, 2) @ own[1:]).as_rotvec()
    b = Rotation.from_matrix(np.swapaxes(seen[:-1], 1, 2) @ seen[1:]).as_rotvec()
    # Fi' Fj = T (Ri' Rj) T': axes in the flange are T times axes in the tool
    tool = pair.tool.copy()
    u, _, vt = np.linalg.svd(a.T @ b)
    tool[:3, :3] = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return tool


def _moved(base: Array, tool: Array, free: Places, step: Array) -> tuple[Array, Array]:
    twist = np.zeros(12)
    twist[free] = step
    out = []
    for pose, part in ((base, twist[:6]), (tool, twist[6:])):
        moved = pose.copy()
        moved[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(part[3:]).as_matrix()
        moved[:3, 3] += part[:3]
        out.append(moved)
    return out[0], out[1]


def _ends(pair: Sight, base: Array, tool: Array) -> Array:
    """(n, p, 3) where the points of the tool should be."""
    pose = base @ pair.flange @ tool
    return np.asarray(np.einsum("nij,pj->npi", pose[:, :3, :3], pair.points) + pose[:, None, :3, 3])


def _residual(pair: Sight, base: Array, tool: Array) -> Array:
    parts = []
    ends = _ends(pair, base, tool)
    if pair.read is not None:
        parts.append((ends - pair.read).ravel())
    if pair.lengths is not None:
        parts.append(np.linalg.norm(ends[:, 0] - pair.centre, axis=1) - pair.lengths)
    if pair.turns is not None:
        parts.append(LEVER * _turns(pair, base, tool).ravel())
    return np.concatenate(parts)


def _turns(pair: Sight, base: Array, tool: Array) -> Array:
    assert pair.turns is not None
    should = base[:3, :3] @ pair.flange[:, :3, :3] @ tool[:3, :3]
    return np.asarray(Rotation.from_matrix(np.swapaxes(should, 1, 2) @ pair.turns).as_rotvec())


def _parts(pair: Sight, base: Array, tool: Array) -> Misfit:
    if pair.lengths is not None:
        return Misfit(_rms(_residual(pair, base, tool)), 0.0)
    assert pair.read is not None
    turns = 0.0 if pair.turns is None else LEVER * _rms(_turns(pair, base, tool))
    return Misfit(_rms(_ends(pair, base, tool) - pair.read), turns)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _section(path: Path) -> Mapping[str, Any]:
    section = yaml.safe_load(path.read_text(encoding="utf-8"))["sensor"]
    if isinstance(section, list):
        if len(section) != 1:
            raise TrueposeError(f"{path}: found {len(section)} sensors, expected one")
        return dict(section[0])
    return dict(section)


def _length(path: Path) -> float:
    """mm of the file's unit of length."""
    from truepose.models.units import convert

    unit = (yaml.safe_load(path.read_text(encoding="utf-8")).get("units") or {}).get("length", "mm")
    return float(convert(1.0, unit, "mm"))


__all__ = ["NOWHERE", "Misfit", "Sight", "misfit", "sight"]
