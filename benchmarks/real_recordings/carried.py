"""How far a model of `configurations` can be carried to `random` at all: the UR10's joints 1, 2 and 5 move on other arcs there.

Ladder: models fitted to `random` itself. What no model of these can reach, no model of `configurations` that says nothing
on arcs it never saw can. Low orders: periodic errors of few orders, unbounded, fitted to `configurations` and carried.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from real_recordings.common import rms, say
from real_recordings.unseen import carry
from real_recordings.ur10 import mark_held_out
from truepose.errors import ConvergenceError
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.estimate import Estimate, estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.load import load_machine
from truepose.models.machine import Machine

SEEN, UNSEEN = ("q3", "q4", "q6"), ("q1", "q2", "q5")
"""Joints whose arc in `random` lies mostly within that of `configurations`, and those that left it."""
SERIES = 60.0
LOW = (1.0, 2.0, 3.0)
ROUGH = 1e-2
"""What a fit of hundreds of coefficients may leave to gain of half its sum of squares."""
Arcs = Mapping[str, tuple[float, float]]


def carried(data: Path, work: Path) -> None:
    """Both studies, a line each."""
    work.mkdir(parents=True, exist_ok=True)
    mark_held_out(data, work, ("configurations", "random"))
    machine = load_machine(data / "ur10-laser-tracker" / "machine.yaml")
    source, target = (
        load_recording(machine, [work / f"{name}.csv"]) for name in ("configurations", "random")
    )
    arcs = {name: (float(q.min()), float(q.max())) for name, q in zip(source.joints, source.q.T, strict=True)}
    for name, (low, high) in arcs.items():
        q = target.q[:, target.joints.index(name)]
        say(
            f"{name}: {100 * np.mean((q > low) & (q < high)):.0f} % of the rows of random are on the arc seen"
        )
    weight = [_term(machine, "joint-compliance", q, {}) for q in ("q2", "q3", "q4")]
    waves = [_wave(machine, q, SERIES) for q in SEEN]
    known = [_wave(machine, q, SERIES, arcs) for q in UNSEEN]
    every = [_wave(machine, q, SERIES) for q in UNSEEN]
    for terms, what in (
        (weight, "geometry and compliance"),
        ([*weight, *waves], f"and waves of {', '.join(SEEN)}"),
        ([*weight, *waves, *known], f"and of {', '.join(UNSEEN)} on arcs that configurations saw"),
        ([*weight, *waves, *every], "and of these on all arcs"),
    ):
        say(f"fitted to random, {what}: {_held_out(_fit(machine, target, terms)):.3f} mm")
    for order in LOW:
        few = [*weight, *(_wave(machine, q, order) for q in (*SEEN, *UNSEEN))]
        try:
            carry(_fit(machine, source, few), target, f"configurations -> random, orders up to {order:g}")
        except ConvergenceError as exc:
            say(f"orders up to {order:g}: {exc}")


def _term(machine: Machine, slug: str, joint: str, settings: Mapping[str, float]) -> PlacedEffect:
    effect = effects.get(slug, "this study")()
    return replace(PlacedEffect.at(effect, machine, (joint,), settings), spread=1.0)


def _wave(machine: Machine, joint: str, orders: float, arcs: Arcs | None = None) -> PlacedEffect:
    """Transmission error of so many orders; bounded to an arc where one is given."""
    settings: Mapping[str, float] = {"orders": orders}
    if arcs is not None:
        settings = effects.get("transmission-error", "this study")().within((joint,), settings, arcs)
    return _term(machine, "transmission-error", joint, settings)


def _fit(machine: Machine, recording: Recording, terms: Sequence[PlacedEffect]) -> Estimate:
    start = aligned_start(Predictor(machine, recording))
    plain = estimate(machine, recording, start=start, loss="huber")
    p = np.concatenate([plain.p, np.zeros(sum(len(t.coefficients) for t in terms))])
    return estimate(machine, recording, terms, start=p, loss="huber", tolerance=ROUGH)


def _held_out(fit: Estimate) -> float:
    """Position rms of held-out rows, mm."""
    channels = fit.machine.channels
    at = [k for k, c in enumerate(channels) if c.kind == "position"]
    return rms(channels[at[0]].sigma * fit.residual[~fit.used][:, at])
