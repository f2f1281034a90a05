"""What the posterior says, summed over its states: of effects at places, of parts and drivers, of sets, and of a name's class.

"Is it exactly this law?" and "does this part respond to this driver?" are two questions. A name, a form without one and
another law at the same part with the same driver are rivals for the first and agree on the second. So each state's terms
count by their part alone, and by part and driver.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import get_args

from truepose.identification.diagnosis.result import NAMED, UNKNOWN, Levels, SetOfEffects, Together
from truepose.identification.diagnosis.selection_problem import SelectionProblem
from truepose.identification.posterior.posterior import Posterior
from truepose.identification.signatures.candidates import Catalogue
from truepose.models.effects.empirical import Empirical
from truepose.models.file.driver import DriverKind
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import element_of
from truepose.models.machine.placed import EffectAtPlace

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
    """places: probability of each effect at each place; sets: the likeliest sets, a smooth remainder being one without a
    place; nameless: that something without a name is there, a form in a slot or the smooth remainder."""

    places: Mapping[EffectAtPlace, float]
    sets: tuple[SetOfEffects, ...]
    nameless: float

    def of(self, cause: EffectAtPlace) -> float:
        """Probability of an effect at its place."""
        return self.places.get(cause, 0.0)


def inclusion(problem: SelectionProblem, posterior: Posterior) -> Inclusion:
    """What the posterior says of effects at places."""
    places = dict(zip(problem.causes, posterior.causes.tolist(), strict=True))
    sets: dict[tuple[EffectAtPlace, ...], float] = {}
    for state, share in posterior.states:
        numbers = sorted({int(problem.spike_slab.terms.cause[term]) for term, _ in state.members})
        key = tuple(problem.causes[k] for k in numbers)
        key += (EffectAtPlace(Empirical.slug, ()),) if state.point.remainder > 0 else ()
        sets[key] = sets.get(key, 0.0) + share
    ranked = sorted(places.items(), key=lambda item: -item[1])
    listed = {place: p for place, p in ranked if p > REPORTED}
    likeliest = sorted(sets.items(), key=lambda item: -item[1])[:LISTED]
    nameless = sum(p for key, p in sets.items() if any(c.effect == Empirical.slug for c in key))
    return Inclusion(listed, tuple(SetOfEffects(*one) for one in likeliest), nameless)


def driver_of(kind: DriverKind) -> str:
    """What kinds of one driver have in common: a joint's position, whether what it makes is a wave or a curve."""
    return "position" if kind == "position-periodic" else kind


def parts_of(machine: Machine, slug: str, place: Iterable[str]) -> tuple[str, ...]:
    """The parts that an effect is at, one name each: a leg is its actuator's joint, a constant its element, an encoder on a
    load side itself, a coupled axis the one that is driven."""
    joints = {limb.name: limb.reading for limb in machine.mechanism.limbs}
    encoders = {column for sensor in machine.sensors for column in sensor.joints}
    elements = [part if part in encoders else element_of(part) for part in place]
    if slug == "axis-coupling":
        elements = elements[:1]
    return tuple(dict.fromkeys(joints.get(one, one) for one in elements))


class Presence:
    """How probable it is that something is at parts, and that a driver acts there, over all states of a posterior."""

    def __init__(
        self, machine: Machine, cat: Catalogue, problem: SelectionProblem, posterior: Posterior
    ) -> None:
        self._machine, self._cat = machine, cat
        self._states = list[tuple[float, frozenset[Key]]]()
        for state, share in posterior.states:
            keys = (key for t, _ in state.members for key in self._of(problem.candidates[t]))
            self._states.append((share, frozenset(keys)))

    def at(self, parts: Sequence[str], kind: DriverKind | None = None) -> float:
        """Probability of something at all of these parts, with one driver or whatever drives it."""
        driver = ANY if kind is None else driver_of(kind)
        wanted = {(part, driver) for part in parts}
        return min(sum(share for share, keys in self._states if wanted <= keys), 1.0)

    def levels(self, slug: str, place: Sequence[str], kind: DriverKind, law: float) -> Levels:
        """Of an effect at its place, whose law has the probability ``law``: no level is less probable than a deeper one."""
        parts = parts_of(self._machine, slug, place)
        driver = max(self.at(parts, kind), law)
        return Levels(max(self.at(parts), driver), kind, driver)

    def together(self) -> tuple[Together, ...]:
        """Of each driver the places that are not sure one by one, where it is sure that it acts at one of them at least."""
        keys = sorted({key for _, keys in self._states for key in keys if key[1] != ANY})
        out = list[Together]()
        for driver in [kind for kind in get_args(DriverKind) if kind in {own for _, own in keys}]:
            alone = {part: self.at((part,), driver) for part, own in keys if own == driver}
            open_ = {part: p for part, p in alone.items() if SHOWN < p < SURE}
            group = {(part, driver) for part in open_}
            total = min(sum(share for share, state in self._states if group & state), 1.0)
            if len(open_) > 1 and total >= SURE:
                ranked = tuple(sorted(open_, key=lambda part: (-open_[part], part)))
                out.append(Together(driver, ranked, total))
        return tuple(out)

    def _of(self, candidate: int) -> Iterator[Key]:
        """What a candidate says."""
        placed = self._cat.candidates[candidate]
        for part in parts_of(self._machine, placed.effect.slug, placed.place):
            yield from ((part, ANY), (part, driver_of(placed.kind)))


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
    drives it; tested: whether its form was. A cause ``empirical`` has no law, and its ``probability`` is 0.
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

    @property
    def nameless(self) -> bool:
        """Whether only its place and its driver are known."""
        return self.cause.effect == Empirical.slug

    @property
    def said(self) -> bool:
        """Whether it is more probable than not: its place with its driver, or one of the names of its class."""
        return max(self.levels.driver, self.certainty) >= NAMED
