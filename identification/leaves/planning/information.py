"""What a pose would tell about a machine's constants, and how that changes with the joints, exactly.

``PoseInformation`` evaluates the derivative of the readings by the constants (readings in sigmas, constants in
tolerances) at any joint values, and pulls a cotangent of it back to the joints: with it the gradient of any
criterion of the information costs about as much as the criterion. Loops are closed by the Predictor; what they
do to both derivatives follows from the implicit function theorem.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.errors import InputError
from truepose.identification.fit.problem import prior_of
from truepose.identification.prediction.predictor import Predictor, require_sensor
from truepose.identification.recording.recording import Recording, frozen
from truepose.models import lie
from truepose.models.machine.closure import coordinate_scale
from truepose.models.machine.kinematics import SymbolicModel
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import coupling_matrix
from truepose.models.machine.sensor import Sensor, View
from truepose.models.sensors.pose import Pose
from truepose.models.units import convert

# -- What a pose would tell about a machine's constants, and how that changes with the joints, exactly

UNKNOWN = 1e3
"""A constant of unknown tolerance counts as known to so many of its natural sizes."""


@dataclass(frozen=True)
class Poses:
    """Joint values q (n, nq), loop coordinates x (n, nx), signature (n, m, k): derivative of the readings of
    the single poses by the constants, in sigmas per tolerance; good (n,): poses that can be assembled;
    amplification (n,): how strongly the loops react to the constants, without a unit (0 without loops)."""

    q: Array
    x: Array
    signature: Array
    good: Mask
    amplification: Array

    def within(self, strongest: float) -> Mask:
        """(n,) poses that can be assembled and are not next to a singularity."""
        return np.asarray(self.good & (self.amplification <= strongest))

    def take(self, rows: Index | Mask) -> Poses:
        """Poses by number (k,) or by mask (n,)."""
        return Poses(*(getattr(self, one.name)[rows] for one in fields(self)))


class PoseInformation:
    """A machine with the effects of its file, at its file's values.

    low, high (nq,) ranges of the readings; names (k,) constants that are not exactly known; weight (k,) what
    their tolerances say, in tolerances; differs (m,) readings that are changes since the pose before.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        require_sensor(machine)
        self.low, self.high = _ranges(machine)
        for sensor in machine.sensors:
            _refuse_unplannable(sensor, machine)
        prior = prior_of(machine, machine.effects)
        self._free, self._scale = prior.free, prior.scale[prior.free]
        self.names = tuple(prior.names[k] for k in self._free)
        sigma = np.minimum(prior.sigma[self._free], UNKNOWN * self._scale)
        self.weight = self._scale / sigma
        here = unmeasured(machine, self.home[None], "planned poses")
        self._predictor = Predictor(machine, here, machine.effects)
        self.differs = np.array(
            [sensor.differs_from_row for sensor in machine.sensors for _ in sensor.channels], dtype=bool
        )
        model = self._predictor.model
        scale = coordinate_scale(machine, len(model.home), model.gap.numel())
        self._size = np.where(np.isfinite(scale.limit), scale.size, np.inf)  # leg forces are no coordinates
        self._functions()

    @property
    def span(self) -> Array:
        """(nq,) widths of the ranges, 1 where a joint is held."""
        width = self.high - self.low
        return np.where(width > 0.0, width, 1.0)

    @property
    def home(self) -> Array:
        """(nq,) the middle of the ranges."""
        return np.asarray(0.5 * (self.low + self.high))

    def at(self, q: Array) -> Poses:
        """Assemble and evaluate poses q (n, nq)."""
        x, good = self._assemble(q)
        safe = np.where(good[:, None], x, self._predictor.model.home)
        by_constants, by_x, gx, gt, _ = self._pieces(safe, q)
        signature, amplification = by_constants, np.zeros(len(q))
        if x.shape[1]:
            coordinates = self._coordinates(gx, gt, good)
            signature = by_constants + by_x @ coordinates
            amplification = np.linalg.norm(coordinates / self._size[:, None], axis=(1, 2))
        good = good & np.isfinite(signature).all(axis=(1, 2))
        return Poses(q, x, np.where(good[:, None, None], signature, 0.0), good, amplification)

    def pull(self, poses: Poses, cotangent: Array) -> Array:
        """(n, nq) derivative by the joints of the sum of ``cotangent`` (n, m, k) times the signatures.

        Along the loops' solution: X = -gx^-1 gt are the coordinates' derivatives by the constants, and the
        multipliers of the equations that define X and x carry the derivatives through.
        """
        n, k, nx = len(cotangent), cotangent.shape[2], poses.x.shape[1]
        _, by_x, gx, gt, gq = self._pieces(poses.x, poses.q)
        coordinates = multipliers = np.zeros((n, nx, k))
        if nx:
            coordinates = self._coordinates(gx, gt, poses.good)
            right = by_x.transpose(0, 2, 1) @ cotangent
            multipliers = np.asarray(-np.linalg.solve(gx.transpose(0, 2, 1), right), dtype=float)
        flat = [a.transpose(0, 2, 1).reshape(n, -1) for a in (cotangent, coordinates, multipliers)]
        sx, sq = self._adjoint(poses.x, poses.q, *flat)
        out = sq[:, 0]
        if nx:
            carried = np.linalg.solve(gx.transpose(0, 2, 1), sx.transpose(0, 2, 1))
            out = out - (gq.transpose(0, 2, 1) @ carried)[..., 0]
        return np.asarray(out)

    def rows(self, signature: Array) -> Array:
        """(n, m, k) Jacobian of a sequence of poses: readings that differ lose the pose before.

        The first pose has nothing to differ from.
        """
        if not self.differs.any():
            return signature
        before = np.concatenate([signature[:1], signature[:-1]])
        return np.asarray(signature - np.where(self.differs[:, None], before, 0.0))

    def pulled_rows(self, cotangent: Array) -> Array:
        """(n, m, k) cotangent of the signatures from one of ``rows``."""
        if not self.differs.any():
            return cotangent
        later = np.where(self.differs[:, None], cotangent, 0.0)
        out = cotangent.copy()
        out[:-1] -= later[1:]
        out[0] -= later[0]
        return out

    def _assemble(self, q: Array) -> tuple[Array, Mask]:
        predictor = copy.copy(self._predictor)
        predictor.q, predictor.origin = q, None
        predictor.z = np.tile(predictor.model.z_home, (len(q), 1))
        return predictor.assemble(predictor.model.p_home)

    @staticmethod
    def _coordinates(gx: Array, gt: Array, good: Mask) -> Array:
        """(n, nx, k) derivative of the loop coordinates by the constants; zero where not good."""
        inside = np.where(good[:, None, None], gx, np.eye(gx.shape[1]))
        return np.asarray(-np.linalg.solve(inside, gt))

    def _functions(self) -> None:
        """Compile the signature's pieces and the derivative of a cotangent's product with them."""
        model = self._predictor.model
        t = ca.SX.sym("t", len(self._free))
        spread = np.zeros((len(model.names), len(self._free)))
        spread[self._free, np.arange(len(self._free))] = self._scale
        p = ca.DM(model.p_home) + ca.sparsify(ca.DM(spread)) @ t
        worlds, closure, added, values = _with(model, p)
        by_t, by_x = (
            ca.vertcat(*(_by(s, worlds[s.view], values, added, v) for s in model.machine.sensors))
            for v in (t, model.x)
        )
        gx, gq = ca.jacobian(closure, model.x), ca.jacobian(closure, model.q)
        here = [by_t, by_x, gx, ca.jacobian(closure, t), gq]
        here = [ca.substitute(e, t, ca.SX.zeros(t.numel())) for e in here]
        self._pieces = BatchFunction("pieces", [model.x, model.q], here)
        m, k, nx = by_t.shape[0], t.numel(), model.x.numel()
        w, coordinates, multipliers = ca.SX.sym("w", m, k), ca.SX.sym("X", nx, k), ca.SX.sym("l", nx, k)
        product = _dot(w, here[0])
        if nx:
            product += _dot(w, here[1] @ coordinates) + _dot(multipliers, here[2] @ coordinates + here[3])
        outputs = [ca.gradient(product, model.x).T, ca.gradient(product, model.q).T]
        symbols = [model.x, model.q, ca.vec(w), ca.vec(coordinates), ca.vec(multipliers)]
        self._adjoint = BatchFunction("adjoint", symbols, outputs)


