"""The search: posterior, nonlinear fit at its mode, posterior again from there, until the mode stays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truepose.errors import ConvergenceError
from truepose.identification.diagnosis import prior
from truepose.identification.diagnosis.candidates import Catalogue
from truepose.identification.diagnosis.refine import refined
from truepose.identification.diagnosis.signatures import Linearisation, Signatures
from truepose.identification.diagnosis.weighed import WIDE, Weighed, weighed
from truepose.identification.fit.estimate import Estimate, estimate
from truepose.identification.posterior.mode import State
from truepose.identification.posterior.posterior import Posterior, mode, sample

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
ROUNDS = 5
"""Most expansion points."""


@dataclass(frozen=True)
class Found:
    """The posterior at its last expansion point, its mode, and the nonlinear fit with what the mode holds.

    accepted: candidates of the fit (index to spread, in scales), those that the file states among them; first: the problem at
    the fit without effects, and its linearisation.
    """

    weighed: Weighed
    posterior: Posterior
    mode: State
    accepted: Mapping[int, float]
    fit: Estimate
    linearisation: Linearisation
    signatures: Signatures
    catalogue: Catalogue
    first: Weighed
    linearisation_before: Linearisation


def search(signatures: Signatures, cat: Catalogue, null: Estimate, exclude: Mask, rms: float) -> Found:
    """From the fit without effects; ``exclude`` (n,) are rows left out, ``rms`` that of the ordinary whitened residual."""
    accepted: dict[int, float] = dict.fromkeys(cat.stated, WIDE)
    fit, known, impossible = null, list[State](), set[int]()
    first: tuple[Weighed, Linearisation] | None = None
    for _ in range(ROUNDS):
        lin = signatures.linearise(fit)
        problem = weighed(lin, cat, rms, impossible)
        first = first or (problem, lin)
        posterior = sample(problem.weighing, prior.RICHNESS, known=known)
        best = mode(problem.weighing, prior.RICHNESS, posterior)
        found = Found(problem, posterior, best, accepted, fit, lin, signatures, cat, *first)
        wanted = dict.fromkeys(cat.stated, WIDE) | chosen(problem, best)
        finer = refined(signatures.machine, cat, wanted)
        if set(wanted) == set(accepted) and finer is cat:
            break
        try:
            fit, accepted = refitted(found, wanted, exclude, impossible), wanted
        except ConvergenceError:
            break
        known = [best]
        if finer is not cat:
            cat, signatures, known = finer, signatures.of(finer.candidates), []
    return found


def chosen(problem: Weighed, state: State) -> dict[int, float]:
    """Candidates of a state with their spreads, in scales."""
    sizes = problem.weighing.sizes.values
    return {i: float(sizes[size]) for term, size in state.members for i in problem.candidates[term]}


def refitted(found: Found, wanted: Mapping[int, float], exclude: Mask, impossible: set[int]) -> Estimate:
    """The nonlinear fit with other candidates, from the present one."""
    machine, recording = found.signatures.machine, found.signatures.recording
    terms = [replace(found.catalogue.candidates[i], spread=spread) for i, spread in wanted.items()]
    known = {e.label: e.amplitudes for e in found.fit.fitted_effects()}
    start = np.concatenate(
        [
            found.fit.p[: len(machine.parameters)],
            *[known.get(t.label, np.zeros(len(t.coefficients))) for t in terms],
        ]
    )
    return estimate(machine, recording, terms, start=start, exclude=exclude)
