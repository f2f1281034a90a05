"""What a machine's sensors should read for every row of a recording, with exact derivatives.

Closed loops are solved for (``truepose.identification.prediction.loops``); derivatives of the pose follow from the
implicit function theorem, dx/dp = -(dg/dx)^-1 dg/dp, never from differentiating iterations.

Joints that formulas move: where a formula has no value (the root of a negative number), no machine can be assembled.

Readings that were lost: which channels of which rows they take with them.

A lost reading is NaN in the recording. A channel that depends on it reads nothing in that row: its residual and all its
derivatives are zero, as are those of a row that reads its change since itself, so that sums need not know of it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from copy import copy

import casadi as ca
import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.codegen.evaluation.gram import GramFunction
from truepose.errors import InputError
from truepose.identification.prediction.loops import Loops
from truepose.identification.prediction.port_kinematics import PortKinematics, twists_by
from truepose.identification.prediction.sensor_rows import Block, Sight, joined, sights
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.file.driver import PAYLOAD
from truepose.models.machine.assembly import displacement_of, load_scale
from truepose.models.machine.closure import solved
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.sensor import Channel, Comparison, Rows
from truepose.models.sensors.base import Sensor
from truepose.threads import in_order


def computed_displacements(model: SymbolicModel) -> ca.SX:
    """(k,) mm or rad, of the joints that formulas move; no number where a formula has no value."""
    machine, values = model.machine, model.values
    laws = [follower.law for follower in machine.mechanism.followers if follower.law is not None]
    q = model.moved if laws else {}
    own = {name: displacement_of(machine, name, values, q) for name in q}
    return ca.vertcat(ca.SX(0, 1), *(law.value(own, values, bounded=False) for law in laws))


def all_lost(machine: Machine, parts: Sequence[Mask | None], rows: int) -> Mask | None:
    """(rows, m) where a channel reads nothing, from those of every sensor; None where no reading was lost."""
    if all(part is None for part in parts):
        return None
    sizes = [len(sensor.channels) for sensor in machine.sensors]
    empty = (np.zeros((rows, size), dtype=np.bool_) for size in sizes)
    return np.hstack([none if part is None else part for part, none in zip(parts, empty, strict=True)])


def told(residual: Array, lost: Mask | None) -> Array:
    """(n,) how many channels of each row read something, at least one; ``residual`` (n, m)."""
    rows, channels = residual.shape
    return np.full(rows, float(channels)) if lost is None else np.maximum(channels - lost.sum(axis=1), 1.0)


def lost_of(sensor: Sensor, recording: Recording) -> Mask | None:
    """(n, m) the same of one sensor; None where it lost nothing, or its columns are not there."""
    if not sensor.columns or any(name not in recording.observations for name in sensor.columns):
        return None
    gone = np.column_stack([np.isnan(recording.observations[name]) for name in sensor.columns])
    return gone @ _depends(sensor).T if gone.any() else None


def _depends(sensor: Sensor) -> Mask:
    """(m, k) whether each channel depends on each column: all turns of a pose depend on all of its rotation vector."""
    count = len(sensor.columns)
    if sensor.compares:  # readings are taken off one by one
        return np.eye(count, dtype=np.bool_)
    world, reading = ca.SX.sym("world", 4, 4), ca.SX.sym("reading", count)
    names = [*(parameter.name for parameter in sensor.parameters), *sensor.reads]
    residual = sensor.residual(world, {name: ca.SX.sym(name) for name in names}, reading)
    pattern = ca.jacobian(residual, reading).sparsity()
    return np.asarray(ca.DM(pattern, 1.0).full() != 0, dtype=np.bool_)


BLOCK = 1024
"""Rows that are worked out together."""
WAVES_KEPT = 30_000_000
"""Most numbers that are kept of what does not change with p."""
FIT = 5
"""How often a fit visits each row, about."""


def require_sensor(machine: Machine) -> None:
    """Raises InputError for a machine of which nothing is read: there is nothing to predict, fit or plan."""
    if not machine.sensors:
        raise InputError(
            f"{machine.name}: sensor: found none, expected one in the machine file: nothing says what is read"
        )


class Predictor:
    """Residuals, poses and loads of one machine with some effects over one recording of n rows.

    ``visits``: how often each row will be evaluated (FIT in a fit), which decides whether compiling pays.
    Everywhere ``p`` (np,) are parameters and ``x`` (n, nx) passive coordinates; lengths are in mm, angles in rad.
    """

    def __init__(
        self,
        machine: Machine,
        recording: Recording,
        effects: Sequence[PlacedEffect] = (),
        *,
        ports: bool = False,
        visits: int = 1,
    ) -> None:
        self.machine = machine
        weighed = recording.driver(PAYLOAD) is not None
        self.model = symbolic_model(machine, effects, ports=ports, weighed=weighed)
        self._read(recording)
        m = self.model
        self.evaluations = visits * len(self.q)
        self.sums: dict[tuple[int, ...], GramFunction] = {}
        """Normal equations by free entries of p, where a fit has asked for them."""
        self._built: dict[str, BatchFunction] = {}
        """Of states, and of the gradients of energies by load case, where they were asked for."""
        self._loops = Loops(m, self.evaluations)
        computed = computed_displacements(m)
        self._computed = self._function("computed", [computed]) if computed.numel() else None
        self._pose = self._function("pose", [m.world])
        self._by_ports = PortKinematics.of(m, self.evaluations)
        if self._by_ports is None:
            tool, *further = ([world, *twists_by(world, m.x, m.p)] for world in m.worlds.values())
            outputs = [*tool, ca.jacobian(m.closure, m.x), ca.jacobian(m.closure, m.p)]
            outputs += [m.reading_shift, ca.jacobian(m.reading_shift, m.x), ca.jacobian(m.reading_shift, m.p)]
            outputs += itertools.chain.from_iterable(further)
            self._kinematics = self._function("kinematics", outputs)
        else:
            self._kinematics = self._by_ports.function
        self._sensors = sights(machine, m.names, self.evaluations)

    def _read(self, recording: Recording) -> None:
        self.recording, self.q = recording, recording.positions
        self._values: Array | None = None
        self.z = np.empty((len(self.q), len(self.model.drivers)))
        for k, name in enumerate(self.model.drivers):
            recorded = recording.driver(name)
            self.z[:, k] = self.model.z_home[k] if recorded is None else recorded
        self._lost = [lost_of(sensor, recording) for sensor in self.machine.sensors]
        differs = any(s.differs_from_row for s in self.machine.sensors)
        self.origin = _origin(recording) if differs else None

    def over(self, recording: Recording) -> Predictor:
        """The same functions over other rows."""
        other = copy(self)
        other._read(recording)
        return other

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Residual components of every sensor, in order."""
        return self.machine.channels

    @property
    def cautions(self) -> tuple[str, ...]:
        """Notes of the sensors on how they read this recording, and on what is evaluated more slowly than it could be."""
        told = [c for s in self.machine.sensors for c in s.cautions(self.recording.labels)]
        sensors = (f for s in self._sensors for f in s.functions)
        functions = (self._loops.closure, self._pose, self._kinematics, *sensors)
        slow = dict.fromkeys(f.engine.missed for f in functions if f.engine.missed)
        return (*told, *(f"{why}: evaluated by CasADi's virtual machine, more slowly" for why in slow))

    def assemble(
        self, p: Array, start: Array | None = None, *, follow: bool = True, larger: float = 1.0
    ) -> tuple[Array, Mask]:
        """Passive coordinates (n, nx) that close the loops, from ``start`` (n, nx), and which rows could be assembled.

        A row that reads the change since another needs both. Without ``follow`` rows out of Newton's reach are given up.
        ``larger``: by how much ``p`` has the machine larger than its file.
        """
        x, good = self._loops.assemble(self.q, self.z, p, start, follow=follow, larger=larger)
        if self._computed is not None:  # a formula has no value there: the root of a negative number
            good &= np.isfinite(self._computed(x, self.q, self.z, p)[0][..., 0]).all(axis=1)
        return x, good if self.origin is None else good & good[self.origin]

    def poses(self, p: Array, x: Array | None = None) -> tuple[Array, Mask]:
        """Sensor-frame poses of the tool (n, 4, 4), mm, and which rows (n,) could be assembled."""
        good = np.ones(len(self.q), dtype=bool)
        if x is None:
            x, good = self.assemble(p)
        return self._pose(x, self.q, self.z, p)[0], good

    def blocks(self, p: Array, x: Array, weight: Array | Mask | None = None) -> Iterator[Block]:
        """Whitened residuals and exact Jacobians, some rows at a time, so that memory stays flat.

        ``weight`` (n,): how much a row counts in a level that compared rows share, by default 1, for validation 0.
        """
        require_sensor(self.machine)
        comparisons = self.comparisons(weight)
        step = BLOCK if all(c is None for c in comparisons) else max(len(self.q), 1)
        self.warm()

        def block(start: int) -> Block:
            rows = slice(start, min(start + step, len(self.q)))
            return joined(rows, self.seen(self._sight(rows, p, x), p, rows, comparisons))

        return in_order(block, range(0, len(self.q), step))

    def seen(
        self, sight: Sight, p: Array, rows: slice, comparisons: Sequence[Comparison | None]
    ) -> list[Block]:
        """What each sensor makes of ``sight`` in some rows: whitened residuals and their derivatives."""
        every = zip(self._sensors, comparisons, self._lost, strict=True)
        return [f.block(sight, p, self.recording, rows, c, gone) for f, c, gone in every]

    @property
    def lost(self) -> Mask | None:
        """(n, m) channels that read nothing, because a reading was lost; None where none was."""
        return all_lost(self.machine, self._lost, len(self.q))

    def of_rows(self, rows: Index) -> Predictor:
        """The same for some rows, whose readings stand for themselves; what was compiled is shared."""
        part = copy(self)
        part.recording = self.recording.subset(rows)
        part.q, part.z = self.q[rows], self.z[rows]
        part._values = None if self._values is None else self._values[rows]
        part._lost = [None if gone is None else gone[rows] for gone in self._lost]
        return part

    def comparisons(self, weight: Array | Mask | None = None) -> list[Comparison | None]:
        """How each sensor compares rows of ``weight`` (n,); None where each reading depends on its own row alone."""
        counts = np.asarray(~self.recording.validation if weight is None else weight, dtype=float)
        rows = Rows(self.origin, self.recording.labels, counts, self.recording.files)
        return [sensor.comparison(rows) for sensor in self.machine.sensors]

    def columns(self, p: Array, x: Array) -> tuple[list[str], Array, Array, Array]:
        """Column names, predicted values (n, k), their Jacobian (n, k, np) and poses (n, 4, 4)."""
        require_sensor(self.machine)
        sight = self._sight(slice(0, len(self.q)), p, x)
        names = [name for s in self.machine.sensors for name in s.columns]
        pairs = zip(self._sensors, self.comparisons(), strict=True)
        parts = [f.prediction(sight, p, c) for f, c in pairs]
        values, slopes = np.hstack([v for v, _ in parts]), np.concatenate([j for _, j in parts], axis=1)
        return names, values, slopes, sight.pose

    def values(self, p: Array, x: Array) -> tuple[list[str], Array, Array]:
        """Column names, predicted values (n, k) and poses (n, 4, 4); some rows at a time."""
        require_sensor(self.machine)
        comparisons = self.comparisons()
        names = [name for s in self.machine.sensors for name in s.columns]
        step = BLOCK if all(c is None for c in comparisons) else max(len(self.q), 1)
        values, poses = [np.zeros((0, len(names)))], [np.zeros((0, 4, 4))]
        for start in range(0, len(self.q), step):
            sight = self._sight(slice(start, min(start + step, len(self.q))), p, x)
            pairs = zip(self._sensors, comparisons, strict=True)
            values.append(np.hstack([f.values(sight, p, c) for f, c in pairs]))
            poses.append(sight.pose)
        return names, np.concatenate(values), np.concatenate(poses)

    def self_compared(self, p: Array, x: Array) -> list[tuple[Array, Array]]:
        """Predictions of single rows and the compared values that follow, both (n, k), of each sensor that compares the machine
        with itself; units of its channels."""
        sight = self._sight(slice(0, len(self.q)), p, x)
        every = zip(self._sensors, self.comparisons(), strict=True)
        return [
            f.self_compared(sight, p, self.recording, c) for f, c in every if c and f.sensor.compares_itself
        ]

    def twists(self, p: Array, x: Array) -> tuple[Array, Array]:
        """Poses (n, 4, 4) and their total derivative by p as world twists (n, 6, np)."""
        sight = self._sight(slice(0, len(self.q)), p, x)
        return sight.pose, sight.whole_twist

    def states(self, p: Array, x: Array) -> dict[str, Array]:
        """(n,) values of what effects may ask of the present state, by name."""
        names = list(self.model.states)
        if not names:
            return {}
        if "states" not in self._built:
            self._built["states"] = self._function("states", [ca.vertcat(*self.model.states.values())])
        values = self._built["states"](x, self.q, self.z, p)[0][..., 0]
        return dict(zip(names, values.T, strict=True))

    def _function(self, name: str, outputs: list[ca.SX]) -> BatchFunction:
        m = self.model
        return BatchFunction(name, [m.x, m.q, m.z, m.p], outputs, rows=self.evaluations)

    def loads(self, p: Array, x: Array) -> dict[str, Array]:
        """Conjugate load (n,) of all that pulls, at every port and parameter, by load case and name: N or N m."""
        m = self.model
        known = {*self.machine.geometry, *self.machine.ports}
        at = [k for k, n in enumerate(m.names) if n in known]
        scale = [(k, m.names[i], load_scale(self.machine, m.names[i])) for k, i in enumerate(at)]
        out: dict[str, Array] = {}
        for case, energy in m.energies.items():
            if case not in self._built:
                slopes = [m.still.slope(energy, m.x).T, m.still.slope(energy, m.p)[at].T]
                self._built[case] = self._function("energy", slopes)
            vx, vp = self._built[case](x, self.q, self.z, p)
            force = -vp[:, 0, :]
            if x.shape[1]:
                gx, gp = self._kinematics(x, self.q, self.z, p)[3:5]
                multipliers = solved(gx.transpose(0, 2, 1), vx.transpose(0, 2, 1))[..., 0]
                force += np.einsum("nk,nkp->np", multipliers, gp[:, :, at])
            out |= {f"{case}{name}": force[:, k] / factor for k, name, factor in scale}
        return out

    def loads_at(self, names: Sequence[str], p: Array, x: Array) -> dict[str, Array]:
        """The same at some ports alone, some rows at a time; a name that has no load is left out."""
        found: dict[str, list[Array]] = {}
        for start in range(0, max(len(self.q), 1), BLOCK):
            rows = np.arange(start, min(start + BLOCK, len(self.q)))
            loads = self.of_rows(rows).loads(p, x[rows])
            for name in loads.keys() & set(names):
                found.setdefault(name, []).append(loads[name])
        return {name: np.concatenate(parts) for name, parts in found.items()}

    def warm(self) -> None:
        """Work out what all blocks share, before threads ask for it."""
        self._waves(slice(0, 0))

    def _waves(self, rows: slice) -> Array:
        """(n, f) what coefficients move their ports by, whatever p: worked out once where it takes little memory."""
        if self._by_ports is None:
            return np.zeros((0, 0))
        if len(self.q) * len(self._by_ports.column) > WAVES_KEPT:
            return self._by_ports.values(self.q[rows], self.z[rows])
        if self._values is None:
            self._values = self._by_ports.values(self.q, self.z)
        return self._values[rows]

    def _sight(self, rows: slice, p: Array, x: Array) -> Sight:
        """What the sensors have before them, with total derivatives by p."""
        if self._by_ports is not None:
            return self._by_ports.sight(self.q[rows], self.z[rows], p, self._waves(rows))
        every = self._kinematics(x[rows], self.q[rows], self.z[rows], p)
        (gx, gp, shift, sx, sp), seen = every[3:8], (*every[:3], *every[8:])
        by_p = solved(gx, gp) if x.shape[1] else None
        poses = {}
        for k, view in enumerate(self.model.worlds):
            pose, tx, tp = seen[3 * k : 3 * k + 3]
            poses[view] = (pose, tp if by_p is None else tp - tx @ by_p)
        return Sight.over(poses, shift[..., 0], sp if by_p is None else sp - sx @ by_p)


def _origin(recording: Recording) -> Index:
    """(n,) the row that each row's ``from`` names, among the rows at hand."""
    where = ", ".join(recording.files)
    if recording.from_row is None:
        raise InputError(f"{where}: column 'from': found none, expected one: a sensor reads changes")
    place = np.full(len(recording.whole), -1)
    place[recording.rows] = np.arange(len(recording))
    origin = place[recording.from_row]
    if (origin < 0).any():
        lost = recording.where(int(np.argmin(origin)))
        raise InputError(
            f"{lost}: column 'from': found a row that was left out, expected it among the rows used"
        )
    return origin
