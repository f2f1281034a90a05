"""Sensors over many rows at once: whitened residuals, predicted columns, and their exact derivatives.

Residuals of some rows and their derivatives, by columns or by the ports that coefficients follow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.errors import InputError
from truepose.identification.prediction.by_ports import ByPorts, Part
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.machine.machine import Machine
from truepose.models.machine.sensor import TOOL_IN_WORLD, View
from truepose.models.sensors.base import Comparison, Sensor
from truepose.threads import Cached

TOGETHER = 16_384
"""Rows of which wide matrices are held at a time, where one block after another would be slow. Cost alone."""


@dataclass(frozen=True)
class Block:
    """Some rows: residuals (n, m) whitened by sigma, and the derivative (n, k, np) of each row's prediction by p.

    ``dense`` (n, k, d): its columns at the places ``at`` (d,), all where that is None; the others follow ``ports``.
    Where a reading compares rows, ``compare`` turns changes (n, k, w) of the rows' predictions into changes
    (n, m, w) of the residuals; elsewhere the two are the same. ``lost`` (n, m): channels that read nothing there, whose
    residuals are zero and stay so.
    """

    rows: slice
    residual: Array
    dense: Array
    compare: Callable[[Array], Array] | None = None
    lost: Mask | None = None
    at: Index | None = None
    ports: ByPorts | None = None

    @Cached
    def here(self) -> Array:
        """(n, k, np) all columns."""
        return written_out(self.dense, self.at, self.ports)

    @Cached
    def jacobian(self) -> Array:
        """(n, m, np) derivative of the residual by p."""
        return self.changes(self.here)

    def changes(self, change: Array) -> Array:
        """(n, m, w) what changes (n, k, w) of the rows' predictions do to the residuals."""
        changed = change if self.compare is None else self.compare(change)
        return changed if self.lost is None else np.where(self.lost[..., None], 0.0, changed)

    def columns(self, wanted: Sequence[int]) -> Array:
        """(n, m, w) some columns of the jacobian, which are not those that follow ports."""
        if self.at is None:
            return self.jacobian[:, :, list(wanted)]
        return self.changes(self.dense[:, :, np.searchsorted(self.at, list(wanted))])

    def part(self, rows: Index, place: Index, scale: Array, weight: Array) -> Part | None:
        """[J r] of some of its rows, p at the columns ``place`` (np,) (-1: left out) in steps of ``scale`` (np,), r last; rows
        weighed by ``weight`` (k,). None where nothing follows ports."""
        if self.ports is None or self.at is None:
            return None
        root = weight[:, None, None]
        kept, by = place[self.at] >= 0, self.ports.of_columns(place[self.ports.column] >= 0)
        by = by if len(rows) == len(self.residual) else by.of_rows(rows)
        own = self.dense[rows][:, :, kept] * scale[self.at[kept]]
        dense = np.concatenate([own, self.residual[rows][..., None]], axis=2) * root
        at = np.append(place[self.at[kept]], int(place.max()) + 1)
        return Part(dense, at, by.scaled(root, scale[by.column], place[by.column]))


def written_out(dense: Array, at: Index | None, ports: ByPorts | None) -> Array:
    """(n, k, w) all columns side by side."""
    if ports is None or at is None:
        return dense
    out = np.empty((*dense.shape[:2], len(at) + len(ports.column)))
    out[:, :, at] = dense
    ports.put_into(out)
    return out


