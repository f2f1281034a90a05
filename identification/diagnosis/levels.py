"""What is known of where something is, and of what drives it: sums over the posterior of all that agrees there.

"Is it exactly this law?" and "does this part respond to this driver?" are two questions. A name, a form without one and
another law at the same part with the same driver are rivals for the first and agree on the second. So each state's terms
count by their part alone, and by part and driver.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from truepose.identification.diagnosis.selection_problem import SelectionProblem
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
        self, machine: Machine, cat: Catalogue, problem: SelectionProblem, posterior: Posterior
    ) -> None:
        self._machine, self._cat = machine, cat
        self._states = [
            (share, frozenset(key for t, _ in state.members for key in self._of(problem.candidates[t])))
            for state, share in posterior.states
        ]

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

    def _of(self, candidate: int) -> Iterator[Key]:
        """What a candidate says."""
        placed = self._cat.candidates[candidate]
        for part in parts_of(self._machine, placed.effect.slug, placed.place):
            yield from ((part, ANY), (part, driver_of(placed.kind)))


__all__ = ["Levels", "Presence", "driver_of", "parts_of"]
