"""The search: posterior, nonlinear fit at its mode, posterior again from there, until the mode stays.

Long recordings: the search begins with some of the rows, and goes on with ten times as many until it has all.

What an effect of note does shows in some thousand rows; what the others add is precision. So most expansion points are found
where a pass over the rows is short, and few passes are over all. Every set that the first rows speak for is weighed again
with more of them, and candidates are the same throughout: those of the whole recording.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from truepose.arrays import Array, Mask
from truepose.errors import ConvergenceError
from truepose.identification import prior
from truepose.identification.diagnosis.null_fits import Fits, outlying_rows, refitted
from truepose.identification.diagnosis.selection_problem import (
    SelectionProblem,
    selection_problem,
    weighed_alone,
)
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.posterior import ROUNDS, Posterior, Sampling, mode
from truepose.identification.posterior.spike_slab import LONG_SET, SpikeSlab
from truepose.identification.posterior.state import State, tops
from truepose.identification.prior import STATED
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue
from truepose.identification.signatures.linearisation import Linearisation
from truepose.identification.signatures.lines import proposed, refined
from truepose.identification.signatures.products import proposed_products
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine

CLIMBS, MOVES = 4, 2
"""Most expansion points that are climbed to, and most that follow from a posterior that was drawn."""
SEARCHING = 15e9
"""Operations at expansion points after which none follows any more."""
ROUGH = 1e-2
"""What a fit may leave to gain of half its sum of squares where it is an expansion point only."""
REFINED = 2
"""How often continuous settings are refined."""


@dataclass(frozen=True)
class Found:
    """The posterior at its last expansion point, its mode, and the nonlinear fit with what the mode holds.

    accepted: candidates of the fit (index to spread, in scales), those that the file states among them; alone (c,): log Bayes
    factor of each candidate alone at the fit without effects; linearisation_before: of geometry, there.
    """

    problem: SelectionProblem
    posterior: Posterior
    mode: State
    accepted: Mapping[int, float]
    fit: Estimate
    linearisation: Linearisation
    signatures: Signatures
    catalogue: Catalogue
    alone: Array
    linearisation_before: Linearisation
    halves: tuple[Linearisation, Linearisation] | None = None
    """Of the rows in two halves, where the same pass summed these up."""

    def typical(self, value: Callable[[GridPoint], ArrayLike]) -> Array:
        """Return the geometric mean over the posterior of what a point of the grid stands for."""
        logs = [share * np.log(value(point)) for point, share in self.posterior.points]
        return np.asarray(np.exp(sum(logs[1:], logs[0])))


def search(signatures: Signatures, cat: Catalogue, fits: Fits, stop: Callable[[], bool]) -> Expansion:
    """Return where the mode stays, from the fit without effects; ``stop`` as in ``Start``."""
    signatures, cat = prepared(signatures, fits.before, cat)
    stated = dict.fromkeys(cat.stated, prior.STATED)
    return settled(Start(signatures, cat, fits.before, stated, fits.outliers, fits.rms, stop=stop))


def prepared(signatures: Signatures, fit: Estimate, cat: Catalogue) -> tuple[Signatures, Catalogue]:
    """With the lines that a fit leaves among the candidates, and long series in the directions that its readings see."""
    more = proposed_products(signatures, fit, proposed(signatures, fit, cat))
    if more is not cat:
        signatures = signatures.of(more.candidates)
    return signatures.seen_from(fit), more


def settled(start: Start) -> Expansion:
    """Where the mode stays, from a start."""
    state, spent = Expansion(start), 0.0
    for most, drawn in ((CLIMBS, False), (MOVES, True)):
        for _ in range(most):
            enough = not state.short and (spent or drawn)
            if enough or spent > SEARCHING or start.stop():
                break  # near enough: every further fit would take long
            own = state.spike_slab, state.problem.richness, state.known
            moved = state.moved(state.sampled(rounds=1)[1] if drawn else tops(*own)[0])
            if moved is None:
                break
            spent += state.work
            del state, own  # before the next one, for its matrices are large
            state = Expansion(moved)
    return state


@dataclass(frozen=True)
class Start:
    """A fit to expand at, with the candidates that it holds (``accepted``: index to spread, in scales).

    alone: log Bayes factor (c,) of each candidate alone, bare: geometry's linearisation, both at the fit without effects and
    None where that is this one; known: the likeliest state found before.
    """

    signatures: Signatures
    catalogue: Catalogue
    fit: Estimate
    accepted: Mapping[int, float]
    exclude: Mask
    rms: float
    refined: int = 0
    alone: Array | None = None
    bare: Linearisation | None = None
    known: State | None = None
    halved: bool = False
    """Whether both halves of the rows are summed up beside the whole, because a pass of their own would take long."""
    stop: Callable[[], bool] = lambda: False
    """Whether somebody asked the search to end with what it has."""


class Expansion:
    """All candidates at a fit, and the likeliest state found before in the numbers of this problem."""

    def __init__(self, start: Start) -> None:
        self.start, self.fit = start, start.fit
        self.signatures, self.catalogue = start.signatures, start.catalogue

    @cached_property
    def _passed(self) -> tuple[Linearisation, tuple[Linearisation, Linearisation] | None]:
        """Of all rows, and of each half where the same pass sums these up; not before somebody asks, for it takes long."""
        if self.start.halved:
            return self.signatures.halved(self.fit)
        return self.signatures.linearise(self.fit), None

    @property
    def linearisation(self) -> Linearisation:
        """Of all rows."""
        return self._passed[0]

    @cached_property
    def problem(self) -> SelectionProblem:
        """What is weighed here."""
        return selection_problem(self.linearisation, self.catalogue, self.start.rms)

    @cached_property
    def spike_slab(self) -> SpikeSlab:
        """The same in the directions that readings see."""
        return self.problem.spike_slab.compressed()

    @cached_property
    def known(self) -> list[State]:
        """The likeliest state found before, if any, in the numbers of this problem."""
        state = self.start.known  # its terms are the same: more candidates of a catalogue stand at its end
        if state is None:
            return []
        return [State(state.members, self.problem.spike_slab.unknowns.nearest(state.point), 0.0)]

    @cached_property
    def alone(self) -> Array:
        """(c,) log Bayes factor of each candidate alone, at the fit without effects where that was expanded at."""
        known = self.start.alone
        return weighed_alone(self.problem, len(self.catalogue.candidates)) if known is None else known

    @property
    def bare(self) -> Linearisation:
        """Of geometry, at the fit without effects."""
        return self.linearisation.bare() if self.start.bare is None else self.start.bare

    def terms(self, wanted: Mapping[int, float]) -> list[PlacedEffect]:
        """Candidates (index to spread, in scales) as terms of a fit."""
        return [replace(self.catalogue.candidates[i], spread=spread) for i, spread in wanted.items()]

    @property
    def short(self) -> bool:
        """Whether its set has few columns, so that all is quick."""
        return sum(len(self.catalogue.candidates[i].coefficients) for i in self.start.accepted) <= LONG_SET

    @cached_property
    def _sampling(self) -> Sampling:
        return Sampling(self.spike_slab, self.problem.richness, known=self.known, stop=self.start.stop)

    @property
    def work(self) -> float:
        """Operations that climbs and chains took here."""
        return self.spike_slab.work + (self._sampling.work if "_sampling" in self.__dict__ else 0.0)

    def sampled(self, rounds: int = ROUNDS) -> tuple[Posterior, State]:
        """The posterior at this point, and its mode; more rounds go on from fewer."""
        found = self._sampling.posterior(rounds)
        return found, mode(found, self.spike_slab)

    def found(self) -> Found:
        """The posterior here, drawn to the end."""
        posterior, best = self.sampled()
        self.problem.spike_slab.forget()
        own = self.start.accepted, self.fit, self.linearisation, self.signatures, self.catalogue
        later = np.full(len(self.catalogue.candidates) - len(self.alone), -np.inf)
        alone = np.append(self.alone, later)
        return Found(self.problem, posterior, best, *own, alone, self.bare, self._passed[1])

    def moved(self, best: State) -> Start | None:
        """The fit with another set, with finer settings around its own; None where there is nothing new, or no minimum."""
        wanted = dict.fromkeys(self.catalogue.stated, prior.STATED) | chosen(self.problem, best)
        start, cat, signatures = self.start, self.catalogue, self.signatures
        finer = refined(signatures.machine, cat, wanted) if start.refined < REFINED else cat
        if set(wanted) == set(start.accepted) and finer is cat:
            return None
        fit = self.fit
        try:
            if set(wanted) != set(start.accepted):
                fit = _refitted(self, wanted, noise_at(self.problem, best), start.exclude)
        except ConvergenceError:
            return None
        count = start.refined + (finer is not cat)
        finer = proposed_products(signatures, fit, proposed(signatures, fit, finer))
        if finer is not cat:
            signatures = signatures.of(finer.candidates).seen_from(fit)
        own = start.exclude, start.rms, count, self.alone, self.bare, best, start.halved, start.stop
        return Start(signatures, finer, fit, wanted, *own)

    def without(self, exclude: Mask, null: Estimate, rms: float) -> Start | None:
        """A start for a search with other rows left out, from this one's end; ``null`` is the fit without effects to them.

        None where nothing was found yet, or where there is no minimum.
        """
        start, signatures = self.start, self.signatures
        if start.known is None:
            return None
        bare = Signatures(signatures.machine, signatures.recording, ()).linearise(null).bare()
        try:
            fit = _refitted(self, start.accepted, self.fit.noise, exclude)
        except ConvergenceError:
            return None
        return replace(start, fit=fit, exclude=exclude, rms=rms, alone=self.alone, bare=bare)


def chosen(problem: SelectionProblem, state: State) -> dict[int, float]:
    """Candidates of a state with their spreads, in scales."""
    sizes = problem.spike_slab.sizes.values
    return {problem.candidates[term]: float(sizes[size]) for term, size in state.members}


def noise_at(problem: SelectionProblem, state: State) -> float:
    """Noise of a state in stated sigmas: the mean over kinds of readings, for what is expected beside them has but one."""
    scales = problem.spike_slab.unknowns.scales(state.point)
    return float(np.exp(np.average(np.log(scales), weights=problem.spike_slab.design.counts)))


def _refitted(here: Expansion, wanted: Mapping[int, float], noise: float, exclude: Mask) -> Estimate:
    """The nonlinear fit with other candidates, or other rows left out, from the present one, to readings as noisy as that."""
    machine, recording = here.signatures.machine, here.signatures.recording
    terms = here.terms(wanted)
    start = start_from(here.fit, terms)
    return estimate(machine, recording, terms, start=start, exclude=exclude, tolerance=ROUGH, noise=noise)


def start_from(fit: Estimate, terms: Sequence[PlacedEffect]) -> Array:
    """Start of a fit with these effects: parameters and amplitudes of another fit, zero for effects that it has not."""
    known = {e.label: e.amplitudes for e in fit.fitted_effects()}
    amplitudes = [known.get(t.label, np.zeros(len(t.coefficients))) for t in terms]
    return np.concatenate([fit.p[: len(fit.nominal.parameters)], *amplitudes])


MANY, SPARED, STEP = 20_000, 2.0, 10.0
"""Calibration rows that a search begins with where there are more than so many times as many, and how many times more follow
at most. Cost alone."""
ROWS_SEED = 23
FITTING, WEIGHING = "fitting", "weighing"
"""How it is told what goes on with more rows."""


def stages(machine: Machine, recording: Recording) -> list[Recording]:
    """The rows that a search has, one stage after another; the last has all.

    One row is drawn of each few that follow each other, so that no motion is in step with them. Where a reading compares rows
    a part of them says something else, and there is one stage.
    """
    out, rows = [recording], recording.in_time(~recording.validation)
    if any(sensor.compares or sensor.differs_from_row for sensor in machine.sensors):
        return out
    rng = np.random.default_rng(ROWS_SEED)
    for count in fewer_rows(len(rows)):
        edges = np.linspace(0, len(rows), count + 1).astype(np.int64)
        rows = rows[edges[:-1] + rng.integers(0, np.diff(edges))]
        out.insert(0, recording.subset(np.sort(rows)))
    return out


def fewer_rows(rows: int) -> list[int]:
    """How many rows the stages before all of them have, the largest first: from ``MANY`` on always the same times more."""
    times = rows / MANY
    if times <= SPARED:
        return []
    further = int(np.ceil(np.log(times) / np.log(STEP)))
    return [round(MANY * times ** (k / further)) for k in reversed(range(further))]


def sizes(machine: Machine, recording: Recording) -> list[int]:
    """How many rows each stage after the first has."""
    return [len(rows) for rows in stages(machine, recording)[1:]]


def first(fits: Fits, cat: Catalogue, stop: Callable[[], bool]) -> tuple[Fits, Expansion]:
    """The fits without effects, and where the mode stays, by a search of their rows from nothing; once more where other rows
    are far off beside what it finds. ``stop``: whether somebody asked for an end."""
    machine, recording = fits.before.nominal, fits.before.recording
    signatures = Signatures(machine, recording, cat.candidates)
    near = search(signatures, cat, fits, stop)
    again = _far(near.fit, recording)
    if np.array_equal(again, fits.outliers) or stop():
        return fits, near
    fits = refitted(machine, recording, fits, again)
    # a short one is quick from nothing; a long one stays where it is: chains climb from there, too
    start = None if near.short else near.without(again, fits.before, fits.rms)
    del near
    if start is not None:
        return fits, Expansion(start)
    return fits, search(signatures, cat, fits, stop)


def further(
    near: Expansion, fits: Fits, recording: Recording, progress: Callable[[str], None]
) -> tuple[Fits, Expansion]:
    """The fits without effects, and where the mode stays, with more rows; from where it stayed with fewer.

    Where its set has no minimum with all of them, the search begins from what the file states. It goes on once more where
    other rows are far off beside what it finds.
    """
    machine = near.signatures.machine
    progress(f"{FITTING} {len(recording):,} rows")
    far, fit = _fitted(near, recording)
    fits = refitted(machine, recording, fits, far)
    cat, begins = near.catalogue, fits.before if fit is None else fit
    signatures, cat = prepared(Signatures(machine, recording, cat.candidates), begins, cat)
    progress(f"{WEIGHING} {len(recording):,} rows with {len(cat.candidates)} explanations")
    accepted, known = near.start.accepted, near.start.known
    if fit is None:
        accepted, known = dict.fromkeys(cat.stated, STATED), None
    bare = Signatures(machine, recording, ()).linearise(fits.before).bare()
    own, whole = (far, fits.rms, near.start.refined, None, bare, known), len(recording.whole)
    begun = Start(signatures, cat, begins, accepted, *own, len(recording) == whole, near.start.stop)
    del near
    near = settled(begun)
    again = _far(near.fit, recording)
    if np.array_equal(again, far) or near.start.stop():
        return fits, near
    others = refitted(machine, recording, fits, again)
    start = near.without(again, others.before, others.rms)
    if start is None:
        return fits, near
    del near
    return others, settled(start)


def _fitted(near: Expansion, recording: Recording) -> tuple[Mask, Estimate | None]:
    """Rows (n,) that are far off beside what was found with fewer, and the fit with it to the others; None if it has none."""
    machine, terms = near.signatures.machine, near.terms(near.start.accepted)
    begin = start_from(near.fit, terms)
    fitted = partial(estimate, machine, recording, terms, start=begin, noise=near.fit.noise)
    far = _far(fitted(tolerance=np.inf), recording)
    try:
        return far, fitted(exclude=far, tolerance=ROUGH)
    except ConvergenceError:
        return far, None


def _far(fit: Estimate, recording: Recording) -> Mask:
    """Rows (n,) that were to be fitted and are far off."""
    return outlying_rows(fit, recording, ~recording.validation)