def joined(rows: slice, parts: Sequence[Block]) -> Block:
    """The blocks of several sensors side by side."""
    residual = np.concatenate([part.residual for part in parts], axis=1)
    alike = all(part.compare is None and part.ports is not None for part in parts)
    dense = np.concatenate([part.dense if alike else part.here for part in parts], axis=1)
    lost = None
    if any(part.lost is not None for part in parts):
        none = (np.zeros(p.residual.shape, dtype=bool) for p in parts)
        lost = np.hstack([n if p.lost is None else p.lost for p, n in zip(parts, none, strict=True)])
    if alike:
        slopes = np.concatenate([part.ports.slopes for part in parts if part.ports is not None], axis=1)
        first = parts[0]
        ports = None if first.ports is None else first.ports.with_slopes(slopes)
        return Block(rows, residual, dense, lost=lost, at=first.at, ports=ports)
    if all(part.compare is None for part in parts):
        return Block(rows, residual, dense, lost=lost)
    ends = np.cumsum([part.here.shape[1] for part in parts])[:-1]

    def compare(change: Array) -> Array:
        pieces = zip(parts, np.split(change, ends, axis=1), strict=True)
        return np.concatenate([part.changes(piece) for part, piece in pieces], axis=1)

    return Block(rows, residual, dense, compare, lost)


@dataclass(frozen=True)
class Sight:
    """What sensors have before them in some rows, with derivatives by w unknowns.

    pose (n, 4, 4) of the tool, twist (n, 6, w) its derivative; shift (n, k) of all sensors' columns by effects,
    shift_by (n, k, w) its derivative; further: pose and twist of other tips and sensors that ride on the machine. Where
    coefficients follow ``ports`` (of the tool alone), w are the unknowns ``at`` (w,) of p alone, and the slopes of ports
    (n, 6 + k, ports) are those of both.
    """

    pose: Array
    twist: Array
    shift: Array
    shift_by: Array
    further: Mapping[View, tuple[Array, Array]] = field(default_factory=dict)
    at: Index | None = None
    ports: ByPorts | None = None

    def of(self, view: View) -> tuple[Array, Array]:
        """Pose (n, 4, 4) of a view's tip in the frame of its readings, and its derivative (n, 6, w)."""
        return (self.pose, self.twist) if view == TOOL_IN_WORLD else self.further[view]

    @classmethod
    def over(cls, poses: Mapping[View, tuple[Array, Array]], shift: Array, shift_by: Array) -> Sight:
        """Of all views, the tool's among them."""
        return cls(*poses[TOOL_IN_WORLD], shift, shift_by, poses)

    @property
    def whole_twist(self) -> Array:
        """(n, 6, np) derivative of the pose by all of p."""
        by = None if self.ports is None else self.ports.with_slopes(self.ports.slopes[:, :6])
        return written_out(self.twist, self.at, by)


def sights(machine: Machine, names: Sequence[str], rows: int) -> list[SensorFunctions]:
    """Functions of every sensor, for ``rows`` rows; ``names`` are the entries of p."""
    out, first = [], 0
    for sensor in machine.sensors:
        out.append(SensorFunctions(sensor, names, slice(first, first + len(sensor.columns)), rows))
        first += len(sensor.columns)
    return out


