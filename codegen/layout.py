"""Numbers that the generated C needs beside the expressions: natural units, joint ranges, starts.

Everything the solver compares is in millimetres at the machine's size: rad times ``reach``, modified
Rodrigues parameters times 4 ``reach``, leg forces as a share of the carried weight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array
from truepose.codegen.printer import Real
from truepose.codegen.reference import Reference
from truepose.errors import InputError
from truepose.models.machine.controllability import free_joints, task_of
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.machine import FRAME_OF, Machine
from truepose.models.machine.mechanism import COORDINATES, Actuator, turns_freely
from truepose.models.task import Task

_STANDARD_GRAVITY = 9.80665
_UNLIMITED_TURN = math.radians(150.0)
_SINGLE = 2e-6
"""Promised to users of single precision, of the reach and in rad."""
_KEPT_SHARE = 0.5
"""Share of a tolerance which the solver may use; rounding of parameters and of the model needs the rest."""
VECTORS = 64
"""Samples of readings with their poses."""
_WIDE = 1e30


@dataclass(frozen=True)
class Layout:
    """Constants of one machine and precision.

    unknown (nq + nx,)     size of a millimetre in each joint and passive coordinate
    weight (6 + nc,)       factor that turns a residual row into millimetres
    bounded (nq + nx,)     2 angles, 1 lengths, 0 forces
    low, high (nq,)        joint ranges, widened by the tolerance; unlimited: -+1e30
    start, width (nq,)     where the starts of the inverse are spread
    turns (nq,)            whether a joint repeats after a full turn
    near (nq,)             readings at the home assembly, where iterations start: to nine decimals
    home (nx,)             passive coordinates there, likewise
    task                   which components of the pose the inverse meets
    free                   joints that turn the tool while the others hold its position; empty where none may have to swing
    position, rotation     tolerances of a solved pose, mm and rad; ``closure`` in mm
    share, tight           shares of the tolerances: within which a pose is solved, at which iterations stop
    """

    reach: float
    unknown: Array
    weight: Array
    bounded: tuple[int, ...]
    low: Array
    high: Array
    start: Array
    width: Array
    turns: tuple[bool, ...]
    near: Array
    home: Array
    task: Task
    free: tuple[int, ...]
    position: float
    rotation: float
    closure: float
    share: float
    tight: float
    vectors: tuple[tuple[Array, Array], ...]


def layout_of(model: SymbolicModel, real: Real) -> Layout:
    """Work out the constants; forward kinematics at sample readings gives the machine's size."""
    machine = model.machine
    length = _longest(machine)
    reference = Reference(model)
    if reference.is_singular:
        raise InputError(
            f"{model.machine.name}: mechanism.home: found a singular pose, where assemblies of the loops meet and readings do "
            "not tell which one is meant, expected a home off it, in the assembly that the machine stands in"
        )
    near = _near(reference)
    sampled = sample_ranges(machine, near, length)
    vectors = tuple((q, _rounded(pose)) for q, pose in reference.samples(*sampled, near, VECTORS))
    if not vectors:
        raise InputError(
            f"{model.machine.name}: found no readings within the joints' ranges at which its loops close, expected "
            "ranges about readings that it can stand at"
        )
    reach = _reach(length, [pose for _, pose in vectors])
    single = real == "float"
    position = _SINGLE * reach if single else 1e-6
    rotation = _SINGLE if single else 1e-9
    unknown = natural_units(model, reach)
    low, high = _allowed(machine.mechanism.actuators, unknown, position, rotation * reach)
    bounded = _bounded(model)
    start, width = _starts(machine, *sampled)
    task = task_of(model)
    return Layout(
        reach=reach,
        unknown=unknown,
        weight=_weights(model, unknown, bounded.count(0), reach),
        bounded=bounded,
        low=low,
        high=high,
        start=start,
        width=width,
        turns=tuple(turns_freely(machine.mechanism, name) for name in machine.mechanism.readings),
        near=near,
        home=_steady(model.home),
        task=task,
        free=free_joints(model, task),
        position=position,
        rotation=rotation,
        closure=_KEPT_SHARE * position if single else 1e-8,
        share=_KEPT_SHARE,
        tight=0.1 if single else 1e-3,
        vectors=vectors,
    )


def _reach(length: float, poses: Sequence[Array]) -> float:
    """How far (mm) tools stand from the base, ``length`` at least; rounded, so that a last digit of another mathematical
    library does not change the code."""
    return float(f"{max([length, *(float(np.linalg.norm(pose[:3, 3])) for pose in poses)]):.6g}")


def _allowed(
    actuators: Sequence[Actuator], unknown: Array, position: float, turn: float
) -> tuple[Array, Array]:
    """Joint ranges (nq,), widened by the tolerance: ``position`` of a length, ``turn`` of an angle, both mm."""
    slack = np.array(
        [(position if a.unit == "mm" else turn) * u for a, u in zip(actuators, unknown, strict=False)]
    )
    ranges = [a.reading_range or (-_WIDE, _WIDE) for a in actuators]
    return np.array([r[0] for r in ranges]) - slack, np.array([r[1] for r in ranges]) + slack


