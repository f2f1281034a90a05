"""What is seen without a fit: missing blocks, too few or repeated rows, joints that stand still, a sigma that replicates deny."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from truepose.identification.check.pair import Pair
from truepose.identification.check.result import Found
from truepose.identification.check.rig import Rig, Stand
from truepose.identification.recording.file import SLACK
from truepose.identification.recording.recording import Recording
from truepose.models.machine import Machine
from truepose.models.units import convert
from truepose.wording import joined, shortened

Array = NDArray[np.float64]
FAR = 5.0
"""How many times a stated sigma may differ from what readings say before it is worth a word."""
_FEWEST = 6


def bare(machine: Machine, recording: Recording) -> Iterator[Found]:
    """All that needs no fit."""
    yield from _too_few(machine, recording)
    yield from _duplicates(machine, recording)
    yield from _still(machine, recording)
    yield from _no_gravity(machine)


def _too_few(machine: Machine, recording: Recording) -> Iterator[Found]:
    free = sum(p.free for p in machine.parameters)
    used = int(np.sum(~recording.validation))
    readings = used * len(machine.channels)
    if readings < free:
        yield Found(
            "too-few-rows",
            ("rows",),
            f"{used} rows are {readings} readings for {free} constants with a tolerance: every misfit would look small",
            f"measure at least {int(np.ceil(2 * free / max(len(machine.channels), 1)))} poses, or state fewer tolerances",
            "wrong",
        )


def _duplicates(machine: Machine, recording: Recording) -> Iterator[Found]:
    """Rows that repeat another one to the last digit: no instrument reads so."""
    same = repeats(recording)
    if len(same):
        rows = [str(recording.source_row[k]) for k in same]
        yield Found(
            "duplicated-rows",
            ("rows",),
            f"{len(same)} rows repeat an earlier one to the last digit: rows {shortened(rows, 5)}",
            "take them out: they count twice",
            "suspect",
            mend=lambda pair: pair.each(lambda s: s.rows(_firsts(s.cells.to_numpy(dtype=str)))),
        )


def repeats(recording: Recording) -> NDArray[np.intp]:
    """Places of rows that repeat an earlier one in all that was logged; changes since a row itself do not count."""
    parts = [
        recording.q,
        *(v[:, None] for v in (*recording.observations.values(), *recording.drivers.values())),
    ]
    if not recording.observations:
        return np.zeros(0, dtype=np.intp)
    if recording.time is not None:
        parts.append(recording.time[:, None])
    seen = np.hstack(parts)
    told = np.abs(np.column_stack(list(recording.observations.values()))).max(axis=1) > 0
    first = set(_firsts(seen).tolist())
    return np.array([k for k in range(len(seen)) if k not in first and told[k]], dtype=np.intp)


def _firsts(cells: NDArray[np.generic]) -> NDArray[np.intp]:
    return np.sort(np.unique(cells, axis=0, return_index=True)[1])


def _still(machine: Machine, recording: Recording) -> Iterator[Found]:
    if len(recording) < _FEWEST:
        return
    still = [n for n, v in zip(recording.joints, recording.q.T, strict=True) if np.ptp(v) == 0.0]
    if still:
        verb = "never moves" if len(still) == 1 else "never move"
        yield Found(
            "joint-never-moves",
            tuple(still),
            f"{joined(still)} {verb}: nothing can be said of its constants",
            f"measure poses in which {joined(still)} moves, or take care not to read a result into its constants",
            "suspect",
        )


def out_of_range(machine: Machine, recording: Recording) -> Iterator[Found]:
    """Joints that leave their range, where no other slip explains it: a zero elsewhere if a shift brings all rows inside."""
    for a, q in zip(machine.mechanism.actuators, recording.q.T, strict=True):
        if a.range is None:
            continue
        low, high = a.range
        slack = SLACK * (high - low)
        bad = np.flatnonzero((q < low - slack) | (q > high + slack))
        if not len(bad):
            continue
        unit = machine.units.of_joint(a.reading_unit)
        found, ends = (
            convert(float(q[bad[0]]), a.reading_unit, unit),
            [convert(v, a.reading_unit, unit) for v in a.range],
        )
        says = f"{recording.where(int(bad[0]))}: {a.reading} is {found:.6g} {unit}, out of its range [{ends[0]:.6g}, {ends[1]:.6g}]"
        if np.ptp(q) <= (1.0 + 2.0 * SLACK) * (high - low):
            shift = convert((low + high) / 2 - (q.min() + q.max()) / 2, a.reading_unit, unit)
            says += f", and a zero elsewhere, by about {shift:+.3g} {unit}, would bring all rows inside"
        yield Found(
            "offset", (a.reading,), says, f"compare the zero, the unit and the range of {a.reading}", "wrong"
        )


def _no_gravity(machine: Machine) -> Iterator[Found]:
    if machine.gravity is None and machine.masses:
        yield Found(
            "no-gravity",
            ("gravity",),
            f"{len(machine.masses)} masses are stated and no gravity: what gives way under weight cannot be told",
            "add 'gravity: [0, 0, -9.80665]' (in the base frame) to the machine file",
            "suspect",
            mend=lambda pair: pair.with_field(("gravity",), [0.0, 0.0, -9.80665]),
        )


def no_tolerances(rig: Rig, stand: Stand) -> Iterator[Found]:
    """A drawing without tolerances: only frames would be fitted. Proposes such as would explain what is left."""
    machine = rig.machine
    if any(p.free for p in machine.mechanism.parameters) or not machine.mechanism.parameters:
        return
    size = float(f"{max(stand.length or 0.0, 0.01):.1g}")
    reach = (
        max((abs(p.nominal) for p in machine.mechanism.parameters if p.unit == "mm"), default=0.0) or 500.0
    )
    angle = float(f"{np.degrees(size / reach):.1g}")
    units = machine.units
    stated = {"length": convert(size, "mm", units.length), "angle": convert(angle, "deg", units.angle)}
    stated = {key: float(f"{value:.3g}") for key, value in stated.items()}
    yield Found(
        "no-tolerances",
        ("tolerances",),
        "no tolerance of the mechanism is stated: only base and tool would be fitted",
        f"state what the drawing allows, for example 'tolerances: {{length: {stated['length']:g}, angle: {stated['angle']:g}}}'",
        "suspect",
        mend=lambda pair: pair.with_field(("tolerances",), {**(pair.get(("tolerances",)) or {}), **stated}),
    )


def sigmas(rig: Rig, stand: Stand, price: float) -> Iterator[Found]:
    """Kinds of reading whose sigma is far from the scatter of replicates, or from all that is left."""
    for kind, (ratio, words) in _scatters(rig, stand, price).items():
        if ratio is None or 1.0 / FAR < ratio < FAR:
            continue
        channel = next(c for c in rig.machine.channels if c.kind == kind)
        size = float(f"{channel.sigma * ratio:.2g}")
        fields = _fields(kind)
        unit = rig.machine.units.written(channel.unit)
        yield Found(
            "sigma",
            (f"sensor.sigma.{fields}",),
            f"{words} by {size:.3g} {channel.unit}, sigma is stated as {channel.sigma:.3g} {channel.unit}",
            f"state sigma: {{{fields}: {convert(size, channel.unit, unit):.2g}}}",
            "suspect",
            channel.sigma,
            size,
            channel.unit,
            lambda pair, fields=fields, new=convert(size, channel.unit, unit): _mend_sigma(pair, fields, new),
        )


def _fields(kind: str) -> str:
    return {"position": "xyz", "rotation": "rot", "distance": "distance"}.get(kind, kind)


def _mend_sigma(pair: Pair, key: str, value: float) -> Pair:
    sensor = pair.get(("sensor",))
    heads = [("sensor", k) for k in range(len(sensor))] if isinstance(sensor, list) else [("sensor",)]
    for head in heads:
        if pair.get((*head, "sigma", key)) is not None:
            pair = pair.with_field((*head, "sigma", key), float(f"{value:.3g}"))
    return pair


def _scatters(rig: Rig, stand: Stand, price: float) -> dict[str, tuple[float | None, str]]:
    """By kind of reading: scatter over sigma of replicates; without any, what is left of the fit if that is too little."""
    kinds = list(dict.fromkeys(c.kind for c in rig.machine.channels))
    rows = _replicates(rig.recording)
    out: dict[str, tuple[float | None, str]] = {}
    if len(rows) >= 2:
        labels = np.concatenate([np.full(len(r), k) for k, r in enumerate(rows)])
        here = (
            rig.predictor.over(rig.recording.subset(np.concatenate(rows)))
            if not _differs(rig.machine)
            else None
        )
        if here is not None:
            x, good = here.assemble(stand.p, follow=False)
            residual = np.concatenate([b.residual for b in here.blocks(stand.p, x)])
            for kind in kinds:
                at = [k for k, c in enumerate(rig.machine.channels) if c.kind == kind]
                out[kind] = (_within(residual[:, at], labels, good), "replicates scatter")
    left = stand.residual
    for k, kind in enumerate(kinds):
        if kind not in out and price < 1.0 / FAR and len(left):
            out[kind] = (price, "everything that is left varies")
    return out


def _replicates(recording: Recording) -> list[NDArray[np.intp]]:
    """Places of rows at one reading of all joints, in one session, groups of two and more."""
    use = np.flatnonzero(~recording.validation)
    told = np.column_stack([recording.q[use], recording.session[use]]) + 0.0
    _, label, count = np.unique(told, axis=0, return_inverse=True, return_counts=True)
    label = label.reshape(-1)
    return [use[label == k] for k in np.flatnonzero(count >= 2)[:100]]


def _within(residual: Array, labels: NDArray[np.int64], good: NDArray[np.bool_]) -> float | None:
    """The middle of the groups' scatter; None where too few readings repeat."""
    sizes, spare = [], 0
    for k in np.unique(labels):
        own = residual[(labels == k) & good]
        own = own[np.isfinite(own).all(axis=1)]
        if len(own) >= 2:
            spare += (len(own) - 1) * own.shape[1]
            sizes.append(
                float(np.sqrt(np.sum((own - own.mean(axis=0)) ** 2) / ((len(own) - 1) * own.shape[1])))
            )
    return float(np.median(sizes)) if spare >= _FEWEST else None


def _differs(machine: Machine) -> bool:
    return any(s.differs_from_row or s.compares for s in machine.sensors)


__all__ = ["bare", "no_tolerances", "repeats", "sigmas"]
