"""What is known of where something is, and of what drives it: sums over the posterior of all that agrees there.

"Is it exactly this law?" and "does this part respond to this driver?" are two questions. A name, a form without one and
another law at the same part with the same driver are rivals for the first and agree on the second. So each state's terms
count by their part alone, and by part and driver.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from truepose.identification.diagnosis.places import AtPlace, Place
from truepose.identification.diagnosis.weighed import Cause, Weighed
from truepose.identification.posterior.posterior import Posterior
from truepose.identification.signatures.candidates import Catalogue
from truepose.models.driver import DriverKind
from truepose.models.machine import Machine
from truepose.models.parameters import element_of

OWN_POSITION: tuple[DriverKind, ...] = ("position", "position-periodic")
"""One driver, whether what it makes is a wave or a curve."""
Key = tuple[str, str]
"""A part, and what drives it; an empty driver for the part alone."""
ANY = ""


@dataclass(frozen=True)
class Levels:
    """Probability that something is at a place, whatever drives it; its driver, and that this drives something there."""

    place: float
    kind: DriverKind
    driver: float


UNKNOWN = Levels(0.0, "position", 0.0)
"""Nothing is known."""


def driver_of(kind: DriverKind) -> str:
    """What kinds of one driver have in common."""
    return OWN_POSITION[0] if kind in OWN_POSITION else kind


def parts_of(machine: Machine, slug: str, place: Iterable[str]) -> tuple[str, ...]:
    """The parts that an effect is at, one name each: a leg is its actuator's joint, a constant its element, a coupled axis
    the one that is driven."""
    joints = {limb.name: limb.reading for limb in machine.mechanism.limbs}
    elements = [element_of(part) for part in place]
    if slug == "axis-coupling":
        elements = elements[:1]
    return tuple(dict.fromkeys(joints.get(one, one) for one in elements))


class Presence:
    """How probable it is that something is at parts, and that a driver acts there, over all states of a posterior."""

    def __init__(
        self,
        machine: Machine,
        cat: Catalogue,
        problem: Weighed,
        posterior: Posterior,
        families: Mapping[Cause, Mapping[Place, AtPlace]],
    ) -> None:
        self._machine, self._cat, self._problem = machine, cat, problem
        soft = {cause: self._of_family(found) for cause, found in families.items()}
        self._states: list[tuple[float, frozenset[Key], list[Mapping[Key, float]]]] = []
        for state, share in posterior.states:
            hard, likely = set[Key](), list[Mapping[Key, float]]()
            for term, _ in state.members:
                cause = problem.causes[int(problem.weighing.terms.cause[term])]
                if cause.family and cause in soft:
                    likely.append(soft[cause])
                elif not cause.family:
                    hard |= self._of_term(problem.candidates[term])
            self._states.append((share, frozenset(hard), likely))

    def at(self, parts: Sequence[str], kind: DriverKind | None = None) -> float:
        """Probability of something at all of these parts, with one driver or whatever drives it."""
        driver = ANY if kind is None else driver_of(kind)
        total = 0.0
        for share, hard, likely in self._states:
            total += share * min(_there((part, driver), hard, likely) for part in parts)
        return min(total, 1.0)

    def levels(self, slug: str, place: Sequence[str], kind: DriverKind, law: float) -> Levels:
        """Of an effect at its place, whose law has the probability ``law``: no level is less probable than a deeper one."""
        parts = parts_of(self._machine, slug, place)
        driver = max(self.at(parts, kind), law)
        return Levels(max(self.at(parts), driver), kind, driver)

    def _of_term(self, candidates: Sequence[int]) -> set[Key]:
        """What a term says; several forms of a part at once say nothing of their driver."""
        kinds = {driver_of(self._cat.candidates[i].kind) for i in candidates}
        out = set[Key]()
        for i in candidates:
            placed = self._cat.candidates[i]
            for part in parts_of(self._machine, placed.effect.slug, placed.place):
                out |= {(part, ANY)} | ({(part, kind) for kind in kinds} if len(kinds) == 1 else set())
        return out

    def _of_family(self, found: Mapping[Place, AtPlace]) -> dict[Key, float]:
        """Probability of each key where a family is there: of its own place, and of what may stand in its stead."""
        absent: dict[Key, float] = {}
        for (slug, place), at in found.items():
            own = [((slug, place), at.probability)]
            own += [((c.effect, c.place), p) for c, p in at.rivals.items() if not c.family]
            sums: dict[Key, float] = {}
            for (name, where), p in own:
                for part in parts_of(self._machine, name, where):
                    for key in ((part, ANY), *((part, kind) for kind in self._drivers(name, where))):
                        sums[key] = sums.get(key, 0.0) + p
            for key, p in sums.items():
                absent[key] = absent.get(key, 1.0) * (1.0 - min(p, 1.0))
        return {key: 1.0 - p for key, p in absent.items()}

    def _drivers(self, slug: str, place: Sequence[str]) -> set[str]:
        """What drives an effect at a place in this catalogue, where all its terms have one driver."""
        kinds = {
            driver_of(c.kind)
            for c in self._cat.candidates
            if c.effect.slug == slug and c.place == tuple(place)
        }
        return kinds if len(kinds) == 1 else set()


def _there(key: Key, hard: frozenset[Key], likely: Sequence[Mapping[Key, float]]) -> float:
    if key in hard:
        return 1.0
    absent = 1.0
    for soft in likely:
        absent *= 1.0 - soft.get(key, 0.0)
    return 1.0 - absent


__all__ = ["Levels", "Presence", "driver_of", "parts_of"]