def _near(reference: Reference) -> Array:
    """Readings (nq,) at the home assembly: the middle of the ranges, or what the loops ask for."""
    model = reference.model
    actuators = model.machine.mechanism.actuators
    homes = zip(actuators, model.q_home.tolist(), strict=True)
    middle = np.array([np.mean(a.reading_range) if a.reading_range else home for a, home in homes])
    return _steady(middle if all(a.reading_range for a in actuators) else reference.home_readings(middle))


def _steady(values: Array) -> Array:
    """Values without the digits in which another mathematical library would end an iteration; no -0."""
    steady: Array = np.round(values, 9) + 0.0
    return steady


def _rounded(pose: Array) -> Array:
    """A pose (4, 4) without the digits that another mathematical library would give: 1e-12, and 1e-9 mm."""
    out = np.round(pose, 12) + 0.0
    out[:3, 3] = _steady(pose[:3, 3])
    return out


def _longest(machine: Machine) -> float:
    """Largest length (mm) among the parameters of mechanism and tool; 1 where all are zero."""
    inside = [*machine.mechanism.parameters, *(p for p in machine.frames if FRAME_OF.get(p.name) == "tool")]
    longest = max((abs(p.nominal) for p in inside if p.unit == "mm"), default=0.0)
    ranges = [
        max(map(abs, a.reading_range))
        for a in machine.mechanism.actuators
        if a.reading_range and a.unit == a.reading_unit == "mm"
    ]
    return max([longest, *ranges]) or 1.0


def _gain(machine: Machine, actuator: Actuator) -> float:
    value = machine.geometry[actuator.gain].nominal if actuator.gain else 1.0
    return abs(value) or 1.0


def natural_units(model: SymbolicModel, reach: float) -> Array:
    """What one millimetre is in every joint's reading and passive coordinate, and the weight over the reach (mm) for forces."""
    machine = model.machine
    out = [(1.0 if a.unit == "mm" else 1.0 / reach) / _gain(machine, a) for a in machine.mechanism.actuators]
    turn, quarter = [1.0 / reach], [0.25 / reach]
    of_kind = {
        "prismatic": [1.0],
        "revolute": turn,
        "universal": 2 * turn,
        "spherical": 3 * quarter,
        "free": [1.0] * 3 + 3 * quarter,
    }
    for joint in machine.mechanism.unknown:
        out += of_kind[joint.kind]
    forces = len(machine.mechanism.actuators) + len(model.home) - len(out)
    return np.array(out + [_weight_of(machine) / reach] * forces)


def _bounded(model: SymbolicModel) -> tuple[int, ...]:
    """What each unknown is to the limit of a step: 2 an angle, 1 a length, 0 a force."""
    mechanism = model.machine.mechanism
    out = [2 if a.unit == "rad" else 1 for a in mechanism.actuators]
    for joint in mechanism.unknown:
        out += (
            [1, 1, 1, 2, 2, 2]
            if joint.kind == "free"
            else [1 if joint.kind == "prismatic" else 2] * COORDINATES[joint.kind]
        )
    return (*out, *[0] * (len(model.readings) + len(model.home) - len(out)))


def _weights(model: SymbolicModel, unknown: Array, forces: int, reach: float) -> Array:
    """Pose rows, loop rows (mm as they are), then the balance of forces, by the coordinate it belongs to."""
    nq = len(model.readings)
    loops = model.closure.numel() - forces
    balance = unknown[nq : nq + forces] * reach / _weight_of(model.machine)
    return np.concatenate([np.ones(3), np.full(3, reach), np.ones(loops), balance])


def _weight_of(machine: Machine) -> float:
    """Weight of all masses (N), of one kilogram at least."""
    return max(1.0, sum(m.kg for m in machine.masses)) * _STANDARD_GRAVITY


def sample_ranges(machine: Machine, near: Array, length: float) -> tuple[Array, Array]:
    """Lowest and highest readings (n,) of samples: ranges; without one +-150 deg, or +-``length`` / 10 (mm) about ``near``."""
    low, high = [], []
    for a, at in zip(machine.mechanism.actuators, near, strict=True):
        half = (_UNLIMITED_TURN if a.unit == "rad" else 0.1 * length) / _gain(machine, a)
        low.append(a.reading_range[0] if a.reading_range else (0.0 if a.unit == "rad" else at) - half)
        high.append(a.reading_range[1] if a.reading_range else (0.0 if a.unit == "rad" else at) + half)
    return np.array(low), np.array(high)


def _starts(machine: Machine, low: Array, high: Array) -> tuple[Array, Array]:
    """Centre and width of the starts of the inverse: within ranges, at most one turn of a turning joint."""
    start, width = 0.5 * (low + high), high - low
    for k, a in enumerate(machine.mechanism.actuators):
        if turns_freely(machine.mechanism, a.reading):
            width[k] = min(width[k], 2 * math.pi) if a.reading_range else 2 * math.pi
    return start, width