class SensorFunctions:
    """One sensor as functions of the pose of its tip; ``names`` are the entries of p.

    ``columns`` are its own among those of all sensors; ``functions`` are for ``rows`` rows.
    """

    def __init__(self, sensor: Sensor, names: Sequence[str], columns: slice, rows: int) -> None:
        self.sensor, self._columns = sensor, columns
        own = [*(parameter.name for parameter in sensor.parameters), *sensor.reads]
        self._own = np.array([names.index(name) for name in own], dtype=int)
        self._sigma = np.array([channel.sigma for channel in sensor.channels])
        world, small = ca.SX.sym("world", 4, 4), ca.SX.sym("twist", 6)
        s, y = {name: ca.SX.sym(name) for name in own}, ca.SX.sym("y", len(sensor.columns))
        moved = lie.transform(world[:3, :3] + lie.skew(small[3:]) @ world[:3, :3], world[:3, 3] + small[:3])
        inputs = [ca.vec(world), ca.vertcat(*s.values()) if s else ca.SX(0, 1), y]
        predicted = sensor.predict(moved, s)
        predicted = predicted + y if sensor.columns else predicted
        self._predict = _differentiated("predict", predicted, inputs, small, rows)
        self.functions = [self._predict]
        compared = predicted
        if not sensor.compares:
            # what an effect adds to a reading is taken off the reading: no sensor need know of it
            compared = sensor.residual(moved, s, y)
            self._residual = _differentiated("residual", compared, inputs, small, rows)
            self.functions.append(self._residual)
        self._bare = (compared, inputs, small, rows)

    @cached_property
    def _alone(self) -> BatchFunction:
        value, inputs, small, rows = self._bare
        return BatchFunction("alone", inputs, [ca.substitute(value, small, ca.SX.zeros(6))], rows=rows)

    def block(
        self,
        sight: Sight,
        p: Array,
        recording: Recording,
        rows: slice,
        comparison: Comparison | None,
        lost: Mask | None = None,
    ) -> Block:
        """Whitened residuals of what is seen in ``rows``, with their derivatives by the parameters p (np,).

        ``lost`` (n, m) are channels of all rows that read nothing.
        """
        gone = None if lost is None else lost[rows]
        y = self._read(recording, rows)
        if comparison is None:
            self._check_labels(recording)
            found = self._evaluate(self._residual, sight, p, np.nan_to_num(y), -1.0)
            return _block(rows, found.scaled(1.0 / self._sigma), sight.at, gone)
        raw, jacobian = self._evaluate(self._predict, sight, p, np.zeros_like(y), 1.0).whole(sight.at)
        raw = raw + self._offset(recording, rows)

        def compare(change: Array) -> Array:
            out: Array = comparison.changes(raw, change) / self._sigma[:, None]
            return out

        compared = self._compared(comparison, raw, y) / self._sigma
        residual = compared if gone is None else np.where(gone, 0.0, compared)
        return Block(rows, residual, jacobian, compare, gone if gone is not None and gone.any() else None)

    def residual(
        self, pose: Array, p: Array, recording: Recording, comparison: Comparison | None, lost: Mask | None
    ) -> Array:
        """The residuals (n, m) of ``block`` alone, of all rows of a recording, where no effect adds to a reading."""
        y = self._read(recording, slice(0, len(pose)))
        given = np.nan_to_num(y) if comparison is None else np.zeros_like(y)
        (found,) = self._alone(_flat(pose), p[self._own], given)
        raw = found[..., 0]
        if comparison is not None:
            raw = self._compared(comparison, raw + self._offset(recording, slice(0, len(pose))), y)
        return raw / self._sigma if lost is None else np.where(lost, 0.0, raw / self._sigma)

    def self_compared(
        self, sight: Sight, p: Array, recording: Recording, comparison: Comparison
    ) -> tuple[Array, Array]:
        """Predictions of single rows without the effect of reading errors, and the compared values, both (n, k)."""
        raw = self._predicted(sight, p).values
        return raw, comparison.values(raw + self._offset(recording, slice(0, len(raw))))

    def _offset(self, recording: Recording, rows: slice) -> Array | float:
        """What the errors of the joints' readings add to the predictions of single rows, shape (n, k)."""
        names = [channel.name for channel in self.sensor.channels]
        if not self.sensor.compares_itself or any(name not in recording.observations for name in names):
            return 0.0
        return np.column_stack([recording.observations[name][rows] for name in names])

    def _read(self, recording: Recording, rows: slice) -> Array:
        """(n, k) of the sensor's columns; none where it reads none."""
        columns = [recording.observations[c][rows] for c in self.sensor.columns]
        return np.column_stack(columns) if columns else np.zeros((len(recording.q[rows]), 0))

    def _compared(self, comparison: Comparison, raw: Array, y: Array) -> Array:
        values = comparison.values(raw)
        return values - y if self.sensor.columns else values

    def _check_labels(self, recording: Recording) -> None:
        missing = [name for name in self.sensor.label_columns if name not in recording.labels]
        if missing:
            raise InputError(
                f"{', '.join(recording.files)}: missing column {missing[0]!r}, which the sensor {self.sensor.type} needs"
            )

    def prediction(self, sight: Sight, p: Array, comparison: Comparison | None) -> tuple[Array, Array]:
        """(n, k) values of the sensor's columns and their (n, k, np) Jacobian."""
        value, jacobian = self._predicted(sight, p).whole(sight.at)
        if not self.sensor.columns:
            return np.zeros((len(value), 0)), np.zeros((len(value), 0, len(p)))
        changes = jacobian if comparison is None else comparison.changes(value, jacobian)
        return self._as_read(sight, value, comparison), changes

    def values(self, sight: Sight, p: Array, comparison: Comparison | None) -> Array:
        """(n, k) values of the sensor's columns."""
        value = self._predicted(sight, p).values
        return self._as_read(sight, value, comparison) if self.sensor.columns else np.zeros((len(value), 0))

    def _predicted(self, sight: Sight, p: Array) -> _Seen:
        y = np.zeros((len(sight.pose), len(self.sensor.columns)))
        return self._evaluate(self._predict, sight, p, y, 1.0)

    def _as_read(self, sight: Sight, value: Array, comparison: Comparison | None) -> Array:
        if comparison is not None:
            return comparison.values(value)
        shift = sight.shift[:, self._columns]
        return self.sensor.values(sight.of(self.sensor.view)[0], value - shift) + shift

    def _evaluate(self, function: BatchFunction, sight: Sight, p: Array, y: Array, sign: float) -> _Seen:
        """Values and derivatives at ``y`` plus ``sign`` times what effects add to the columns."""
        y = y + sign * sight.shift[:, self._columns]
        pose, twist = sight.of(self.sensor.view)
        value, by_twist, by_own, by_y = function(_flat(pose), p[self._own], y)
        own = self._own if sight.at is None else np.searchsorted(sight.at, self._own)
        jacobian = by_twist @ twist
        jacobian[:, :, own] += by_own
        jacobian += sign * (by_y @ sight.shift_by[:, self._columns])
        if sight.ports is None:
            return _Seen(value[..., 0], jacobian, None)
        by_twists, by_shifts = sight.ports.slopes[:, :6], sight.ports.slopes[:, 6:][:, self._columns]
        slopes = by_twist @ by_twists + sign * (by_y @ by_shifts)
        return _Seen(value[..., 0], jacobian, sight.ports.with_slopes(slopes))


