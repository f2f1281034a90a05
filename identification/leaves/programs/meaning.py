"""What targets mean: the pose in the sensor's frame, and the nominal joints that a controller would take there.

How an arm of six joints stands: wrist behind axis 1, wrist behind the lower arm, axis 5 below zero.

Controllers of KUKA and ABB tell configurations by these. Forward is the x axis of the robot's base, turned with axis 1;
up is its z axis.

All joints that put an arm's tool at a pose, and which of them a program means.

A pose in a program has up to eight solutions and whole turns of the joints. Newton's method is started from many places of
the joints' ranges; what it finds is told apart, and a target's configuration, or else the way from the target before,
says which solution is meant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats.qmc import Halton

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError
from truepose.identification.compensation.compensate import ideal_constants, twists_between
from truepose.identification.compensation.inverse import PoseSolver, base_frame
from truepose.identification.leaves.programs.program import Configuration, Left, Program, Target, Told
from truepose.models.file.driver import APPROACH, Driver
from truepose.models.leaves.export.links import MM_PER_M, Tree, TreeJoint, tree_of, turn, xyz_rpy
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES, turns_freely
from truepose.models.task import WHOLE
from truepose.models.units import convert
from truepose.wording import close_matches

# -- One machine as the controller believes it to be and as it is, with any tool


class Robot:
    """A solver that is set to the nominal or to the real constants. ``drivers`` are values of the effects' drivers by name.

    Six joints meet whole poses, as their controller does; fewer meet what they can hold. Raises InputError for a driver that
    no effect has.
    """

    def __init__(self, machine: Machine, drivers: Mapping[str, float]) -> None:
        whole = WHOLE if len(machine.mechanism.readings) == len(AXES) else None
        self.machine, self.solver = machine, PoseSolver(machine, task=whole)
        model = self.solver.model
        for name in drivers:
            if name not in model.drivers:
                told = close_matches(name, model.drivers) if model.drivers else "the machine has none"
                raise InputError(f"--at: found the driver {name!r}, expected one that effects have; {told}")
        z = [drivers.get(name, float(v)) for name, v in zip(model.drivers, model.z_home, strict=True)]
        self.solver.z = np.array(z)
        self._real, self._ideal = model.p_home, ideal_constants(machine, model)
        self.base = base_frame(machine)

    @property
    def drivers(self) -> Mapping[str, float]:
        """Values of drivers, but for the ways in which joints arrive."""
        names = self.solver.model.drivers
        known = zip(names, self.solver.z.tolist(), strict=True)
        return {name: value for name, value in known if Driver.of(name).kind != APPROACH}

    @property
    def home(self) -> Array:
        """(nq,) readings at home."""
        return self.solver.model.q_home

    @property
    def reach(self) -> Array:
        """(nq,) readings that move a joint by the machine's size (a gantry has no length but its ranges), or by 1 rad."""
        actuators = self.machine.mechanism.actuators
        sizes = [max([self.solver.size, *map(abs, a.reading_range or ())]) for a in actuators]
        return np.array([s if a.reading_unit == "mm" else 1.0 for a, s in zip(actuators, sizes, strict=True)])

    def missed(self, goals: Array, poses: Array) -> Array:
        """Return twists (n, 6) from goals to poses (n, 4, 4) in the sensor's frame, of which the robot can hold."""
        return self.solver.task.counted(twists_between(goals, poses), goals, self.base[:3, :3])

    def nominal(self, tool: Array | None) -> None:
        """The drawing's joints and links, no effect, and a tool (4, 4) mm on the flange; None is the machine file's."""
        self.solver.p = self._with(tool, self._ideal)

    def real(self, tool: Array | None) -> None:
        """The machine as calibrated, with its effects and a tool."""
        self.solver.p = self._with(tool, self._real)

    def _with(self, tool: Array | None, p: Array) -> Array:
        if tool is None:
            return p
        xyz, rpy = xyz_rpy(tool)
        told = dict(zip((f"tool.{axis}" for axis in AXES), (*(v * MM_PER_M for v in xyz), *rpy), strict=True))
        return np.array(
            [told.get(name, value) for name, value in zip(self.solver.model.names, p, strict=True)]
        )


# -- How an arm of six joints stands: wrist behind axis 1, wrist behind the lower arm, axis 5 below zero


