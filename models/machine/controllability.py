"""What the joints of a machine can hold of the tool's pose: its task, stated in the file or chosen.

Six readings and more hold the whole pose. Fewer hold as many components as they move independently: the whole
position first, then the direction of the tool's axis or a turn about one of its axes. Samples of the readings decide.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import casadi as ca
import numpy as np
from scipy.stats.qmc import Halton

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.machine.closure import closed, coordinate_scale, one_row
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES
from truepose.models.machine.velocities import twists
from truepose.models.task import AXIS, WHOLE, Task

_SAMPLES = 40
_SHRINK = (1.0, 0.3, 0.1)
"""Shares of the way from home to a sample; loops need not close at the whole of it."""
_LOW = 0.1
"""Share of the samples that may be next to a singular pose."""
_CHOSEN, _STATED = 0.02, 1e-6
"""Smallest singular value, in parts of the largest, at which components count as independent: by default, and stated."""
_NOTHING = 1e-300
_AS_WELL = 0.5
"""Share of the fastest turn by the free joints at which a slower one counts as none next to a singular pose."""
_SPLITS = {
    5: ((3, 2), (2, 3)),
    4: ((3, 1), (2, 2), (1, 3)),
    3: ((3, 0), (0, 3), (2, 1), (1, 2)),
    2: ((0, 2), (2, 0), (1, 1)),
}
"""How many components of position and rotation are tried for so many conditions, the first choice first."""


def stated_task(machine: Machine) -> Task | None:
    """Return the task that the machine's file states; None where it states none."""
    return machine.file.task if machine.file else None


def machine_task(machine: Machine) -> Task:
    """Return the task of a machine with the effects of its file, as ``task_of`` does."""
    return WHOLE if _holds_all(machine) else task_of(symbolic_model(machine, machine.effects))


def task_of(model: SymbolicModel) -> Task:
    """Return the task of the machine's file, or the one that its readings can hold.

    Raises InputError for a stated task that the joints cannot hold.
    """
    if _holds_all(model.machine):
        return WHOLE
    stated = stated_task(model.machine)
    samples = _in_parts(*_motions(model))
    if stated is None:
        return _chosen(samples, _pointed(model.machine))
    if _independence(samples, stated.rows) < _STATED:
        raise InputError(
            f"{model.machine.name}: task: found {list(stated.components)}, expected components that "
            f"{', '.join(model.readings)} move independently, as {list(_chosen(samples, _pointed(model.machine)).components)}"
        )
    return stated


def free_joints(model: SymbolicModel, task: Task) -> tuple[int, ...]:
    """Return the places of the readings that turn the tool while the others hold its position, where one may have to swing.

    Empty where a task has no position or no turns, where there are joints to spare, where one of those joints slides, and
    where they turn the tool as well in all samples: nothing is singular there but the position.
    """
    every = range(len(model.readings))
    if task.position is None or len(every) != len(task.rows):
        return ()
    (motions, reach), along = _motions(model), list(task.along)
    samples = _in_parts(motions, reach)
    some = max(combinations(every, len(along)), key=lambda at: _independence(samples[:, :, list(at)], along))
    holders, free = list(some), [k for k in every if k not in some]
    if any(model.machine.mechanism.actuators[k].unit != "rad" for k in free):
        return ()
    position, turns = motions[:, along], motions[:, list(task.rows[len(along) :])]
    made = (
        turns[:, :, free]
        - turns[:, :, holders] @ np.linalg.pinv(position[:, :, holders]) @ position[:, :, free]
    )
    least = np.linalg.svd(made, compute_uv=False)[:, -1]
    return tuple(free) if np.min(least) < _AS_WELL * np.max(least) else ()


def judged_axes(model: SymbolicModel) -> tuple[int, ...]:
    """Return the axes of the base along which errors of the tool's position count.

    Those of a stated task. Else those along which the readings move the tool: not the one across a planar arm. All where that
    leaves none.
    """
    stated, every = stated_task(model.machine), (0, 1, 2)
    if stated is not None or _holds_all(model.machine):
        return (stated or WHOLE).along or every
    sizes = np.max(np.abs(_motions(model)[0][:, :3]), axis=(0, 2))
    return tuple(k for k in every if sizes[k] >= _CHOSEN * np.max(sizes)) or every


def _holds_all(machine: Machine) -> bool:
    """Return True if the whole pose is the task, without a look at the geometry."""
    stated = stated_task(machine)
    return stated == WHOLE or (stated is None and len(machine.mechanism.readings) >= len(AXES))


def _pointed(machine: Machine) -> str:
    """Return the direction that a sensor reads, as a component; by default that of the tool's z axis."""
    read = next((sensor.pointed for sensor in machine.sensors if sensor.pointed), "z")
    return next(name for name, axis in AXIS.items() if axis == "xyz".index(read))


