"""What the posterior says, as sums over its states: of parts, of drivers at parts, of laws at places, and of sets.

"Is it exactly this law?" and "does this part respond to this driver?" are two questions. A name, a form without one and
another law at the same part with the same driver are rivals for the first and agree on the second. So each state's terms
count by their part alone, and by part and driver; a law counts in states that leave nothing without a name at its parts that
it could be mistaken for.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import get_args

from truepose.identification.diagnosis.result import NAMED, UNKNOWN, Levels, SetOfEffects, Together
from truepose.identification.diagnosis.selection_problem import SelectionProblem
from truepose.identification.posterior.posterior import Posterior
from truepose.identification.posterior.state import State
from truepose.identification.signatures.candidates import Catalogue
from truepose.models.effects.empirical import Empirical
from truepose.models.file.driver import DriverKind
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import element_of
from truepose.models.machine.placed import EffectAtPlace, PlacedEffect

SURE = 0.9
"""Probability from which on something is spoken of as known."""
LEADING = 0.1
"""Probability from which on what is less probable than not is shown as leading, and has a part in predictions."""
SHOWN = 0.02
"""Share of a slot from which on an explanation belongs to its class."""
REPORTED, LISTED = 0.01, 8
"""Probability from which on an effect at a place is listed; most sets that are, and most explanations of a class."""
Key = tuple[str, str]
"""A part, and what drives it; an empty driver for the part alone."""
ANY = ""


@dataclass(frozen=True)
class Inclusion:
    """places: probability of each law at its place, and of something without one; sets: the likeliest sets; nameless: that
    something without a name is there."""

    places: Mapping[EffectAtPlace, float]
    sets: tuple[SetOfEffects, ...]
    nameless: float


def driver_of(kind: DriverKind) -> str:
    """What kinds of one driver have in common: a joint's position, whether what it makes is a wave or a curve."""
    return "position" if kind == "position-periodic" else kind


def nature_of(kind: DriverKind) -> str:
    """Return what a kind of driver shares with those whose functions may be mistaken for its own.

    What passes with time or heat is one such group, and what the pose decides; the side of arrival and the sensor are alone.
    """
    if kind in ("time", "temperature", "session"):
        return "passing"
    return kind if kind in ("arrival", "sensor") else "pose"


def parts_of(machine: Machine, slug: str, place: Iterable[str]) -> tuple[str, ...]:
    """The parts that an effect is at, one name each: a leg is its actuator's joint, a constant its element, an encoder on a
    load side itself, a coupled axis the one that is driven."""
    joints = {limb.name: limb.reading for limb in machine.mechanism.limbs}
    encoders = {column for sensor in machine.sensors for column in sensor.joints}
    elements = [part if part in encoders else element_of(part) for part in place]
    if slug == "axis-coupling":
        elements = elements[:1]
    return tuple(dict.fromkeys(joints.get(one, one) for one in elements))