def _dot(a: ca.SX, b: ca.SX) -> ca.SX:
    return ca.dot(a, ca.densify(b))


def _with(
    model: SymbolicModel, p: ca.SX
) -> tuple[dict[View, ca.SX], ca.SX, dict[str, ca.SX], dict[str, ca.SX]]:
    """What sensors see, by view, closure, and what is added to each column, with constants ``p`` and drivers at their defaults;
    constants by name."""
    home = ca.DM(model.z_home) if len(model.z_home) else ca.DM(0, 1)
    *seen, closure, added = (
        ca.substitute(ca.substitute(e, model.z, ca.SX(home)), model.p, p)
        for e in (*model.worlds.values(), model.closure, model.reading_shift)
    )
    worlds = dict(zip(model.worlds, seen, strict=True))
    columns = [column for sensor in model.machine.sensors for column in sensor.columns]
    by_column = {column: added[k] for k, column in enumerate(columns)}
    return worlds, closure, by_column, {name: p[k] for k, name in enumerate(model.names)}


def _by(
    sensor: Sensor, world: ca.SX, values: Mapping[str, ca.SX], added: Mapping[str, ca.SX], variables: ca.SX
) -> ca.SX:
    """(m, v) derivative of one sensor's readings, in sigmas, by ``variables`` of the pose and the constants."""
    names = [*(parameter.name for parameter in sensor.parameters), *sensor.reads]
    s = {name: values[name] for name in names}
    sigma = ca.DM([1.0 / channel.sigma for channel in sensor.channels])
    if isinstance(sensor, Pose):
        # the residual's rotation is seen from the tool; turned into the world it has the same information
        turns = [ca.jacobian(world[:3, k], variables) for k in range(3)]
        spin = sum((0.5 * lie.skew(world[:3, k]) @ turn for k, turn in enumerate(turns)), ca.SX(0))
        out = ca.vertcat(ca.jacobian(world[:3, 3], variables), spin)
    elif sensor.joints:
        read = ca.vertcat(*(added[column] for column in sensor.columns))
        out = ca.jacobian(sensor.predict(world, s) + read, variables)
    elif type(sensor).residual is Sensor.residual:
        out = ca.jacobian(sensor.predict(world, s), variables)
    else:
        out = _by_residual(sensor, world, s, variables)
    scaled: ca.SX = ca.diag(sigma) @ out
    return scaled


