"""Whether two campaigns of one arm say the same of its joints, and what the model of one is worth on the other.

No single diagnosis can ask this. Periodic terms of two diagnoses are compared over the arcs on which both campaigns have
rows; then each model is applied to the other as ``truepose calibrate improved.yaml other.csv --only base,tool`` does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from real_recordings.prepared import prepared
from real_recordings.unseen import diagnosed

import truepose
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
LOW_ORDERS = 3
"""Orders that geometry and compliance take over where an arc is short: they are taken out of both."""
LEAST = 3
"""Rows that a degree must hold in both campaigns."""
PERIODIC = ("transmission-error", "encoder-eccentricity")


def campaigns(data: Path, work: Path, names: Sequence[str]) -> Iterator[str]:
    """Lines on two campaigns; one that is diagnosed in ``work`` already is not diagnosed again."""
    files = [prepared(data, work, name) for name in names]
    for name in names:
        if not (work / name / "improved.yaml").exists():
            diagnosed(data, work, name)
    improved = [truepose.load_machine(work / name / "improved.yaml") for name in names]
    recordings = [truepose.load_recording(m, [f]) for m, (_, f) in zip(improved, files, strict=True)]
    for joint in recordings[0].joints:
        r, width = agreement([m.effects for m in improved], recordings, joint)
        yield f"{joint}: orders above {LOW_ORDERS} correlate {r:.3f} over {width} deg where both have rows"
    for k, name in enumerate(names):
        plain = truepose.calibrate(truepose.load_machine(files[k][0]), recordings[k])
        plain.write(work / name / "plain")
        for file in ("plain/calibrated.yaml", "improved.yaml"):
            rms = _carried(truepose.load_machine(work / name / file), recordings[1 - k])
            yield f"{name}/{file} on {names[1 - k]}, base and tool refitted: {rms:.3f} mm held out"


def _carried(machine: Machine, recording: Recording) -> float:
    """Rms of the position of held-out rows, mm."""
    fit = truepose.calibrate(machine, recording, only=("base", "tool")).fit
    channels = fit.nominal.channels
    at = [k for k, c in enumerate(channels) if c.kind == "position"]
    off = channels[at[0]].sigma * fit.residual[recording.validation][:, at]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def agreement(
    effects: Sequence[Sequence[PlacedEffect]], recordings: Sequence[Recording], joint: str
) -> tuple[float, int]:
    """Correlation of a joint's periodic errors without low orders, and the degrees (of arc) over which both have rows."""
    edges = np.deg2rad(np.arange(-360, 361))
    counts = [np.histogram(r.q[:, r.joints.index(joint)], edges)[0] for r in recordings]
    both = np.all(np.array(counts) >= LEAST, axis=0)
    angle: Array = ((edges[1:] + edges[:-1]) / 2)[both]
    orders = range(1, LOW_ORDERS + 1)
    low = np.column_stack([np.ones_like(angle), *(f(o * angle) for o in orders for f in (np.sin, np.cos))])
    curves = [_curve(placed, joint, angle) for placed in effects]
    left = [c - low @ np.linalg.lstsq(low, c, rcond=None)[0] for c in curves]
    if not all(np.any(part) for part in left):
        return float("nan"), int(both.sum())
    return float(np.corrcoef(*left)[0, 1]), int(both.sum())


def _curve(effects: Sequence[PlacedEffect], joint: str, angle: Array) -> Array:
    """Periodic error (n,) of a joint over its angle, rad."""
    out = np.zeros(len(angle))
    for e in effects:
        if e.effect.slug in PERIODIC and e.place == (joint,):
            single = e.settings_map.get("order")
            for name, value in e.values.items():
                order = float(name[1:]) if single is None else single
                out += value * (np.sin if name[0] == "a" else np.cos)(order * angle)
    return out
