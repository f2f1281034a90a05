"""Machines of a fleet as they are kept, drawn from the model of its ``hierarchy``, with the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import expit, logsumexp

from truepose.arrays import Array
from truepose.identification.leaves.fleet.hierarchy import KERNEL, SLAB, STEPS, effect_steps
from truepose.identification.prior import FLEET_PLACES, SIZES

NOISE = 0.02
"""1-sigma with which a recording shows an effect's one coefficient, in expected sizes."""
MOST = 15.0
"""Log Bayes factor beyond which a diagnosis tells no more."""
CLASS = "length leg.a"


@dataclass(frozen=True)
class DrawnFleet:
    """One effect at places (p,), with the share of machines that have it there and the fleet's usual size; log prior odds."""

    frequency: Array
    usual_size: int
    usual: float
    effect: str = "backlash"

    @classmethod
    def draw(cls, rng: np.random.Generator, places: int, usual: float = -4.0) -> DrawnFleet:
        """From the prior."""
        step = rng.choice(STEPS, p=np.exp(effect_steps(usual)))
        odds = usual + step + FLEET_PLACES * rng.standard_normal(places)
        return cls(expit(odds), int(rng.choice(len(SLAB), p=SLAB)), usual)

    def machine(self, rng: np.random.Generator, ratio: float = 1.0) -> dict[str, Any]:
        """One machine as it is kept; constants of its one class scatter ``ratio`` times their tolerance."""
        places, none = dict[str, list[Any]](), 1.0
        for k, q in enumerate(self.frequency.tolist()):
            size = SIZES.values[rng.choice(len(SLAB), p=KERNEL[self.usual_size])]
            value = (rng.random() < q) * size * rng.standard_normal() + NOISE * rng.standard_normal()
            places[f"q{k + 1}"] = seen(float(value), self.usual)
            none *= 1.0 - places[f"q{k + 1}"][0]
        any_prior = 1.0 - (1.0 - float(expit(self.usual))) ** len(places)
        std = rng.uniform(0.05, 1.0, 4)
        x = ratio * rng.standard_normal(4) + std * rng.standard_normal(4)
        return {
            "schema": "truepose/kept/1",
            "machine": "arm",
            "mechanism": "serial",
            "verdict": "missing-physics" if none < 0.5 else "adequate",
            "places": {self.effect: places},
            "anywhere": {
                self.effect: [1.0 - none, any_prior, _log_odds(1.0 - none) - _log_odds(any_prior), 0.0, 1.0]
            },
            "parameters": {f"c{k}": [float(x[k]), float(std[k]), CLASS] for k in range(4)},
        }


def mixed_machines(rng: np.random.Generator, number: int) -> list[dict[str, Any]]:
    """Machines of two mechanisms that have, or have not, what others have; of each something is missing."""
    effects = ("backlash", "drift", "scale")
    often = {(effect, place): rng.choice([0.01, 0.4, 0.98]) for effect in effects for place in ("q1", "q2")}
    return [_mixed(rng, often) for _ in range(number)]


def _mixed(rng: np.random.Generator, often: Mapping[tuple[str, str], float]) -> dict[str, Any]:
    places = dict[str, dict[str, list[Any]]]()
    for (effect, place), share in often.items():
        if rng.random() < 0.9:
            places.setdefault(effect, {})[place] = _told(rng, share)
    anywhere = {effect: _told(rng, 0.5)[:5] for effect in places}
    constants = {
        f"c{k}": float(rng.choice([0.5, 8.0], p=[0.95, 0.05]) * rng.standard_normal()) for k in range(4)
    }
    return {
        "schema": "truepose/kept/1",
        "machine": "arm",
        "mechanism": str(rng.choice(["serial", "parallel"], p=[0.8, 0.2])),
        "verdict": str(rng.choice(["missing-physics", "adequate"])),
        "places": places,
        "anywhere": anywhere,
        "parameters": {
            name: [x, 0.1, f"class {name < 'c2'}"] for name, x in constants.items() if rng.random() < 0.9
        },
    }


def _told(rng: np.random.Generator, often: float) -> list[Any]:
    """Of a place: surely there or surely not, as a rule; now and then unseen, explained by a rival, or held impossible."""
    p = rng.uniform(0.98, 1.0) if rng.random() < often else rng.uniform(0.0, 0.02)
    p = p if rng.random() < 0.97 else rng.uniform()
    prior, unseen = rng.choice([0.0, often], p=[0.1, 0.9]), rng.choice([0.05, 0.95], p=[0.8, 0.2])
    own = [float(v) for v in (p, prior, 10.0 * p - 5.0, unseen, rng.choice([1.0, 0.4], p=[0.8, 0.2]))]
    size = [float(rng.normal(-2.0, 0.3) + rng.choice([0.0, 2.0], p=[0.95, 0.05])), 0.1]
    amount = {"amount": size[0], "unit": str(rng.choice(["mm", "rad"]))} if rng.random() < 0.5 else {}
    shares = {"sizes": rng.dirichlet(np.ones(len(SLAB))).tolist()} if rng.random() < 0.8 else {}
    return [*own, {**shares, "size": size, **amount}] if p > 0.1 else own


def seen(value: float, usual: float) -> list[Any]:
    """What is kept of a place whose coefficient was read as ``value``, by log prior odds ``usual``: exact, but that sizes
    nobody would notice are said nothing of."""
    variance = SIZES.values**2 + NOISE**2
    log_factors = np.log(NOISE / np.sqrt(variance)) + 0.5 * value**2 * (NOISE**-2 - 1.0 / variance)
    noticed = SIZES.values > 2.0 * NOISE
    unseen = float(SLAB[~noticed].sum())
    log = np.where(noticed, np.log(SLAB) + log_factors, -np.inf)
    told = min(float(logsumexp(log)) - float(np.log1p(-unseen)), MOST)
    prior = float(expit(usual))
    odds = prior * (1.0 - unseen) / (1.0 - prior * (1.0 - unseen)) * np.exp(told)
    shares = np.exp(log - logsumexp(log))
    size = np.log(np.hypot(value, NOISE))
    more = {"sizes": shares.tolist(), "size": [float(size), NOISE / max(abs(value), NOISE)]}
    kept = [float(odds / (1.0 + odds)), prior, told, unseen, 1.0]
    return [*kept, more | {"amount": float(size), "unit": "mm"}] if kept[0] > 0.02 else kept


def _log_odds(p: float) -> float:
    p = float(np.clip(p, 1e-9, 1.0 - 1e-9))
    return float(np.log(p / (1.0 - p)))
