"""A machine at home, drawn by the lines between its joints and along its legs, seen from the side and a little from above."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from truepose.errors import TrueposeError
from truepose.models.assembly import assemble, rod_ends, symbols
from truepose.models.kinematics import symbolic_model
from truepose.models.machine import Machine
from truepose.shown.drawing import Segment, lines

Array = NDArray[np.float64]
_TURN, _RISE = np.radians(-35.0), np.radians(20.0)


def sketch(machine: Machine) -> str:
    """SVG of the links, legs and tool; empty where the machine cannot be assembled at home."""
    try:
        ends = segments(machine)
    except TrueposeError:
        return ""
    drawn = {name: [_seen(a, b) for a, b in found] for name, found in ends.items()}
    return lines(drawn, title=f"{machine.name} at home")


def segments(machine: Machine) -> dict[str, Array]:
    """Ends (k, 2, 3), mm, in the base's frame, of ``links``, ``legs`` and the ``tool`` at the machine's home."""
    plain = replace(machine, effects=(), gravity=None)
    model, mechanism = symbolic_model(plain), machine.mechanism
    q = symbols("q", mechanism.readings)
    values = {**symbols("", [p.name for p in machine.parameters]), **{n: ca.SX(0) for n in machine.ports}}
    passive = len(model.home) // (2 if mechanism.loops != "exact" else 1)
    x = ca.SX.sym("x", passive)
    placed = assemble(plain, values, q, {}, x)
    origins = {name: pose[:3, 3] for name, pose in placed.bodies.items()}
    legs = [(rod, *rod_ends(rod, placed.bodies, values)) for rod in mechanism.rods]
    arms = [(joint.parent, origins[joint.child]) for joint in mechanism.tree if joint.kind != "free"]
    arms += [(rod.body_a, a) for rod, a, _ in legs] + [(rod.body_b, b) for rod, _, b in legs]
    pairs = {
        "links": [(origins[body], end) for body, end in arms],
        "legs": [(a, b) for _, a, b in legs],
        "tool": [(origins[mechanism.flange], placed.tool[:3, 3])],
    }
    points = ca.horzcat(*(point for found in pairs.values() for pair in found for point in pair))
    given = ca.vertcat(*q.values()), x, ca.vertcat(*(values[p.name] for p in machine.parameters))
    at_home = ca.Function("sketch", [*given], [points])(
        model.q_home, model.home[:passive], [p.nominal for p in machine.parameters]
    )
    numbers = np.array(at_home).T.reshape(-1, 2, 3)
    cuts = np.cumsum([len(found) for found in pairs.values()])[:-1]
    return dict(zip(pairs, np.split(numbers, cuts), strict=True))


def _seen(a: Array, b: Array) -> Segment:
    return _projected(a), _projected(b)


def _projected(point: Array) -> tuple[float, float]:
    x, y, z = (float(value) for value in point)
    across, away = (
        x * np.cos(_TURN) - y * np.sin(_TURN),
        x * np.sin(_TURN) + y * np.cos(_TURN),
    )
    return float(across), float(z * np.cos(_RISE) + away * np.sin(_RISE))