class ArmShape:
    """The shape of one arm with these ``values`` of parameters (mm, rad). Raises InputError for what is no chain of joints."""

    def __init__(self, machine: Machine, values: Mapping[str, float]) -> None:
        known = {p.name: p.nominal for p in machine.parameters} | dict.fromkeys(machine.ports, 0.0)
        told = {name: value for name, value in values.items() if name in known}
        self._tree: Tree = tree_of(machine, known | told, "a robot program")
        self._driven = [joint for joint in self._tree.path() if joint.kind != "fixed"]

    def of(self, q: Array) -> Mask:
        """(m, 3) of joints (m, 6): wrist behind axis 1, wrist behind the lower arm, axis 5 below zero."""
        return np.array([self._at(row) for row in q]).reshape(-1, 3)

    def reach(self) -> tuple[Array, float]:
        """A point (3,) of the first axis in the sensor's frame, and how far (mm) from there the tool can be at most.

        No straight line between the ends of links is longer than all links in a row.
        """
        path = self._tree.path()
        first = path.index(self._driven[0])
        links = self._tree.links({})
        length = float(np.linalg.norm(self._tree.tool[:3, 3]))
        for joint in path[first + 1 :]:
            length += float(np.linalg.norm(joint.origin[:3, 3]))
        for joint in path[first:]:
            if joint.kind == "prismatic":
                length += max(map(abs, joint.range)) if joint.range else np.inf
        root = self._tree.world @ links[path[first].child]
        return root[:3, 3], length

    def _at(self, q: Array) -> tuple[bool, bool, bool]:
        links = self._tree.links({joint.name: float(v) for joint, v in zip(self._driven, q, strict=True)})
        lines = [_line(joint, links) for joint in self._driven[:5]]
        (root, first), (shoulder, _), (elbow, _) = lines[:3]
        wrist = _nearest(lines[4], lines[3])
        forward, up = turn(first, float(q[0]))[:, 0], np.array([0.0, 0.0, 1.0])
        along, to_wrist = elbow - shoulder, wrist - elbow
        across = float(along @ up) * float(to_wrist @ forward) - float(along @ forward) * float(to_wrist @ up)
        return bool((wrist - root) @ forward < 0), across < 0, bool(q[4] < 0)


def _line(joint: TreeJoint, links: Mapping[str, Array]) -> tuple[Array, Array]:
    """A point (3,) and the direction (3,) of a joint's axis in the base."""
    frame = links[joint.child]
    return frame[:3, 3], frame[:3, :3] @ joint.axis


