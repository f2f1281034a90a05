"""What is kept of one diagnosed machine for the statistics of its fleet: a few kB that JSON can hold.

``kept`` stores evidence, not conclusions: of every effect at every place a Bayes factor that is free of the prior that the
diagnosis was made with, so that a fleet can be summed up under any prior, and never counts what a prior said twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.tolerance_classes import part_classes
from truepose.identification.leaves.fleet.place_evidence import PlaceEvidence

KEPT = "truepose/kept/1"
DETERMINED = 3.0
"""1-sigma of what the readings alone say of a constant, in its tolerances, beyond which they say nothing of it."""
FINEST = 1e-3
"""Smallest 1-sigma of a constant that is kept, in tolerances: no fit of a model is better than that."""


def kept(diagnosis: Diagnosis) -> dict[str, Any]:
    """What the fleet's statistics need of a machine that was diagnosed with ``examine=evidence`` (``place_evidence``).

    Returns a dict of texts, numbers, lists and dicts: ``machine``, ``mechanism`` (its type), ``verdict``; ``places``: by effect
    and place ``[probability, prior, log Bayes factor, unseen, credit]`` (``unseen``: prior share of sizes that the recording
    would not show; ``credit``: its share among rivals), and where it may be there a dict besides: ``sizes``, how probable each
    size of the slab is, ``size``, [mean, std] of the log of its rms coefficient in expected largest sizes, and ``amount``, the
    same mean in ``unit``; ``anywhere``: by effect the same five numbers, of any of its places; ``parameters``: by name what
    the readings alone say, [deviation, std] in tolerances, and its class of parts.
    """
    machine = diagnosis.nominal
    return {
        "schema": KEPT,
        "machine": machine.name,
        "mechanism": machine.mechanism_type,
        "verdict": diagnosis.verdict,
        "places": _by_effect(diagnosis.examined[0]),
        "anywhere": {one.effect: _place(one) for one in diagnosis.examined[1]},
        "parameters": _parameters(diagnosis.after),
    }


def _by_effect(every: Sequence[PlaceEvidence]) -> dict[str, dict[str, list[Any]]]:
    out: dict[str, dict[str, list[Any]]] = {}
    for one in every:
        out.setdefault(one.effect, {})["+".join(one.place)] = _place(one)
    return out


def _place(one: PlaceEvidence) -> list[Any]:
    """Rounded to what matters: a hundredth of a nat, four digits of a probability."""
    factor = round(one.log_bayes_factor, 2)
    out: list[Any] = [
        _short(one.probability),
        _short(one.prior),
        factor,
        _short(one.unseen),
        _short(one.credit),
    ]
    more: dict[str, Any] = {}
    if one.sizes:
        more["sizes"] = [round(p, 3) for p in one.sizes]
    if one.size is not None:
        more["size"] = [round(one.size.log_mean, 3), round(one.size.log_std, 3)]
        more |= {"amount": round(one.size.log_amount, 3), "unit": one.size.unit} if one.size.unit else {}
    return [*out, more] if more else out


def _short(value: float) -> float:
    return float(f"{value:.4g}") if abs(value) >= 1e-6 else 0.0


def _parameters(fit: Estimate) -> dict[str, list[float | str]]:
    """By name: deviation and its 1-sigma, in tolerances, as the readings alone say it, and the class of parts.

    A fit is N(m, v) from a prior N(0, w) and the readings' N(x, e): 1 / e = 1 / v - 1 / w, x = m e / v (variances).
    """
    free = [k for k in fit.prior.free if k < len(fit.nominal.parameters)]
    tolerance = {k: fit.nominal.parameters[k].tolerance for k in free}
    at = [k for k in free if 0.0 < tolerance[k] < np.inf]
    if not at:
        return {}
    scale = np.array([tolerance[k] for k in at])
    v = (fit.std[at] / scale) ** 2
    w = (fit.prior.sigma[at] * fit.noise / scale) ** 2
    told = 1.0 / np.maximum(v, FINEST**2) - 1.0 / w  # w is infinite without a prior
    names = [fit.prior.names[k] for k in at]
    classes = part_classes(names, [fit.prior.parts[k] for k in at])
    out: dict[str, list[float | str]] = {}
    for k, name in enumerate(names):
        if told[k] < DETERMINED**-2:
            continue
        x = fit.in_tolerances[at[k]] / max(v[k], FINEST**2) / told[k]
        kind = " ".join(part for part in (classes[k].kind, classes[k].parts) if part)
        out[name] = [_short(float(x)), _short(float(told[k] ** -0.5)), kind]
    return out
