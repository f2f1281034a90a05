"""The key to a case: what the examiner works out from exact readings and fits of its own.

What the product's model must be asked (imitations, ordinary fits, the oracle) may fail: the case stays, and the key says
what is missing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from challenge.empirical import best_empirical
from challenge.nulls import Decoy
from challenge.perfect import of_sensor
from challenge.references import free_fit, oracle, oracle_terms, ordinary_fit, reference
from challenge.rivals import equivalents, misfit, rivals
from challenge.schedule import Seat
from challenge.setup import Setup
from challenge.simulator.base import SimulatedMachine
from challenge.sizing import LIMIT_SNR
from challenge.solutions import CONCEALED, Geometry, HeldOut, Reference, Solution, Table, Truth
from challenge.strata import Draft
from challenge.tool_pose import point_columns
from truepose.errors import TrueposeError
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.common import OF_ROWS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SEEN = 0.9 * LIMIT_SNR
"""Signal-to-noise ratio from which on names are weighed against each other."""
DETERMINED = 1.0
"""Information of a combination, in tolerances, from which on readings know it better than the drawing."""


def key(
    seat: Seat, found: Draft, kind: Decoy, observed: Array, wild: Mask, stated: str, held_text: str
) -> Solution:
    """Everything about a case: readings (n, k), wild rows (n,), the drawing and the held-out rows as the engine sees them."""
    setup = found.setup
    exact_held = setup.exact(found.imperfections)[1]
    held, geometry = _held_out(setup, exact_held), _geometry(setup)
    chi2 = free_chi2(found, observed, wild, kind)
    machine, recording = setup.loaded(stated, observed)
    before = ordinary_fit(machine, recording)
    calm = ordinary_fit(machine, recording, wild) if wild.any() else before
    free = None if calm is None else free_fit(machine, recording, calm.p, wild)
    out = Solution(
        case=seat.name,
        machine=seat.machine,
        stratum=seat.stratum,
        variant=f"{seat.variant} ({kind.tails})" if kind.tails else seat.variant,
        truths=_truths(found),
        concealed=any(kind.slug not in OF_ROWS for kind in found.kinds) and chi2 < CONCEALED,
        free_chi2_per_dof=None if free is None else free.chi2_per_dof,
        aliases={limb.name: limb.reading for limb in machine.mechanism.limbs},
        geometry=geometry,
        held_out=held,
        before=_referred(before, recording, held_text, held, geometry),
        oracle=None,
        noise=kind.noise,
        tolerance_scale=kind.tolerance,
        free_chi2_linear=chi2,
        empirical=best_empirical(setup, observed, exact_held, ~wild),
        wild=_numbers(wild & ~setup.campaign.validation),
        rows=_numbers(~setup.campaign.validation),
        simulator=_simulator(setup.machine),
        tool=perfect_readings(found, exact_held),
    )
    told = _oracle(found, observed, wild, held_text, out)
    absent = {"ordinary fit": before, "free fit": free, "imitations": setup.known, "oracle": told}
    return replace(out, oracle=told, missing=tuple(name for name, it in absent.items() if it is None))


def free_chi2(found: Draft, observed: Array, wild: Mask, kind: Decoy) -> float:
    """chi2 per degree of freedom, in the stated sigma, of the ordinary free fit to first order."""
    bench = found.setup.bench
    return kind.noise**2 * bench.free_chi2(bench.change(observed), ~wild)


def _simulator(machine: SimulatedMachine) -> str:
    """The package of the examination that a machine is of, else its module."""
    module = type(machine).__module__
    return module.removeprefix("challenge.").split(".")[0]


def _numbers(rows: Mask) -> tuple[int, ...]:
    """Of some rows (n,), from 1."""
    return tuple(int(row) + 1 for row in np.flatnonzero(rows))


def _held_out(setup: Setup, exact: Array) -> HeldOut:
    truth = tuple(tuple(row) for row in exact.tolist())
    return HeldOut(setup.machine.columns, setup.machine.column_units, tuple(setup.sigma.tolist()), truth)


def perfect_readings(found: Draft, exact: Array) -> Table | None:
    """Held-out readings (h, k) of a perfect instrument, where they are points; ``exact`` are those of the true one."""
    if not point_columns(found.setup.machine.columns):
        return None
    kept = [
        thing
        for thing, kind in zip(found.imperfections, found.kinds, strict=True)
        if kind.slug not in OF_ROWS and not of_sensor(thing.place)
    ]
    read = exact if len(kept) == len(found.imperfections) else found.setup.exact(kept)[1]
    return tuple(tuple(row) for row in read.tolist())


def _truths(found: Draft) -> tuple[Truth, ...]:
    bench, known = found.setup.bench, found.setup.known
    names = [
        (kind.slug, part.imperfection.place) for kind, part in zip(found.kinds, found.parts, strict=True)
    ]
    families = found.families or ("",) * len(names)
    out = []
    for k, (kind, part) in enumerate(zip(found.kinds, found.parts, strict=True)):
        beside = _others(found, k)
        true, thing = (names[k] if kind.in_library else None), part.imperfection
        seen_beside = bench.snr(part.change, beside)
        # of what others swallow nothing is left that could tell names apart, and nothing of what is too faint
        others = beside if seen_beside >= SEEN else ()
        ranked = rivals(known, part.change, others) if known and part.snr >= SEEN else ()
        alike = equivalents(known, ranked, true, names[:k] + names[k + 1 :]) if known else ()
        out.append(
            Truth(
                kind=kind.name,
                effect=kind.slug,
                place=thing.place,
                size=thing.size,
                typical=kind.typical,
                limit=part.limit,
                snr=part.snr,
                shape={name: float(value) for name, value in thing.shape.items()},
                equivalents=tuple(alike),
                misfit=misfit(known, ranked, true) if known else None,
                snr_beside=seen_beside,
                family=families[k],
            )
        )
    return tuple(out)


def _others(found: Draft, k: int) -> list[Array]:
    """(N,) what all others do to the readings."""
    return [other.change for j, other in enumerate(found.parts) if j != k]


def _geometry(setup: Setup) -> Geometry:
    """Constants of finite tolerance, and what the readings know of them beside those without one."""
    weight = setup.bench.weight
    bound = weight > 0
    unknown = np.linalg.qr(setup.bench.jacobian[:, ~bound])[0]
    seen = setup.bench.jacobian[:, bound]
    seen = seen - unknown @ (unknown.T @ seen)
    values, vectors = np.linalg.eigh(seen.T @ seen)
    own = [c for c in setup.free if c.weight > 0]
    return Geometry(
        tuple(c.name for c in own),
        tuple(float(setup.specimen.parameters[c.name]) for c in own),
        tuple(c.step for c in own),
        tuple(tuple(row) for row in vectors[:, values > DETERMINED].T.round(9).tolist()),
    )


def _oracle(
    found: Draft, observed: Array, wild: Mask, held_text: str, solution: Solution
) -> Reference | None:
    """Told everything but the sizes, or without effects where these predict worse: the rows may leave a term's settings
    open, and whoever knows the truth need not take them."""
    setup = found.setup
    machine, recording = setup.loaded(setup.machine.machine_text(), observed)
    terms: list[PlacedEffect] = []
    for k, (kind, part) in enumerate(zip(found.kinds, found.parts, strict=True)):
        own: tuple[PlacedEffect, ...] = ()
        if setup.known is not None and kind.in_library:
            place = part.imperfection.place
            own = oracle_terms(setup.known, kind.slug, place, part.change, _others(found, k))
        if not own:
            return None
        terms += own
    plain = ordinary_fit(machine, recording, wild)
    starts = [] if plain is None else [plain.p]
    told = oracle(machine, recording, terms, [*starts, _true(setup)], wild) if terms else None
    told_of = (held_text, solution.held_out, solution.geometry)
    errors = [_referred(fit, recording, *told_of) for fit in (told, plain)]
    known = [e for e in errors if e is not None and e.held_out is not None]
    return min(known, key=lambda e: e.held_out or 0.0) if known and (told or not terms) else None


def _true(setup: Setup) -> Array:
    """(np,) the specimen's constants in the drawing's order."""
    known = setup.specimen.parameters
    return np.array([known.get(p.name, p.nominal) for p in setup.read[0].parameters])


def _referred(
    fit: Estimate | None, recording: Recording, held_text: str, held: HeldOut, geometry: Geometry
) -> Reference | None:
    """Errors of a fit; None without one, and where its prediction fails."""
    if fit is None:
        return None
    try:
        return reference(fit, recording, held_text, held, geometry)
    except TrueposeError:
        return None


__all__ = ["free_chi2", "key", "perfect_readings"]
