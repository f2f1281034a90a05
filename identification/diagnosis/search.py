"""The search: posterior, nonlinear fit at its mode, posterior again from there, until the mode stays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from truepose.errors import ConvergenceError
from truepose.identification import prior
from truepose.identification.diagnosis.selection_problem import SelectionProblem, selection_problem
from truepose.identification.fit.estimate import Estimate, estimate
from truepose.identification.posterior.mode import climbed
from truepose.identification.posterior.posterior import LONG_SET, ROUNDS, Posterior, Sampling, mode
from truepose.identification.posterior.state import State
from truepose.identification.signatures.candidates import Catalogue
from truepose.identification.signatures.linearisation import Linearisation, Signatures
from truepose.identification.signatures.refine import refined
from truepose.models.effects.base import PlacedEffect

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
CLIMBS, MOVES = 4, 2
"""Most expansion points that are climbed to, and most that follow from a posterior that was drawn."""
ROUGH = 1e-2
"""What a fit may leave to gain of half its sum of squares where it is an expansion point only."""
REFINED = 2
"""How often continuous settings are refined."""


@dataclass(frozen=True)
class Found:
    """The posterior at its last expansion point, its mode, and the nonlinear fit with what the mode holds.

    accepted: candidates of the fit (index to spread, in scales), those that the file states among them; first: the problem at
    the fit without effects, and its linearisation.
    """

    problem: SelectionProblem
    posterior: Posterior
    mode: State
    accepted: Mapping[int, float]
    fit: Estimate
    linearisation: Linearisation
    signatures: Signatures
    catalogue: Catalogue
    first: SelectionProblem
    linearisation_before: Linearisation


def search(signatures: Signatures, cat: Catalogue, null: Estimate, exclude: Mask, rms: float) -> Expansion:
    """Where the mode stays, from the fit without effects; ``exclude`` (n,) are rows left out, ``rms`` that of the ordinary
    whitened residual."""
    state = Expansion(signatures, cat, null, dict.fromkeys(cat.stated, prior.STATED), exclude, rms)
    for k in range(CLIMBS):
        if k and not state.short:
            break  # near enough: every further fit would take long
        moved = state.moved(climbed(state.spike_slab, prior.RICHNESS, state.known))
        if moved is None:
            break
        state = moved
    for _ in range(MOVES if state.short else 0):
        moved = state.moved(state.sampled(rounds=1)[1])
        if moved is None:
            break
        state = moved
    return state


class Expansion:
    """A fit, all candidates there, and the likeliest states found before in the numbers of this problem."""

    def __init__(
        self, signatures: Signatures, cat: Catalogue, fit: Estimate, accepted: Mapping[int, float], exclude: Mask,
        rms: float, refined: int = 0, before: tuple[Expansion, State] | None = None,
    ) -> None:  # fmt: skip
        self.signatures, self.catalogue, self.fit, self.accepted = signatures, cat, fit, accepted
        self.linearisation = signatures.linearise(fit)
        self.problem = selection_problem(self.linearisation, cat, rms)
        self.spike_slab = self.problem.spike_slab.compressed()
        here = self.problem, self.linearisation
        self.first: tuple[SelectionProblem, Linearisation] = here if before is None else before[0].first
        self.known = [] if before is None else _renumbered(before[0].problem, before[1], self.problem)
        self.exclude, self._rms, self._refined = exclude, rms, refined

    @property
    def short(self) -> bool:
        """Whether its set has few columns, so that all is quick."""
        return sum(len(self.catalogue.candidates[i].coefficients) for i in self.accepted) <= LONG_SET

    @cached_property
    def _sampling(self) -> Sampling:
        return Sampling(self.spike_slab, prior.RICHNESS, known=self.known)

    def sampled(self, rounds: int = ROUNDS) -> tuple[Posterior, State]:
        """The posterior at this point, and its mode; more rounds go on from fewer."""
        found = self._sampling.posterior(rounds)
        return found, mode(found, self.spike_slab)

    def found(self) -> Found:
        """The posterior here, drawn to the end."""
        posterior, best = self.sampled()
        own = self.accepted, self.fit, self.linearisation, self.signatures, self.catalogue
        return Found(self.problem, posterior, best, *own, *self.first)

    def moved(self, best: State) -> Expansion | None:
        """At the fit with another set, with finer settings around its own; None where there is nothing new, or no minimum."""
        wanted = dict.fromkeys(self.catalogue.stated, prior.STATED) | chosen(self.problem, best)
        cat, signatures = self.catalogue, self.signatures
        finer = refined(signatures.machine, cat, wanted) if self._refined < REFINED else cat
        if set(wanted) == set(self.accepted) and finer is cat:
            return None
        try:
            fit = refitted(self, wanted) if set(wanted) != set(self.accepted) else self.fit
        except ConvergenceError:
            return None
        if finer is not cat:
            signatures = signatures.of(finer.candidates)
        count = self._refined + (finer is not cat)
        return Expansion(signatures, finer, fit, wanted, self.exclude, self._rms, count, (self, best))


def _renumbered(problem: SelectionProblem, state: State, now: SelectionProblem) -> list[State]:
    """A state in the numbers of another problem whose terms hold the same candidates."""
    number = {own: k for k, own in enumerate(now.candidates)}
    members = [(number.get(problem.candidates[term]), size) for term, size in state.members]
    kept = tuple((term, size) for term, size in members if term is not None)
    return [State(kept, now.spike_slab.unknowns.nearest(state.point), 0.0)]


def chosen(problem: SelectionProblem, state: State) -> dict[int, float]:
    """Candidates of a state with their spreads, in scales."""
    sizes = problem.spike_slab.sizes.values
    return {problem.candidates[term]: float(sizes[size]) for term, size in state.members}


def refitted(here: Expansion, wanted: Mapping[int, float]) -> Estimate:
    """The nonlinear fit with other candidates, from the present one."""
    machine, recording = here.signatures.machine, here.signatures.recording
    terms = [replace(here.catalogue.candidates[i], spread=spread) for i, spread in wanted.items()]
    start = start_from(here.fit, terms)
    return estimate(machine, recording, terms, start=start, exclude=here.exclude, tolerance=ROUGH)


def start_from(fit: Estimate, terms: Sequence[PlacedEffect]) -> Array:
    """Start of a fit with these effects: parameters and amplitudes of another fit, zero for effects that it has not."""
    known = {e.label: e.amplitudes for e in fit.fitted_effects()}
    amplitudes = [known.get(t.label, np.zeros(len(t.coefficients))) for t in terms]
    return np.concatenate([fit.p[: len(fit.machine.parameters)], *amplitudes])
