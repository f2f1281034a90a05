"""A case of the examination: a pure function of the seed and its place in the schedule.

The files that the engine sees and the key to them are kept apart from here on.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from challenge import schedule
from challenge.keys import free_chi2, key
from challenge.nulls import Decoy, decoy, gone_wild, misstated, noisy, wild_rows
from challenge.real_like import real_like
from challenge.setup import Setup, Setups
from challenge.simulator.base import SimulatedMachine
from challenge.simulator.writing import recording_text
from challenge.solutions import CONCEALED, Solution
from challenge.strata import Draft, UndrawnError, draft
from truepose.models.effects.common import OF_ROWS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
NOISES = 3
"""Noises that are tried before a machine has nothing to conceal."""
_DRAW, _SPECIMEN, _CAMPAIGN, _NOISE = range(4)


@dataclass(frozen=True)
class Case:
    """Texts of the files that the engine may see, and the key."""

    machine: str
    recording: str
    held_out: str
    solution: Solution


def draw_case(machine: SimulatedMachine, seat: schedule.Seat, seed: int) -> Case:
    """The case of a seat. Raises UndrawnError when the machine has nothing for its stratum."""
    streams = [np.random.default_rng([seed, seat.index, k]) for k in range(4)]
    rng, noise_seed = streams[_DRAW], int(streams[_NOISE].integers(2**31))
    specimen = machine.specimen(streams[_SPECIMEN])
    if seat.stratum == schedule.NULL:
        kind = decoy(seat.variant, rng)
        setup = Setup.draw(machine, specimen, kind.plan, streams[_CAMPAIGN])
        return _written(seat, Draft(setup, (), ()), kind, noise_seed)
    kind = Decoy()
    if seat.variant == schedule.MISSTATED:
        kind = misstated(rng, hides=seat.stratum == schedule.CONCEALED)
    campaign_seed = int(streams[_CAMPAIGN].integers(2**31))
    setups = Setups(machine, specimen, campaign_seed, sessions=int(rng.integers(1, 3)))
    if seat.stratum == schedule.REAL:
        return _written(seat, real_like(setups, rng), kind, noise_seed)
    for left in reversed(range(NOISES)):
        try:
            found = draft(seat.stratum, setups, rng, partial(_hidden, kind=kind, noise_seed=noise_seed))
            break
        except UndrawnError:  # with few readings the noise alone may look like a misfit
            if not left or seat.stratum != schedule.CONCEALED:
                raise
            noise_seed = int(streams[_NOISE].integers(2**31))
    return _written(seat, found, kind, noise_seed)


def _hidden(found: Draft, kind: Decoy, noise_seed: int) -> bool:
    """Whether the free fit of the very recording looks good, by the simulator's own derivatives."""
    observed, wild = _observed(found, kind, noise_seed)
    return free_chi2(found, observed, wild, kind) < CONCEALED


def _observed(found: Draft, kind: Decoy, noise_seed: int) -> tuple[Array, Mask]:
    """(n, k) readings with noise, and which rows (n,) are wild. The drawing is what is wrong of sigma, not the noise."""
    setup, rng = found.setup, np.random.default_rng(noise_seed)
    exact = setup.exact(found.imperfections)[0]
    read = noisy(setup.machine, exact, setup.campaign, rng, replace(kind, noise=1.0))
    if kind.wild:
        read = gone_wild(exact, read, setup.sigma, kind.wild, rng)
    odd = kind.tails or kind.wild
    wild = (
        wild_rows(exact, read, setup.sigma, setup.machine.columns)
        if odd
        else np.zeros(len(exact), dtype=bool)
    )
    physics = [p.imperfection for p, k in zip(found.parts, found.kinds, strict=True) if k.slug not in OF_ROWS]
    if len(physics) < len(found.parts):  # blunders that were put in as such
        wild |= np.any(setup.exact(physics)[0] != exact, axis=1)
    return read, wild


def _written(seat: schedule.Seat, found: Draft, kind: Decoy, noise_seed: int) -> Case:
    setup, simulated = found.setup, found.setup.machine
    observed, wild = _observed(found, kind, noise_seed)
    exact_held = setup.exact(found.imperfections)[1]
    held_text = _without(recording_text(simulated, setup.held, exact_held), simulated.columns)
    stated = simulated.machine_text(sigma_factor=1 / kind.noise, tolerance_factor=1 / kind.tolerance)
    solution = key(seat, found, kind, observed, wild, stated, held_text)
    return Case(stated, recording_text(simulated, setup.campaign, observed), held_text, solution)


def _without(text: str, columns: Sequence[str]) -> str:
    """The table without some columns: what a prediction starts from holds no readings."""
    table = pd.read_csv(io.StringIO(text), dtype=str, keep_default_na=False)
    return str(table.drop(columns=list(columns)).to_csv(index=False))


__all__ = ["Case", "draw_case"]
