"""Inverse kinematics of hexapods leg by leg: the tool's pose tells the platform's, and each rod one equation.

With the platform's pose T as an input the loops depend on readings only. Where every leg depends on its own reading
alone, as a polynomial of degree two, the reading is a root of it in closed form: the one of the home assembly. Errors of
screws and platforms that deform leave equations for Newton's method, whose derivative is diagonal or nearly so.
``legs_of`` says None for all other machines.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.codegen.layout import Layout
from truepose.codegen.loops import Equations
from truepose.models.machine.assembly import assemble, displacement_of, rod_ends, tool_on_flange
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.mechanism import Mechanism

_APART = 0.1
"""Share of the root's size that the linear coefficient must have for a root without cancellation."""


@dataclass(frozen=True)
class Roots:
    """Readings in closed form.

    readings (nq,)   roots of the legs' equations
    under (nq,)      what square roots were taken of: negative where a leg does not reach
    lack (nq,)       what the equations lack at these readings, mm of the rod
    """

    readings: ca.SX
    under: ca.SX
    lack: ca.SX


@dataclass(frozen=True)
class Legs:
    """Equations of the legs at a pose.

    pose (12,)       the tool's pose, row by row: an input
    lack (nq,)       zero when all rods fit, mm, by ``pose`` and readings
    entries (nz,)    entries of its derivative by the readings that are not always zero; ``symbols`` (nz,) stand for them
    signs (nq,)      sign of the derivative of each leg by its own reading, in the assembly of home
    own (nq,)        places of these derivatives among the entries
    """

    pose: ca.SX
    lack: ca.SX
    entries: ca.SX
    symbols: ca.SX
    equations: Equations | None
    signs: tuple[float, ...]
    own: tuple[int, ...]
    roots: Roots | None


def legs_of(model: SymbolicModel, layout: Layout, real: str) -> Legs | None:
    """The legs of a machine whose platform is held by rods alone, with as many readings as rods, else None."""
    mechanism = model.machine.mechanism
    if not (layout.task.is_whole and _is_platform_on_rods(model, mechanism)):
        return None
    pose = ca.SX.sym("T", 12)
    across, lengths = _rods(model, pose)
    if ca.depends_on(ca.vertcat(ca.vec(across), lengths), model.x):
        return None
    lack = (ca.sum1(across**2).T - lengths**2) / (2 * lengths)
    derivative = ca.sparsify(ca.jacobian(lack, model.q))
    samples = _at_samples(model, layout, pose, derivative)
    diagonals = np.diagonal(samples, axis1=1, axis2=2)
    signs = np.sign(diagonals[0])
    if not (np.sign(diagonals) == signs).all() or not signs.all():
        return None
    at = sorted(zip(*derivative.sparsity().get_triplet(), strict=True))
    symbols = ca.SX.sym("J", len(at))
    matrix = ca.SX(*derivative.shape)
    for k, (i, j) in enumerate(at):
        matrix[i, j] = symbols[k]
    unknown = layout.unknown[: len(signs)]
    return Legs(
        pose=pose,
        lack=lack,
        entries=ca.vertcat(*(derivative[i, j] for i, j in at)),
        symbols=symbols,
        equations=Equations.of(matrix, samples, (np.ones(len(signs)), unknown), real),
        signs=tuple(float(sign) for sign in signs),
        own=tuple(at.index((i, i)) for i in range(len(signs))),
        roots=_roots(model, layout, pose, (across, lengths), signs),
    )


def _is_platform_on_rods(model: SymbolicModel, mechanism: Mechanism) -> bool:
    """Whether the only passive joint lets the flange float, and as many rods as readings hold it to the rest."""
    passive, rods = mechanism.passive, mechanism.rods
    floats = len(passive) == 1 and passive[0].kind == "free" and passive[0].child == mechanism.flange
    if mechanism.loops != "exact" or not floats or mechanism.closing or model.x.numel() != 6:
        return False
    if any(joint.parent == mechanism.flange for joint in mechanism.tree):
        return False
    held = all((rod.body_a == mechanism.flange) != (rod.body_b == mechanism.flange) for rod in rods)
    return held and len(rods) == len(model.readings) == 6 and all(rod.flexures is None for rod in rods)