def _by_residual(sensor: Sensor, world: ca.SX, s: Mapping[str, ca.SX], variables: ca.SX) -> ca.SX:
    """The same of a sensor with a residual of its own, taken where prediction and reading agree."""
    moved, own = ca.SX.sym("moved", 4, 4), {name: ca.SX.sym(name) for name in s}
    reading = sensor.predict(world, s)
    residual = sensor.residual(moved, own, reading)
    inner = ca.vertcat(ca.vec(moved), *own.values())
    outer = ca.vertcat(ca.vec(world), *s.values())
    out: ca.SX = ca.substitute(ca.jacobian(residual, inner), inner, outer) @ ca.jacobian(outer, variables)
    return out


def _ranges(machine: Machine) -> tuple[Array, Array]:
    actuators = machine.mechanism.actuators
    for actuator in actuators:
        if actuator.reading_range is None:
            raise InputError(
                f"{machine.name}: joint {actuator.reading!r}: found no range, expected `range: [low, high]`: "
                "poses are chosen inside the ranges"
            )
    ranges = np.array([actuator.reading_range for actuator in actuators], dtype=float).reshape(-1, 2)
    return ranges[:, 0], ranges[:, 1]


def _refuse_unplannable(sensor: Sensor, machine: Machine) -> None:
    if (sensor.compares and not sensor.differs_from_row) or sensor.label_columns:
        raise InputError(
            f"{machine.name}: sensor {sensor.type!r}: its readings depend on how several rows are grouped; "
            "expected a sensor that reads single poses or changes since the pose before"
        )


def unmeasured(
    machine: Machine, q: Array, file: str, made: type[Recording] = Recording, **more: Any
) -> Recording:
    """Return rows of joint values (n, nq) in memory, each after the one before: of one session, without readings.

    ``more``: fields of ``made`` that are otherwise.
    """
    n = len(q)
    rows = np.arange(n)
    usual: dict[str, Any] = {
        "drivers": {},
        "session": frozen(np.ones(n, dtype=np.int64)),
        "session_recorded": frozen(np.zeros(n, dtype=bool)),
        "from_row": frozen(np.maximum(rows - 1, 0)),
    }
    return made(
        joints=machine.mechanism.readings,
        uncoupling=coupling_matrix(machine.mechanism),
        q=frozen(q.copy()),
        observations={},
        labels={},
        files=(file,),
        source_file=frozen(np.zeros(n, dtype=np.int64)),
        source_row=frozen(rows + 1),
        validation=frozen(np.zeros(n, dtype=bool)),
        pose=frozen(rows + 1),
        shuffled=True,
        **{**usual, **more},
    )


