"""Compare a stated sigma with what replicates say of it or, without any, with all that a fit leaves."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from truepose.arrays import Array, Index, Mask
from truepose.identification.leaves.check.bare import FEWEST, repeats
from truepose.identification.leaves.check.pair import Pair, Stand
from truepose.identification.leaves.check.result import Found
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.recording.recording import Recording
from truepose.models.file.driver import APPROACH, PAYLOAD, Driver
from truepose.models.units import convert

SIGMA_FAR = 10.0
"""How many times a stated sigma may differ from what readings say before it is worth a word."""
ROUNDING = 1e-9
"""Share of a stated sigma that arithmetic leaves where a fit meets every reading: it says nothing of a sensor."""
_MOST_GROUPS = 100


def sigmas(rig: Rig, stand: Stand, price: float) -> Iterator[Found]:
    """Kinds of reading whose sigma is far from the scatter of replicates, or from all that is left."""
    for kind, (ratio, words) in _scatters(rig, stand, price).items():
        if ratio is None or ratio <= ROUNDING or 1.0 / SIGMA_FAR < ratio < SIGMA_FAR:
            continue
        channel = next(c for c in rig.machine.channels if c.kind == kind)
        size = float(f"{channel.sigma * ratio:.2g}")
        fields = {"position": "xyz", "rotation": "rot", "direction": "angle"}.get(kind, kind)
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
            partial(_mend_sigma, fields, convert(size, channel.unit, unit)),
        )


def _mend_sigma(key: str, value: float, pair: Pair) -> Pair:
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
    if len(rows) >= 2 and not any(s.differs_from_row or s.compares for s in rig.machine.sensors):
        labels = np.repeat(np.arange(len(rows)), [len(r) for r in rows])
        here = rig.predictor.over(rig.recording.subset(np.concatenate(rows)))
        residual, good = rig.residual(here, stand.p, stand.scene)
        for kind in kinds:
            at = [k for k, c in enumerate(rig.machine.channels) if c.kind == kind]
            out[kind] = (_within(residual[:, at], labels, good), "replicates scatter")
    left = stand.residual
    for kind in kinds:
        if kind not in out and price < 1.0 / SIGMA_FAR and len(left):
            out[kind] = (price, "everything that is left varies")
    return out


def _replicates(recording: Recording) -> list[Index]:
    """Places of rows that were measured alike, groups of two and more; a row copied from another one is none.

    Alike: at one reading of all joints, in one session, reached from the same sides, under the same load.
    """
    use = np.setdiff1d(np.flatnonzero(~recording.validation), repeats(recording))
    like = [v for name, v in recording.drivers.items() if Driver.of(name).kind in (APPROACH, PAYLOAD)]
    told = np.column_stack([recording.q, recording.session, *like])[use] + 0.0
    _, label, count = np.unique(told, axis=0, return_inverse=True, return_counts=True)
    label = label.reshape(-1)
    return [use[label == k] for k in np.flatnonzero(count >= 2)[:_MOST_GROUPS]]


def _within(residual: Array, labels: NDArray[np.int64], good: Mask) -> float | None:
    """The middle of the groups' scatter; None where too few readings repeat."""
    sizes, spare = [], 0
    for k in np.unique(labels):
        own = residual[(labels == k) & good]
        own = own[np.isfinite(own).all(axis=1)]
        if len(own) >= 2:
            spare += (len(own) - 1) * own.shape[1]
            square = np.sum((own - own.mean(axis=0)) ** 2)
            sizes.append(float(np.sqrt(square / ((len(own) - 1) * own.shape[1]))))
    return float(np.median(sizes)) if spare >= FEWEST else None
