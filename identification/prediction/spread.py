"""How far the model may be off, column by column: parameters, what no parameter explains, and rows that were never seen.

The variance of a column is J C J', C from the file's ``covariance:`` for what it names and from tolerances for the
rest; plus the square of what the fit left ``unexplained`` in that kind of reading; plus, outside of what was seen, what
forms without a name (``empirical``) and the errors of form of named effects may be there. What is unexplained of
rotations is that of a small turn; a column of a rotation vector near half a turn moves more than that.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.prediction.covariance import Covariance
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prior import FORM_ERROR
from truepose.models.effects.common import sensor_names
from truepose.models.effects.empirical import Empirical
from truepose.models.file.driver import PAYLOAD
from truepose.models.machine.machine import Machine
from truepose.models.machine.sensor import Sensor

LEAST_RANGE = 1e-6
"""Half of a range that is taken for a driver that was never varied."""


def column_std(predictor: Predictor, values: Array, jacobian: Array) -> Array:
    """(n, k) 1-sigma of the sensors' columns from their values (n, k) and derivatives by p (n, k, np)."""
    machine, p_sigma = predictor.machine, _stated(predictor)
    names = predictor.model.names
    variance = _beyond(predictor, values, jacobian)
    left = np.flatnonzero(p_sigma > 0)
    scales = np.array(
        [p.scale for p in machine.parameters] + [c.scale for e in machine.effects for c in e.coefficients]
    )
    known = _covariance(machine)
    if known is not None:
        missing = [name for name in known.names if name not in names]
        if missing:
            assert machine.file is not None
            raise InputError(
                f"{machine.file.path}: covariance.names: found {missing[0]!r}, no parameter of this machine"
            )
        at = np.array([names.index(name) for name in known.names], dtype=int)
        variance += known.std(jacobian[..., at], scales[at]) ** 2
        variance += np.where(np.any(jacobian != 0.0, axis=2), _unexplained(machine, known), 0.0)
        left = np.setdiff1d(left, at)
    stated = Covariance.of_tolerances([names[k] for k in left], p_sigma[left])
    return np.asarray(np.sqrt(variance + stated.std(jacobian[..., left], scales[left]) ** 2))


def _covariance(machine: Machine) -> Covariance | None:
    if machine.file is None or machine.file.covariance is None:
        return None
    return Covariance.read(machine.file.covariance, f"{machine.file.path}: covariance")


def _unexplained(machine: Machine, known: Covariance) -> Array:
    """(k,) variance of each column that no parameter explains."""
    out = []
    for name, sensor in zip(sensor_names(machine), machine.sensors, strict=True):
        own = {
            kind: known.unexplained.get(f"{name}.{kind}", (0.0, ""))[0] for kind in _kinds(sensor).values()
        }
        out += [own[_kinds(sensor)[unit]] ** 2 for unit in sensor.columns.values()]
    return np.array(out)


def _kinds(sensor: Sensor) -> dict[str, str]:
    """The kind of reading (position, rotation, distance) by unit; each sensor has one of a unit."""
    kinds = {channel.unit: channel.kind for channel in reversed(sensor.channels)}
    return {unit: kinds.get(unit, "") for unit in sensor.columns.values()}


def _beyond(predictor: Predictor, values: Array, jacobian: Array) -> Array:
    """(n, k) variance that effects have where they were not seen.

    Held at the end of its range, a form without a name of amplitude c is off by the change of a random curve of that
    size since there: variance 2 c^2 (1 - exp(-o)), o the overshoot in halves of the range. It grows like a random walk at
    once and ends at that of two values that know nothing of each other. So does the error of form of a named effect, a
    tenth of its signal, of which the fitted rows know nothing out there.
    """
    machine, model = predictor.machine, predictor.model
    at = dict(zip(model.readings, predictor.q.T, strict=True))
    at |= dict(zip(model.drivers, predictor.z.T, strict=True))
    columns = [name for sensor in machine.sensors for name in sensor.columns]
    at |= dict(zip(columns, values.T, strict=True))
    out, first = np.zeros(values.shape), len(machine.parameters)
    known = _covariance(machine)
    seen = {} if known is None else known.seen
    for effect in machine.effects:
        own = slice(first, first + len(effect.coefficients))
        first = own.stop
        over = effect.effect.overshoot(machine, effect.place, effect.settings_map, at)
        whole = over is not None or effect.effect.slug == Empirical.slug
        if over is None:
            weight = (PAYLOAD, *machine.force_columns) if effect.needs_load else ()
            over = _outside(seen, at, {*model.readings, *effect.drivers, *weight})
        signal = jacobian[..., own] * effect.amplitudes
        moved = np.sum(signal**2, axis=2) if whole else (FORM_ERROR * np.sum(signal, axis=2)) ** 2
        out += -2.0 * np.expm1(-over)[:, None] * moved
    return out


def _outside(
    seen: Mapping[str, tuple[float, float]], at: Mapping[str, Array], sources: Collection[str]
) -> Array:
    """(n,) how far values of sources lie outside of what was seen, in halves of each range; 0 where nothing is known."""
    out = np.zeros(len(next(iter(at.values()))))
    for name in sources:
        if name in seen and name in at:
            low, high = seen[name]
            half = max((high - low) / 2, LEAST_RANGE)
            out += np.maximum(np.abs(at[name] - (low + high) / 2) / half - 1.0, 0.0)
    return out


def _stated(predictor: Predictor) -> Array:
    """(np,) 1-sigma as the file states it: tolerances, and the ``std`` of effects."""
    machine = predictor.machine
    sigma = [parameter.tolerance for parameter in machine.parameters]
    specs = machine.file.effects if machine.file else ()
    for k, effect in enumerate(machine.effects):
        spec = specs[k] if k < len(specs) else None
        for c in effect.coefficients:
            own = (
                spec.std_of(c.name, c.unit)
                if spec is not None and spec.effect == effect.effect.slug
                else None
            )
            sigma.append(own or 0.0)
    return np.array(sigma)


__all__ = ["column_std"]