def _nearest(line: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """The point (3,) of a line that is next to another."""
    (a, u), (b, v) = line, other
    across = np.cross(u, v)
    square = float(across @ across)
    if square < 1e-12:
        return a
    out: Array = a + u * float(np.linalg.det(np.array([b - a, v, across]))) / square
    return out


# -- All joints that put an arm's tool at a pose, and which of them a program means

Numbers = tuple[float, ...]
STARTS = 48
"""Places that Newton's method starts from. Of 600 random poses of an IRB 120 and a UR5e it found the
joints they were made from for 599."""
_SAME = 1e-6
"""rad, or part of a metre: solutions nearer than this are one."""
_TURN = 2 * np.pi


class Branches:
    """Solutions of one machine at its solver's present constants."""

    def __init__(self, machine: Machine, solver: PoseSolver) -> None:
        self._solver = solver
        self._actuators = machine.mechanism.actuators
        self._free = [turns_freely(machine.mechanism, name) for name in machine.mechanism.readings]
        self._starts = np.vstack([solver.model.q_home, self._spread(STARTS)])
        try:
            self._shape: ArmShape | None = ArmShape(
                machine, dict(zip(solver.model.names, solver.p.tolist(), strict=True))
            )
        except InputError:  # no open chain: nothing to tell the shape of
            self._shape = None
        self._root, self._reach = self._shape.reach() if self._shape else (np.zeros(3), np.inf)

    def found(
        self, poses: Array, wanted: Sequence[Numbers], configuration: Configuration | None
    ) -> list[Array]:
        """Of each sensor-frame pose (n, 4, 4) distinct solutions (m, nq) in the joints' ranges.

        All that are found; of a pose with the numbers ``wanted`` of a configuration the search ends with the one that has it.
        """
        out: list[list[Array]] = [[] for _ in poses]
        away = np.linalg.norm(poses[:, :3, 3] - self._root, axis=1)
        rows = np.flatnonzero(away <= self._reach * (1 + _SAME))  # a search that finds nothing is the longest
        for start in self._starts if len(rows) else ():
            self._attempt(poses, rows, np.broadcast_to(start, (len(rows), len(start))), out)
            left = [k for k in rows.tolist() if not self._has(out[k], wanted[k], configuration)]
            rows = np.array(left, dtype=np.intp)
            if not len(rows):
                break
        known = [(k, flipped(q)) for k in rows for q in out[k]]
        if known:
            self._attempt(poses, np.array([k for k, _ in known]), np.array([q for _, q in known]), out)
        return [np.array(one).reshape(-1, len(self._actuators)) for one in out]

    def chosen(
        self, q: Array, before: Array, configuration: Configuration | None, numbers: Numbers
    ) -> Array | str:
        """Return the one of solutions (m, nq) that ``numbers`` of a configuration mean, else the next to joints ``before``
        (nq,); or why none can be told."""
        if not len(q):
            return "the nominal machine cannot take this pose with its joints in their ranges"
        turned = self._turns(q)
        if configuration is None or not numbers:
            return np.asarray(turned[int(np.argmin(np.max(np.abs(turned - before), axis=1)))])
        told = ", ".join(f"{n:g}" for n in numbers)
        fit = turned[configuration.fits(numbers, turned)]
        if len(fit) > 1:
            fit = fit[self._decided(fit, configuration, numbers)]
        if not len(fit):
            return f"no joints of the nominal machine that reach it have its configuration ({told})"
        if any(self._apart(other, fit[0]) > _SAME for other in fit):
            return f"several configurations of the joints have these numbers ({told})"
        return np.asarray(fit[int(np.argmin(np.max(np.abs(fit - before), axis=1)))])

    def _has(self, found: list[Array], numbers: Numbers, configuration: Configuration | None) -> bool:
        """Whether one of the solutions has a configuration in all its numbers."""
        if configuration is None or not numbers or not found:
            return False
        turned = self._turns(np.array(found))
        fit = turned[configuration.fits(numbers, turned)]
        return bool(len(fit)) and bool(self._decided(fit, configuration, numbers).any())

    def _decided(self, q: Array, configuration: Configuration, numbers: Numbers) -> Mask:
        if self._shape is None:
            return np.ones(len(q), dtype=bool)
        return configuration.decides(numbers, self._shape.of(q))

    def _attempt(self, poses: Array, rows: Index, start: Array, out: list[list[Array]]) -> None:
        """Add what Newton's method finds for poses ``rows`` (k,) from ``start`` (k, nq)."""
        found = self._solver.inverse(poses[rows], start, restarts=0)
        for k in np.flatnonzero(found.solved):
            q, known = found.q[k], out[rows[k]]
            if all(self._apart(q, other) > _SAME for other in known):
                known.append(q)

    def _turns(self, q: Array) -> Array:
        """Solutions (m, nq) with those that differ by a whole turn of joints, in their ranges."""
        for k, actuator in enumerate(self._actuators):
            if not self._free[k]:
                continue
            low, high = actuator.reading_range or (-_TURN, _TURN)
            both = np.concatenate([q + turn * np.eye(q.shape[1])[k] for turn in (0.0, _TURN, -_TURN)])
            q = both[(both[:, k] >= low - 1e-9) & (both[:, k] <= high + 1e-9)]
        return q

    def _apart(self, q: Array, other: Array) -> float:
        """Largest difference of two solutions (nq,), whole turns aside."""
        turns = np.where(self._free, _TURN, np.inf)
        apart = q - other
        return float(
            np.max(np.abs(np.where(np.isinf(turns), apart, np.remainder(apart + np.pi, _TURN) - np.pi)))
        )

    def _spread(self, count: int) -> Array:
        size = self._solver.size
        widest = [(-size, size) if a.reading_unit == "mm" else (-np.pi, np.pi) for a in self._actuators]
        ranges = [
            _within(a.reading_range, w) if a.reading_range else w
            for a, w in zip(self._actuators, widest, strict=True)
        ]
        low, high = np.array(ranges).T
        share = Halton(len(low), scramble=False).random(count + 1)[1:]
        return np.asarray(low + share * (high - low))


def flipped(q: Array) -> Array:
    """(nq,) where the other solution of a spherical wrist is, for joints (nq,)."""
    return q + np.array([0, 0, 0, np.pi, -2 * q[4], np.pi]) if len(q) == 6 else q


def _within(stated: tuple[float, float], widest: tuple[float, float]) -> tuple[float, float]:
    """A range, of a joint that turns by more than a turn the middle one."""
    if widest[1] != np.pi or stated[1] - stated[0] <= _TURN:
        return stated
    middle = (stated[0] + stated[1]) / 2
    return middle - np.pi, middle + np.pi


# -- What targets mean: the pose in the sensor's frame, and the nominal joints that a controller would take there

_OTHER = 1e-3
"""rad, mm: joints that differ by more are another solution."""
_OTHERWISE = "motions go to it with several solutions of the joints: it is corrected for that of the first"


@dataclass(frozen=True)
class Meant:
    """A target with its frames, the pose (4, 4) that is meant in the sensor's frame, and its nominal joints (nq,).

    ``at`` is the program's own target; ``target`` has no configuration where no joints have it.
    """

    target: Target
    told: Told
    goal: Array
    q: Array
    at: Target


def meant_of(
    robot: Robot, program: Program, known: Sequence[tuple[Target, Told]], left: list[Left]
) -> list[Meant]:
    """Nominal joints of all targets. Where nothing else tells, they are the next to those before, as the text goes.

    Targets that no joints can be told of are added to ``left``, and those that motions go to with several.
    """
    poses = [k for k, (target, _) in enumerate(known) if target.kind == "pose"]
    numbers = np.array([[n.value for n in known[k][0].numbers] for k in poses])
    goals = dict(zip(poses, program.form.poses(numbers), strict=True)) if poses else {}
    solutions = dict(_solutions(robot, known, goals, program.configuration))
    out: dict[int, Meant | None] = {}
    before = robot.home
    for k in _visits(known):
        target, told = known[k]
        if target.kind == "joints":
            if k not in out:
                robot.nominal(told.tool)
                q = joint_values(robot, program, [n.value for n in target.numbers])
                out[k] = Meant(target, told, robot.solver.forward(q[None, :])[0][0], q, target)
        elif k not in out or out[k] is not None:
            found = _meant(robot, program, target, solutions[k], before)
            last = out.get(k)
            if isinstance(found, str):
                left.append(Left(target.line, target.name, found))
                out[k] = None
            elif last is None:
                goal = robot.base @ told.base @ goals[k]
                out[k] = Meant(found[0], told, goal, found[1], target)
            elif np.max(np.abs(found[1] - last.q)) > _OTHER:
                left.append(Left(target.line, target.name, _OTHERWISE))
        now = out[k]
        before = before if now is None else now.q
    return [one for one in out.values() if one is not None]


def _visits(known: Sequence[tuple[Target, Told]]) -> list[int]:
    """Targets in the order in which the text goes to them, again and again."""
    visits = [
        (place, k) for k, (target, _) in enumerate(known) for place in (target.places or (target.place,))
    ]
    return [k for _, k in sorted(visits)]


def _meant(
    robot: Robot, program: Program, target: Target, solutions: tuple[Branches, Array], before: Array
) -> tuple[Target, Array] | str:
    """The target and the joints that a motion to it means, next to those ``before``; or why none."""
    configured = tuple(n.value for n in target.configuration)
    near = before if target.near is None else joint_values(robot, program, target.near)
    branches, q = solutions
    chosen = branches.chosen(q, near, program.configuration, configured)
    if isinstance(chosen, str) and target.loose and configured:
        chosen, target = branches.chosen(q, near, None, ()), replace(target, configuration=())
    return chosen if isinstance(chosen, str) else (target, chosen)


def _solutions(
    robot: Robot,
    known: Sequence[tuple[Target, Told]],
    goals: Mapping[int, Array],
    configuration: Configuration | None,
) -> list[tuple[int, tuple[Branches, Array]]]:
    """All nominal joints of each pose: tools are solved one by one, poses of a tool together."""
    out = []
    for tool, rows in by_tool([(k, known[k][1]) for k in goals]):
        robot.nominal(tool)
        branches = Branches(robot.machine, robot.solver)
        poses = np.array([robot.base @ known[k][1].base @ goals[k] for k in rows])
        wanted = [tuple(n.value for n in known[k][0].configuration) for k in rows]
        first: dict[tuple[bytes, tuple[float, ...]], int] = {}  # programs go to some poses many times
        own = [
            first.setdefault((pose.tobytes(), one), len(first))
            for pose, one in zip(poses, wanted, strict=True)
        ]
        at = np.unique(own, return_index=True)[1]
        found = branches.found(poses[at], [wanted[k] for k in at], configuration)
        out += [(k, (branches, found[one])) for k, one in zip(rows, own, strict=True)]
    return out


def by_tool(told: Sequence[tuple[int, Told]]) -> list[tuple[Array | None, list[int]]]:
    """Numbers of targets that have a tool in common, with that tool."""
    groups: dict[bytes | None, tuple[Array | None, list[int]]] = {}
    for k, one in told:
        key = None if one.tool is None else one.tool.tobytes()
        groups.setdefault(key, (one.tool, []))[1].append(k)
    return list(groups.values())


def joint_units(robot: Robot, program: Program) -> list[tuple[str, str]]:
    """Unit inside and in the text of each joint."""
    joints = robot.machine.mechanism.actuators
    own = program.joint_units
    return [(a.reading_unit, own.get(a.reading, own.get(a.reading_unit, a.reading_unit))) for a in joints]


def joint_values(robot: Robot, program: Program, values: Sequence[float]) -> Array:
    """(nq,) joints, mm and rad, of a text's numbers."""
    units = joint_units(robot, program)
    return np.array([convert(v, unit, inside) for v, (inside, unit) in zip(values, units, strict=True)])