# -- Planned joint values in the units of the machine file, rounded inside their ranges


def rounded(q: Array, machine: Machine, step: float) -> Array:
    """Joint values (n, nq) rounded to about ``step`` of their range in the file's units, never out of it."""
    out = q.copy()
    for k, actuator in enumerate(machine.mechanism.actuators):
        if actuator.range is None:
            continue
        unit = machine.column_unit(actuator.reading)
        low, high = (convert(end, actuator.reading_unit, unit) for end in actuator.range)
        places = decimals(np.array([high - low]), step)
        values = np.round(convert(q[:, k], actuator.reading_unit, unit), places)
        out[:, k] = np.clip(convert(values, unit, actuator.reading_unit), *actuator.range)
    return out


def decimals(values: Array, step: float) -> int:
    """Decimals that resolve ``step`` of the largest of ``values`` (n,); 0 where all are zero."""
    if not np.any(values):
        return 0
    return int(np.ceil(-np.log10(step * float(np.max(np.abs(values))))))


# -- Where planned poses come from: candidates inside the joints' ranges, and random sets of poses

CANDIDATES = 600
STRONG = 3.0
"""Loops that react so many times more strongly to the constants than those of the median pose: the pose is on the
way to a singularity, where every criterion is drawn and a real machine should not go."""
_ROUNDS = 50


@dataclass(frozen=True)
class Supply:
    """Candidates ``poses`` that can be assembled, none next to a singularity (``strongest``).

    given: they are the user's; left_out: how many of those were no use.
    """

    information: PoseInformation
    poses: Poses
    strongest: float
    given: bool
    left_out: int

    @classmethod
    def of(cls, information: PoseInformation, given: Array | None, rng: np.random.Generator) -> Supply:
        """The given poses (c, nq), or half drawn inside the ranges, half of low, middle and high joint values."""
        q = given
        if q is None:
            q = np.concatenate([_uniform(information, CANDIDATES // 2, rng), _levels(information, rng)])
        poses = information.at(q)
        strongest = STRONG * float(np.median(poses.amplification[poses.good])) if poses.good.any() else 0.0
        use = poses.within(strongest)
        if not use.any():
            raise InputError(
                f"{information.machine.name}: found no pose among {len(q)} in which the mechanism can be assembled, "
                "expected ranges of the joints that it can reach"
            )
        left_out = 0 if given is None else int(np.sum(~use))
        return cls(information, poses.take(use), strongest, given is not None, left_out)

    def draw(self, n: int, rng: np.random.Generator) -> Poses:
        """``n`` random poses: uniform inside the ranges, or some of the given ones (each once, if there are enough)."""
        if self.given:
            return self.poses.take(rng.choice(len(self.poses.q), n, replace=n > len(self.poses.q)))
        found = np.empty((0, len(self.information.low)))
        for _ in range(_ROUNDS):
            poses = self.information.at(_uniform(self.information, n, rng))
            found = np.concatenate([found, poses.q[poses.within(self.strongest)]])
            if len(found) >= n:
                return self.information.at(found[:n])
        raise InputError(
            f"{self.information.machine.name}: found {len(found)} of {n * _ROUNDS} random poses in which the mechanism "
            "can be assembled, expected narrower ranges of the joints"
        )


def _uniform(information: PoseInformation, n: int, rng: np.random.Generator) -> Array:
    return rng.uniform(information.low, information.high, (n, len(information.low)))


def _levels(information: PoseInformation, rng: np.random.Generator) -> Array:
    """Poses whose joints stand low, in the middle or high: all of them, or some where there are too many."""
    joints, wanted = len(information.low), CANDIDATES // 2
    if 3**joints <= wanted:
        shares = np.array(list(product((0.0, 0.5, 1.0), repeat=joints)))
    else:
        shares = np.unique(rng.integers(0, 3, (wanted, joints)), axis=0) / 2.0
    return np.asarray(information.low + shares * (information.high - information.low))