class Sums:
    """All that is said of parts, drivers and laws: shares of a posterior's states that agree on it."""

    def __init__(
        self, machine: Machine, cat: Catalogue, problem: SelectionProblem, posterior: Posterior
    ) -> None:
        self._machine, self._cat, self._problem, self._posterior = machine, cat, problem, posterior
        self._causes = [frozenset(self._numbers(state)) for state, _ in posterior.states]
        self._shares = [share for _, share in posterior.states]
        cause = problem.spike_slab.terms.cause
        self._unnamed = {int(cause[t]) for t, i in enumerate(problem.candidates) if not cat.named(i)}
        self._keys = [
            frozenset(key for t, _ in state.members for key in self._of(problem.candidates[t]))
            for state, _ in posterior.states
        ]
        self._alone = [self._laws_alone(state) for state, _ in posterior.states]

    def _laws_alone(self, state: State) -> frozenset[int]:
        """Return the causes of a state at whose parts nothing without a name could be mistaken for them."""
        own = dict[int, set[Key]]()
        for number, (term, _) in zip(self._numbers(state), state.members, strict=True):
            placed = self._cat.candidates[self._problem.candidates[term]]
            natures = map(nature_of, self._kinds(placed))
            own.setdefault(number, set()).update(product(self.parts(placed.at_place), natures))
        unnamed = own.keys() & self._unnamed
        return frozenset(k for k in own if all(own[k].isdisjoint(own[u]) for u in unnamed - {k}))

    def parts(self, cause: EffectAtPlace) -> tuple[str, ...]:
        """The parts that a cause is at."""
        return parts_of(self._machine, *cause)

    def law(self, number: int) -> float:
        """Probability of a cause's law: that it is there, with nothing without a name at its parts."""
        whole = self._sum(number in causes for causes in self._causes)
        alone = self._sum(number in causes for causes in self._alone)
        return float(self._posterior.causes[number]) * alone / whole if whole else 0.0

    def tested(self, number: int) -> bool:
        """Whether the recording could test a cause: it knows what it would be driven by."""
        return number not in self._unnamed or self._problem.causes[number].effect == Empirical.slug

    def any_law(self, numbers: Collection[int]) -> float:
        """Probability that one of some laws is there so."""
        return self._sum(not causes.isdisjoint(numbers) for causes in self._alone)

    def at(self, parts: Sequence[str], kind: DriverKind | None = None) -> float:
        """Probability of something at all of these parts, with one driver or whatever drives it."""
        driver = ANY if kind is None else driver_of(kind)
        wanted = {(part, driver) for part in parts}
        return self._sum(wanted <= keys for keys in self._keys)

    def levels(self, cause: EffectAtPlace, kind: DriverKind, law: float) -> Levels:
        """Of an effect at its place, whose law has the probability ``law``: no level is less probable than a deeper one."""
        driver = max(self.at(self.parts(cause), kind), law)
        return Levels(max(self.at(self.parts(cause)), driver), kind, driver)

    def likeliest_driver(self, cause: EffectAtPlace, law: DriverKind) -> DriverKind:
        """Return what drives something at the parts of a cause: the driver of its ``law``, or one that is more probable than
        not where that is not."""
        kinds = {own for keys in self._keys for part, own in keys if part in self.parts(cause)} - {ANY}
        known = [law, *(kind for kind in get_args(DriverKind) if kind in kinds)]
        return max(known, key=lambda kind: self.at(self.parts(cause), kind) >= NAMED)

    def together(self) -> tuple[Together, ...]:
        """Of each driver the places that are not sure one by one, where it is sure that it acts at one of them at least."""
        every = sorted({key for keys in self._keys for key in keys if key[1] != ANY})
        out = list[Together]()
        for driver in [kind for kind in get_args(DriverKind) if kind in {own for _, own in every}]:
            alone = {part: self.at((part,), driver) for part, own in every if own == driver}
            open_ = {part: p for part, p in alone.items() if SHOWN < p < SURE}
            group = {(part, driver) for part in open_}
            total = self._sum(not keys.isdisjoint(group) for keys in self._keys)
            if len(open_) > 1 and total >= SURE:
                ranked = tuple(sorted(open_, key=lambda part: (-open_[part], part)))
                out.append(Together(driver, ranked, total))
        return tuple(out)

    def form(self, cause: EffectAtPlace, kind: DriverKind) -> PlacedEffect | None:
        """Return the form without a name, at a cause's parts and with a driver, that most of the states hold."""
        wanted = {(part, driver_of(kind)) for part in self.parts(cause)}
        number = {i: t for t, i in enumerate(self._problem.candidates) if not self._cat.has_law(i)}
        forms = [i for i in number if not wanted.isdisjoint(self._of(i))]
        held = [{term for term, _ in state.members} for state, _ in self._posterior.states]
        best = max(forms, key=lambda i: self._sum(number[i] in terms for terms in held), default=None)
        return None if best is None else self._cat.candidates[best]

    def inclusion(self) -> Inclusion:
        """What is said of effects at places, and of sets of them."""
        causes, sets = self._problem.causes, dict[tuple[EffectAtPlace, ...], float]()
        for numbers, share in zip(self._causes, self._shares, strict=True):
            key = tuple(causes[k] for k in sorted(numbers))
            sets[key] = sets.get(key, 0.0) + share
        places = {cause: self.law(k) for k, cause in enumerate(causes) if cause.effect != Empirical.slug}
        forms = [(k, cause) for k, cause in enumerate(causes) if cause.effect == Empirical.slug]
        places |= {cause: float(self._posterior.causes[k]) for k, cause in forms}
        ranked = sorted(places.items(), key=lambda item: -item[1])
        listed = {place: p for place, p in ranked if p > REPORTED}
        likeliest = sorted(sets.items(), key=lambda item: -item[1])[:LISTED]
        nameless = self._sum(not causes.isdisjoint(self._unnamed) for causes in self._causes)
        return Inclusion(listed, tuple(SetOfEffects(*one) for one in likeliest), nameless)

    def _sum(self, holds: Iterable[bool]) -> float:
        return min(sum(share for share, one in zip(self._shares, holds, strict=True) if one), 1.0)

    def _numbers(self, state: State) -> Iterator[int]:
        return (int(self._problem.spike_slab.terms.cause[term]) for term, _ in state.members)

    def _of(self, candidate: int) -> Iterator[Key]:
        """What a candidate says."""
        placed = self._cat.candidates[candidate]
        yield from product(self.parts(placed.at_place), (ANY, *map(driver_of, self._kinds(placed))))

    def _kinds(self, placed: PlacedEffect) -> tuple[DriverKind, ...]:
        """Return the kinds of all drivers of an effect at its place."""
        return placed.effect.driver_kinds(self._machine, placed.place, placed.settings_map)


@dataclass(frozen=True)
class Rival:
    """Another explanation of a class: its cause, how probable it is, the log Bayes factor of it in the slot; whether it could
    be tested."""

    cause: EffectAtPlace
    probability: float
    gain: float
    tested: bool = True


@dataclass(frozen=True)
class Named:
    """A cause of the likeliest set: its candidates that the fit holds, how probable it is, and its class.

    ``certainty`` is the probability of the whole class; ``gain`` the log Bayes factor of the set with it against without.
    ``family``: the slug, where it is said of several places. levels: what is known of where it is and of what
    drives it; tested: whether its form was; form: what has no name there. A cause ``empirical`` has no law, and its
    ``probability`` is 0.
    """

    cause: EffectAtPlace
    candidates: tuple[int, ...]
    probability: float
    certainty: float
    equivalents: tuple[Rival, ...]
    gain: float = 0.0
    family: str = ""
    levels: Levels = UNKNOWN
    tested: bool = True
    form: PlacedEffect | None = None

    @property
    def nameless(self) -> bool:
        """Whether only its place and its driver are known."""
        return self.cause.effect == Empirical.slug

    @property
    def said(self) -> bool:
        """Whether it is more probable than not: its place with its driver, or one of the names of its class."""
        return max(self.levels.driver, self.certainty) >= NAMED
