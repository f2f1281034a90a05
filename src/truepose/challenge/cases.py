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

from truepose.challenge import schedule
from truepose.challenge.nulls import Decoy, decoy, noisy
from truepose.challenge.references import oracle, oracle_terms, ordinary_fits, reference
from truepose.challenge.rivals import equivalents, misfit, rivals
from truepose.challenge.setup import Setup, Setups
from truepose.challenge.simulator.base import SimulatedMachine
from truepose.challenge.simulator.writing import recording_text
from truepose.challenge.solutions import Geometry, HeldOut, Reference, Solution, Truth
from truepose.challenge.strata import Draft, UndrawnError, draft
from truepose.errors import ConvergenceError
from truepose.identification.fit.estimate import Estimate
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine import Machine

Array = NDArray[np.float64]
CONCEALED = 1.3
"""chi2 per degree of freedom of the free fit below which the ordinary fit looks good (interface, section 4)."""
LIKELY = 1.2
"""The same to first order and without noise: above it the fit is not tried."""
NOISES = 3
"""Noises that are tried before a machine has nothing to conceal."""
DETERMINED = 1.0
"""Information of a combination, in tolerances, from which on readings know it better than the drawing."""
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
    if seat.stratum == schedule.NULL:
        kind = decoy(seat.variant, rng)
        specimen = machine.specimen(streams[_SPECIMEN], scale=kind.tolerance)
        return _written(
            seat,
            Draft(Setup.draw(machine, specimen, kind.plan, streams[_CAMPAIGN]), (), ()),
            kind,
            noise_seed,
        )
    specimen = machine.specimen(streams[_SPECIMEN])
    campaign_seed = int(streams[_CAMPAIGN].integers(2**31))
    setups = Setups(machine, specimen, campaign_seed, sessions=int(rng.integers(1, 3)))
    for left in reversed(range(NOISES)):
        try:
            found = draft(seat.stratum, setups, rng, partial(_hidden, noise_seed=noise_seed))
            break
        except UndrawnError:  # with few readings the noise alone may look like a misfit
            if not left or seat.stratum != schedule.CONCEALED:
                raise
            noise_seed = int(streams[_NOISE].integers(2**31))
    return _written(seat, found, Decoy(), noise_seed)


def _hidden(found: Draft, noise_seed: int) -> bool:
    """Whether the free fit of the very recording looks good."""
    change = np.sum([part.change for part in found.parts], axis=0)
    if found.setup.bench.misfit_when_free(change) > LIKELY:
        return False
    observed = _observed(found, Decoy(), noise_seed)
    machine = found.setup.read[0]
    try:
        free = ordinary_fits(machine, found.setup.recording(observed))[1]
    except ConvergenceError:  # a fit that finds no minimum hides nothing
        return False
    return free.chi2_per_dof < CONCEALED


def _observed(found: Draft, kind: Decoy, noise_seed: int) -> Array:
    setup, rng = found.setup, np.random.default_rng(noise_seed)
    return noisy(setup.machine, setup.exact(found.imperfections)[0], setup.campaign, rng, kind)


def _written(seat: schedule.Seat, found: Draft, kind: Decoy, noise_seed: int) -> Case:
    setup, simulated = found.setup, found.setup.machine
    observed = _observed(found, kind, noise_seed)
    held_exact = setup.exact(found.imperfections)[1]
    held_text = _without(recording_text(simulated, setup.held, held_exact), simulated.columns)
    machine, recording = setup.read[0], setup.recording(observed)
    held = _held_out(machine, simulated, held_exact)
    before, free = ordinary_fits(machine, recording)
    geometry = _geometry(found, before)
    solution = Solution(
        case=seat.name,
        machine=seat.machine,
        stratum=seat.stratum,
        variant=seat.variant if not kind.tails else f"{seat.variant} ({kind.tails})",
        truths=_truths(found),
        concealed=bool(found.parts) and free.chi2_per_dof < CONCEALED,
        free_chi2_per_dof=free.chi2_per_dof,
        aliases={limb.name: limb.reading for limb in machine.mechanism.limbs},
        geometry=geometry,
        held_out=held,
        before=reference(before, recording, held_text, held, geometry),
        oracle=None,
        noise=kind.noise,
        tolerance_scale=kind.tolerance,
    )
    solution = replace(solution, oracle=_oracle(found, before, recording, held_text, solution))
    text = recording_text(simulated, setup.campaign, observed)
    return Case(simulated.machine_text(), text, held_text, solution)


