"""Fit before and after: misfit in sigma and in the sensor's unit; held-out ratio with its interval."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from truepose.identification.diagnosis.result import Proof
from truepose.identification.report.fits import FitColumn
from truepose.identification.report.numbers import finer, known, significant, unit_symbol
from truepose.shown.chart import Axis, Bars, Chart, Layer, Level, Marks, Tone

_ROLES: tuple[tuple[str, int, Tone, float], ...] = (
    ("calibration rows", 0, "after", -0.18),
    ("validation rows", 1, "accent", 0.18),
)


def fit_bars(columns: Sequence[FitColumn], noise: Mapping[str, float], own: Mapping[str, str]) -> list[Chart]:
    """Bars of every fit: rms in sigma, then rms by kind (in units ``own``) with the stated noise as a line."""
    kinds = list(dict.fromkeys(kind for column in columns for kind in column.rms))
    out = [_panel("in stated sigmas", "σ", columns, [[c.sigma[at] for c in columns] for at in (0, 1)], 1.0)]
    for kind in kinds:
        factor, unit = _display(own[kind], [c.rms[kind] for c in columns if kind in c.rms])
        values = [[_times(c.rms_of(at, kind), factor) for c in columns] for at in (0, 1)]
        out.append(_panel(kind, unit, columns, values, _times(noise.get(kind), factor)))
    return out


def _panel(
    title: str,
    unit: str,
    columns: Sequence[FitColumn],
    values: Sequence[Sequence[float | None]],
    noise: float | None,
) -> Chart:
    layers: list[Layer] = []
    both = any(known(v) for v in values[1])
    for name, at, tone, shift in _ROLES:
        told = [(k, v) for k, v in enumerate(values[at]) if v is not None and math.isfinite(v)]
        if told:
            places = np.array([k + (shift if both else 0.0) for k, _ in told])
            lengths = np.array([v for _, v in told])
            layers.append(Bars(lengths, tone, name, at=places, texts=[significant(v) for _, v in told]))
    if noise is not None and known(noise):
        layers.append(Level(noise, "x", "noise as stated"))
    tallest = max(
        [v for role in values for v in role if v is not None and math.isfinite(v)] + [noise or 0.0],
        default=1.0,
    )
    return Chart(
        title,
        Axis(f"rms residual [{unit}]", 0.0, 1.25 * (tallest or 1.0)),
        Axis("", names=[column.short for column in columns]),
        layers,
        height=64.0 + 36.0 * len(columns),
    )


def _display(own: str, values: Sequence[float]) -> tuple[float, str]:
    """Factor and unit in which the largest of some rms values reads well."""
    largest = max((abs(v) for v in values if math.isfinite(v)), default=1.0)
    factor, unit = finer(largest, own)
    return factor, unit_symbol(unit)


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None or not math.isfinite(value) else value * factor


def proof_plot(proof: Proof) -> Chart:
    """Held-out misfit after over before: the named physics with its interval, and the black box."""
    low, high = proof.ratio_interval
    ends = Marks(np.array([low, high]), np.zeros(2), "after", "95 % interval", "tick")
    layers: list[Layer] = [
        Bars(
            np.array([proof.ratio]),
            "after",
            "named physics",
            at=np.zeros(1),
            texts=[significant(proof.ratio)],
        ),
        ends,
    ]
    names = ["named physics"]
    if known(proof.black_box_ratio):
        assert proof.black_box_ratio is not None
        text = [significant(proof.black_box_ratio)]
        layers.append(Bars(np.array([proof.black_box_ratio]), "free", "black box", at=np.ones(1), texts=text))
        names.append("black box")
    layers.append(Level(1.0, "x", "no gain"))
    top = 1.15 * max([v for v in (1.0, high, proof.black_box_ratio) if v is not None and math.isfinite(v)])
    axis = Axis("held-out rms, after over before [1]", 0.0, top)
    return Chart("", axis, Axis("", names=names), layers, height=64.0 + 30.0 * len(names))
