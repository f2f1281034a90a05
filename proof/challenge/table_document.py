"""The table of an examination as plain data, for programs."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from challenge.calibration import Bin, brier, calibration_error, honest_error, reliability
from challenge.figures import Figure
from challenge.score import Score
from challenge.score_table import Table

_SHOWN = ("effect", "kind", "place", "factor", "factor_beside", "family", "snr", "misfit")
_KEPT = (
    "said", "failure", "seconds", "right", "verdict", "detected", "named", "top_effect", "top_place", "first", "exact",
    "confident_wrong", "wrong_class", "honest", "abstained", "flag", "remainder", "held_out", "held_out_ratio",
    "empirical_ratio", "bias", "bias_ratio", "pose_ratio",
)  # fmt: skip


def document(found: Table) -> dict[str, Any]:
    """Figures, calibration and scores; what is infinite is null."""
    return {
        "schema": "truepose/challenge/1",
        "cases": len(found.scores),
        "figures": [_figure(f) for f in found.headline],
        "simulators": {name: [_figure(f) for f in fs] for name, fs in found.simulators.items()},
        "details": [_figure(f) for f in found.details],
        "machines": {name: [_figure(f) for f in fs] for name, fs in found.machines.items()},
        "effects": {name: [_figure(f) for f in fs] for name, fs in found.effects.items()},
        "real_like": {name: _figure(f) for name, f in found.at_once.items()},
        "brier": {name: brier(said) for name, said in found.spoken.items()},
        "calibration_error": {name: calibration_error(said) for name, said in found.spoken.items()},
        "calibration_error_by_chance": {name: honest_error(said) for name, said in found.spoken.items()},
        "reliability": {name: [_bin(b) for b in reliability(said)] for name, said in found.spoken.items()},
        "scores": [_score(s) for s in found.scores],
        "undrawn": list(found.undrawn),
    }


def _figure(f: Figure) -> dict[str, Any]:
    target = f.target and {"low": _finite(f.target.low), "high": _finite(f.target.high)}
    out: dict[str, Any] = {
        "name": f.name,
        "n": f.n,
        "value": _finite(f.value),
        "interval": f.interval and [_finite(end) for end in f.interval],
    }
    return {**out, **({"hits": f.hits} if f.share else {}), "target": target, "met": f.met}


def _bin(b: Bin) -> dict[str, Any]:
    return {"said": b.said, "n": b.n, "hits": b.hits, "interval": list(b.interval), "holds": b.holds}


def _score(s: Score) -> dict[str, Any]:
    sol = s.solution
    about = {"case": sol.case, "machine": sol.machine, "stratum": sol.stratum, "variant": sol.variant}
    truths = [{name: getattr(t, name) for name in _SHOWN} for t in sol.truths]
    return {
        **about,
        "truths": truths,
        "named_each": list(s.found),
        "known_each": list(s.levels.known),
        "concealed": sol.concealed,
        "missing": list(sol.missing),
        **{name: getattr(s, name) for name in _KEPT},
        "predicted": asdict(s.predicted),
        "rows": asdict(s.rows),
    }


def _finite(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)


__all__ = ["document"]