def _without(text: str, columns: Sequence[str]) -> str:
    """The table without some columns: what a prediction starts from holds no readings."""
    table = pd.read_csv(io.StringIO(text), dtype=str, keep_default_na=False)
    return str(table.drop(columns=list(columns)).to_csv(index=False))


def _held_out(machine: Machine, simulated: SimulatedMachine, exact: Array) -> HeldOut:
    sigma = tuple(channel.sigma for channel in machine.channels)
    truth = tuple(tuple(row) for row in exact.tolist())
    return HeldOut(simulated.columns, simulated.column_units, sigma, truth)


def _truths(found: Draft) -> tuple[Truth, ...]:
    names = [
        (kind.slug, part.imperfection.place) for kind, part in zip(found.kinds, found.parts, strict=True)
    ]
    out = []
    for k, (kind, part) in enumerate(zip(found.kinds, found.parts, strict=True)):
        beside = [other.change for j, other in enumerate(found.parts) if j != k]
        true = names[k] if kind.in_library else None
        ranked = rivals(found.setup.bench, part.change, beside)
        thing = part.imperfection
        out.append(
            Truth(
                kind=kind.name,
                effect=kind.slug,
                place=thing.place,
                size=thing.size,
                typical=kind.typical,
                limit=part.limit,
                snr=part.snr,
                shape={key: float(value) for key, value in thing.shape.items()},
                equivalents=tuple(equivalents(found.setup.bench, ranked, true, names[:k] + names[k + 1 :])),
                misfit=misfit(found.setup.bench, ranked, true),
            )
        )
    return tuple(out)


def _geometry(found: Draft, before: Estimate) -> Geometry:
    """Constants of finite tolerance, and what the readings know of them."""
    free = before.prior.free
    finite = np.isfinite(before.prior.sigma[free])
    seen = before.factor[:, : len(free)]
    unknown = np.linalg.qr(seen[:, ~finite])[0]
    seen = seen[:, finite] - unknown @ (unknown.T @ seen[:, finite])
    values, vectors = np.linalg.eigh(seen.T @ seen)
    names = [before.prior.names[k] for k in free[finite]]
    nominal = before.prior.mean[free[finite]]
    true = found.setup.specimen.parameters
    return Geometry(
        tuple(names),
        tuple(float(true.get(name, value)) for name, value in zip(names, nominal, strict=True)),
        tuple(before.prior.sigma[free[finite]].tolist()),
        tuple(tuple(row) for row in vectors[:, values > DETERMINED].T.round(9).tolist()),
    )


def _oracle(
    found: Draft, before: Estimate, recording: Recording, held_text: str, solution: Solution
) -> Reference | None:
    """Told everything but the sizes; where nothing is missing the fit without effects is that."""
    if not found.parts:
        return solution.before
    terms: list[PlacedEffect] = []
    for k, (kind, part) in enumerate(zip(found.kinds, found.parts, strict=True)):
        beside = [other.change for j, other in enumerate(found.parts) if j != k]
        place = part.imperfection.place
        own = (
            oracle_terms(found.setup.bench, kind.slug, place, part.change, beside) if kind.in_library else ()
        )
        if not own:
            return None
        terms += own
    fit = oracle(before.machine, recording, terms, before.p)
    if fit is None:
        return None
    return reference(fit, recording, held_text, solution.held_out, solution.geometry)


__all__ = ["Case", "draw_case"]