@dataclass(frozen=True)
class _Seen:
    """Values (n, m) of a sensor and their derivatives: columns (n, m, w), and those that follow ports."""

    values: Array
    dense: Array
    ports: ByPorts | None

    def scaled(self, factor: Array) -> _Seen:
        """All of it times ``factor`` (m,)."""
        by = factor[:, None]
        ports = None if self.ports is None else self.ports.with_slopes(self.ports.slopes * by)
        return _Seen(self.values * factor, self.dense * by, ports)

    def whole(self, at: Index | None) -> tuple[Array, Array]:
        """Values and all columns of the derivative."""
        return self.values, written_out(self.dense, at, self.ports)


def _flat(pose: Array) -> Array:
    """(n, 16) of poses (n, 4, 4), column by column."""
    return pose.transpose(0, 2, 1).reshape(len(pose), 16)


def _block(rows: slice, seen: _Seen, at: Index | None, lost: Mask | None) -> Block:
    """The block, with nothing where a reading was lost."""
    if lost is None or not lost.any():
        return Block(rows, seen.values, seen.dense, at=at, ports=seen.ports)
    gone = lost[..., None]
    ports = seen.ports and seen.ports.with_slopes(np.where(gone, 0.0, seen.ports.slopes))
    dense, values = np.where(gone, 0.0, seen.dense), np.where(lost, 0.0, seen.values)
    return Block(rows, values, dense, lost=lost, at=at, ports=ports)


def _differentiated(name: str, value: ca.SX, inputs: list[ca.SX], small: ca.SX, rows: int) -> BatchFunction:
    """The value with its derivatives by a small twist of the pose, the sensor's constants and its columns."""
    outputs = [value, *(ca.jacobian(value, by) for by in (small, inputs[1], inputs[2]))]
    still = [ca.substitute(output, small, ca.SX.zeros(6)) for output in outputs]
    return BatchFunction(name, inputs, still, rows=rows)