def _chosen(samples: Array, pointed: str) -> Task:
    """Return the preferred task of as many components as the samples (m, 6, nq) move independently."""
    sizes = np.linalg.svd(samples, compute_uv=False)
    count = int(np.sum(np.median(sizes / np.maximum(sizes[:, :1], _NOTHING), axis=0) >= _CHOSEN))
    if count == len(AXES):
        return WHOLE
    every: list[tuple[float, Task]] = []
    for tasks in _candidates(count, pointed):
        every += (found := [(_independence(samples, task.rows), task) for task in tasks])
        worth, task = max(found, key=lambda one: one[0])
        if worth >= _CHOSEN:
            return task
    return max(every, key=lambda one: one[0])[1]


def _candidates(count: int, pointed: str) -> Iterator[list[Task]]:
    """Yield tasks of so many components, in groups: preferred groups first, those of a group are as good."""
    for along, about in _SPLITS.get(count, ((1, 0), (0, 1))):
        turns: list[Sequence[str]] = [*combinations(AXES[3:], about)]
        groups: list[list[Sequence[str]]] = [[(pointed,)], turns] if about == 2 else [turns]
        for group in groups:
            yield [Task.of((*p, *turn)) for p in combinations(AXES[:3], along) for turn in group]


def _independence(samples: Array, rows: Sequence[int]) -> float:
    """Return the smallest singular value of rows of the samples (m, 6, nq), in parts of the largest of all rows."""
    sizes = np.linalg.svd(samples[:, list(rows)], compute_uv=False)
    if len(rows) > samples.shape[2]:
        return 0.0
    largest = np.maximum(np.linalg.norm(samples, 2, axis=(1, 2)), _NOTHING)
    return round(float(np.quantile(sizes[:, -1] / largest, _LOW)), 9)  # rounding must not choose among equals


def _motions(model: SymbolicModel) -> tuple[Array, float]:
    """Return (m, 6, nq) twists by the readings, and how far (mm) the tool is from the base: velocity along axes of the base,
    turn about axes of the tool."""
    y = ca.vertcat(model.q, model.x)
    by_y, by_loops = twists(model.pose, y), ca.jacobian(model.equations, y)
    by_y[3:, :] = model.pose[:3, :3].T @ by_y[3:, :]
    inputs = [model.q, model.z, model.p, model.x]
    at = ca.Function("twists", inputs, [ca.densify(v) for v in (by_y, by_loops, model.pose[:3, 3])])
    nq, found, reach = len(model.readings), [], [1.0]
    for q, x in _stands(model):
        by, loops, place = (np.array(v) for v in at(q, model.z_home, model.p_home, x))
        passive = np.linalg.lstsq(loops[:, nq:], loops[:, :nq], rcond=None)[0]
        found.append(by[:, :nq] - by[:, nq:] @ passive)
        reach.append(float(np.linalg.norm(place)))
    return np.array(found), max(reach)


def _in_parts(motions: Array, reach: float) -> Array:
    """Return twists (m, 6, nq) in parts of the largest motion by each reading; rad count at the reach (mm)."""
    out = motions * np.repeat([1.0, reach], 3)[:, None]
    sizes = np.max(np.linalg.norm(out, axis=1), axis=0)
    return np.asarray(out / np.where(sizes > 0, sizes, 1.0))


def _stands(model: SymbolicModel) -> Iterator[tuple[Array, Array]]:
    """Yield readings (nq,) spread over their ranges, home first, and passive coordinates (nx,) there."""
    g, inputs = model.equations, [model.q, model.z, model.p, model.x]
    loops = ca.Function("loops", inputs, [ca.densify(v) for v in (g, ca.jacobian(g, model.x), model.gap)])
    scale = coordinate_scale(model.machine, len(model.home), model.gap.numel())
    yield model.q_home, model.home
    low, high = _ranges(model)
    for share in Halton(len(low), scramble=False).random(_SAMPLES + 1)[1:]:
        for amount in _SHRINK:
            q = model.q_home + amount * (low + share * (high - low) - model.q_home)
            x, good = (
                closed(one_row(loops, q, model.z_home, model.p_home), model.home[None], scale)
                if len(model.home)
                else (model.home[None], [True])
            )
            if good[0]:
                yield q, x[0]
                break


def _ranges(model: SymbolicModel) -> tuple[Array, Array]:
    """Return the lowest and highest readings (nq,); without a range a turn of 2 rad, or a tenth of the longest length."""
    machine, out = model.machine, []
    longest = max([1.0, *(abs(p.nominal) for p in machine.parameters if p.unit == "mm")])
    for actuator, home in zip(machine.mechanism.actuators, model.q_home.tolist(), strict=True):
        gain = machine.geometry[actuator.gain].nominal if actuator.gain else 1.0
        half = (1.0 if actuator.unit == "rad" else 0.1 * longest) / (abs(gain) or 1.0)
        out.append(actuator.reading_range or (home - half, home + half))
    low, high = np.array(out, dtype=float).T
    return low, high