def _rods(model: SymbolicModel, pose: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Vector between the ends of every rod (3, nq), and its length (nq,), at the tool's pose.

    The platform's points are told in the tool's frame: then all that belongs to them depends on parameters alone.
    """
    machine = model.machine
    mechanism = machine.mechanism
    q = model.moved
    z = dict(zip(model.drivers, ca.vertsplit(model.z), strict=True))
    tool = ca.vertcat(ca.reshape(pose, 4, 3).T, ca.horzcat(0, 0, 0, 1))
    bodies = assemble(machine, model.values, q, z, model.x, {mechanism.flange: tool}).bodies
    flange, reading = tool_on_flange(model.values), {a.drives: a.reading for a in mechanism.actuators}
    across, lengths = [], []
    for rod in mechanism.rods:
        ends = rod_ends(rod, bodies, model.values)
        there, point = (ends[0], rod.point_b) if rod.body_b == mechanism.flange else (ends[1], rod.point_a)
        on_flange = ca.vertcat(*(model.values[name] for name in point)) if point else ca.SX.zeros(3, 1)
        in_tool = flange[:3, :3].T @ (on_flange - flange[:3, 3])
        across.append(tool[:3, :3] @ in_tool + tool[:3, 3] - there)
        lengths.append(
            displacement_of(machine, reading[rod.name], model.values, q)
            if rod.length is None
            else model.values[rod.length]
        )
    return ca.horzcat(*across), ca.vertcat(*lengths)


def _at_samples(model: SymbolicModel, layout: Layout, pose: ca.SX, expression: ca.SX) -> Array:
    """(m, ...) values at the layout's poses."""
    at = ca.Function("at", [pose, model.q, model.p, model.z], [ca.densify(expression)])
    rows = [at(tool[:3].ravel(), q, model.p_home, model.z_home) for q, tool in layout.vectors]
    return np.array([np.array(row) for row in rows])


def _roots(
    model: SymbolicModel, layout: Layout, pose: ca.SX, rods: tuple[ca.SX, ca.SX], signs: Array
) -> Roots | None:
    """Roots of |b - a|^2 = l^2; None unless each is a polynomial of degree two in its own reading at most."""
    parts = ca.vertcat(rods[0], rods[1].T)  # (4, nq): rod after rod
    slope = ca.jacobian(ca.vec(parts), model.q)
    if any(i // 4 != j for i, j in zip(*slope.sparsity().get_triplet(), strict=True)):
        return None
    if ca.depends_on(slope, model.q):
        return None
    rates = ca.horzcat(*(slope[4 * k : 4 * k + 4, k] for k in range(len(signs))))
    start = ca.substitute(parts, model.q, ca.SX.zeros(len(signs)))
    d, length, moves, grows = start[:3, :], start[3, :].T, rates[:3, :], rates[3, :].T
    # a q^2 + 2 b q + c = 0
    a = ca.sum1(moves**2).T - grows**2
    b = ca.sum1(d * moves).T - length * grows
    c = ca.sum1(d**2).T - length**2
    under = b * b - a * c
    typical = _at_samples(model, layout, pose, ca.horzcat(b, under, 2 * rods[1]))
    least = _APART * np.sqrt(np.abs(typical[:, :, 1]))
    leading = [bool(np.all(sign * typical[:, k, 0] > least[:, k])) for k, sign in enumerate(signs)]
    if any(a[k].is_zero() and not leading[k] for k in range(len(signs))):
        return None
    readings = []
    for k, sign in enumerate(signs):
        root = sign * ca.sqrt(under[k])
        # of the two forms of one root, the one whose sum does not cancel
        readings.append(-c[k] / (b[k] + root) if leading[k] else (root - b[k]) / a[k])
    found = ca.vertcat(*readings)
    lack = (c + found * (2 * b + a * found)) / ca.DM([float(f"{size:.6g}") for size in typical[0, :, 2]])
    return Roots(found, under, lack)
