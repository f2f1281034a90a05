"""Numbers of results that are committed, and how far they may move.

Kept is what another processor rounds alike: fits that end in one point, log evidences at it. Parameters are told in their own
1-sigma from the drawing; what chains draw, and where a fit without tolerances ends in a flat valley, is not kept.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import truepose
from truepose.identification import prior
from truepose.identification.diagnosis.null_fits import null_fits
from truepose.identification.diagnosis.search import Expansion, Start, prepared
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.tool_pose import tool_spread
from truepose.identification.leaves.fleet.pooled import Pooled
from truepose.identification.leaves.fleet.statistics import statistics
from truepose.identification.leaves.fringes.move import Move
from truepose.identification.posterior.state import tops
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.signatures import Signatures

Json = dict[str, Any]
SHARE, FLOOR = 2e-3, 0.02
"""How far a number may move: a share of it; and so much, where it is in 1-sigmas or a logarithm."""
OF_ORDER_ONE = {"from the drawing", "alone", "log posterior"}
DIGITS = 6


def calibrated(folder: Path, estimator: str) -> Json:
    """A calibration of a case of the golden diagnoses."""
    machine = truepose.load_machine(folder / "machine.yaml")
    recording = truepose.load_recording(machine, sorted(folder.glob("*.csv")))
    found = truepose.calibrate(machine, recording, estimator=estimator)
    return {
        "notes": list(found.notes),
        "method": {k: v for k, v in found.method.items() if k != "tuning"},
        **fitted(found.fit, recording),
    }


def fitted(fit: Estimate, recording: Recording) -> Json:
    """What a fit says of parameters, readings and the tool."""
    tool = tool_spread(fit, recording, np.flatnonzero(fit.used)[:10])
    size = np.where(fit.std > 0.0, fit.std, 1.0)
    return {
        "from the drawing": _by_name(fit, (fit.p - fit.prior.mean) / size),
        "std": _by_name(fit, fit.std),
        "in tolerances": float(np.max(np.abs(fit.in_tolerances))),
        "chi2": fit.chi2,
        "readings": fit.n_observations,
        "effective": fit.effective_parameters,
        "rank": fit.rank,
        "residual": np.sum(fit.residual[fit.used] ** 2, axis=0).tolist(),
        "tool": {name: float(np.sqrt(np.mean(v))) for name, v in tool.variance.items()},
    }


def _by_name(fit: Estimate, values: np.ndarray[Any, Any]) -> dict[str, float]:
    return {fit.prior.names[k]: float(values[k]) for k in fit.prior.free}


def weighed(folder: Path) -> Json:
    """Before anything is drawn: both fits without effects, every candidate alone, and the set that is climbed to."""
    machine = truepose.load_machine(folder / "machine.yaml")
    recording = truepose.load_recording(machine, sorted(folder.glob("*.csv")))
    fits = null_fits(machine, recording)
    every = catalogue(machine, recording)
    signatures, cat = prepared(Signatures(machine, recording, every.candidates), fits.before, every)
    stated = dict.fromkeys(cat.stated, prior.STATED)
    near = Expansion(Start(signatures, cat, fits.before, stated, fits.outliers, fits.rms))
    best = tops(near.spike_slab, near.problem.richness, near.known)[0]
    names = {cat.candidates[near.problem.candidates[t]].label: size for t, size in best.members}
    return {
        "fit": fitted(fits.before, recording),
        "fit without tolerances": fits.free.chi2_per_dof,
        "rows left out": np.flatnonzero(fits.outliers).tolist(),
        "candidates": len(cat.candidates),
        "alone": _alone(near),
        "untestable": sorted({u.effect for u in cat.untestable}),
        "set": names,
        "log posterior": best.log_posterior,
    }


def _alone(near: Expansion) -> dict[str, list[float]]:
    """Of an effect at a place: how many settings, the best one's log evidence and their mean."""
    out: dict[str, list[float]] = {}
    for candidate, value in zip(near.catalogue.candidates, near.alone.tolist(), strict=True):
        if np.isfinite(value):
            out.setdefault(f"{candidate.effect.slug}@{'+'.join(candidate.place)}", []).append(value)
    return {name: [len(own), max(own), float(np.mean(own))] for name, own in out.items()}


def counted(move: Move) -> Json:
    """Fringes of a move."""
    count = move.count
    return {
        "change": move.change,
        "sigma": move.sigma,
        "signed": move.signed,
        "faults": [fault.name for fault in move.faults],
        "walked": count.walked,
        "ends": [asdict(count.start), asdict(count.stop)],
        "turns": count.turns,
        "noise": count.noise,
        "spikes": count.spikes,
        "levels": [count.levels.low.tolist(), count.levels.high.tolist(), count.levels.sigma, count.levels.misfit],
    }  # fmt: skip


def summed(machines: Sequence[Mapping[str, Any]]) -> Json:
    """Statistics of a fleet."""
    return asdict(statistics(Pooled.of(machines)))


def kept(value: Any) -> Any:
    """Short numbers; names and lists as they are."""
    if isinstance(value, Mapping):
        return {str(k): kept(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [kept(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def differences(old: Any, new: Any, where: tuple[str, ...] = ()) -> Iterator[str]:
    """Sentences on what is not as it was."""
    if isinstance(old, dict) and isinstance(new, dict) and list(old) == list(new):
        for key in old:
            yield from differences(old[key], new[key], (*where, key))
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for k, pair in enumerate(zip(old, new, strict=True)):
            yield from differences(*pair, (*where, str(k)))
    elif not _alike(old, new, FLOOR if OF_ORDER_ONE & set(where) else 1e-9):
        yield f"{' '.join(where)} was {old} and is {new}"


def _alike(old: Any, new: Any, floor: float) -> bool:
    if isinstance(old, float) and isinstance(new, float):
        return bool(np.isclose(new, old, rtol=SHARE, atol=floor, equal_nan=True))
    return bool(old == new)
