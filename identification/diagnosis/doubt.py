"""Names are worth less where they may stand in for one thing without a name.

Signs of that: the model with them still fails, and what it lacks may also be what a name stands in for, the more so
where they explain the lesser part. And names pile up: several names on one part, or three different effects, together
bend like one thing that the catalogue does not know. In two blind examinations 4 of 21 names beside an unexplained
remainder were right, 4 of 10 of those two on one part, 3 of 33 in larger piles, and none of 10 beside something
unnamed on the same part (docs/challenge.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from truepose.identification.diagnosis.result import Alternative, Finding, Remainder
from truepose.identification.diagnosis.unnamed import UNNAMED
from truepose.models.machine import Machine
from truepose.models.parameters import element_of

KEPT = 0.5
"""Share of its probability that a name keeps where the model with it still fails, and for each further name of its pile."""
LEAST_KEPT = 0.25
"""What is kept whatever speaks against it: machines with many faults exist, and none fits its model wholly."""
FEW_EFFECTS = 2
"""So many different effects at different parts are no pile; what is left unexplained counts as one more."""
COMPARABLE = 0.03
"""Share of a name's log Bayes factor below which another is too small to speak against it."""
MOST = 0.5
"""Share of the misfit that names explain below which what they leave speaks against physics twice."""
COMMON = 3
"""Parts from which on a place is what many share, and no part of any pile."""
CONSTANTS = frozenset({"wrong-constant", "zero-shift", "frame-shift"})
"""Geometry that is other than stated: no physics whose pieces it might be."""


def doubted(
    machine: Machine,
    findings: Sequence[Finding],
    rival: Remainder | None,
    *,
    failing: bool,
    explained: float = 1.0,
) -> tuple[Finding, ...]:
    """The findings, each with some of its probability given to something unnamed, which joins its class.

    If every finding has two independent warning signs or more, none is returned (and the verdict is ``unknown``).
    ``failing``: the model with them still leaves something, ``rival`` where that is known; ``explained``: the share of
    the misfit that they explain.
    """
    piles = [_pile(machine, f, findings, failing) for f in findings]
    minor = [failing and explained < MOST and f.effect not in CONSTANTS for f in findings]
    against = [pile - 1 + failing + less for pile, less in zip(piles, minor, strict=True)]
    keeps = [max(KEPT**signs, LEAST_KEPT) for signs in against]
    if max(keeps, default=1.0) <= LEAST_KEPT:
        return ()
    shared = zip(findings, piles, keeps, strict=True)
    return tuple(
        replace(_shared(f, rival, keep), failing=failing, pile=pile) if keep < 1.0 else f
        for f, pile, keep in shared
    )


def _pile(machine: Machine, finding: Finding, findings: Sequence[Finding], failing: bool) -> int:
    """How many names together may stand in for one thing: those on a part of this one's, or more effects than few."""
    comparable = [f for f in findings if f.log_bayes_factor >= COMPARABLE * finding.log_bayes_factor]
    parts = _parts(machine, finding.place)
    local = [f for f in comparable if len(f.place) < COMMON and parts & _parts(machine, f.place)]
    beside = len(local) if len(finding.place) < COMMON else 1
    kinds = len({f.effect for f in comparable} - CONSTANTS)
    return max(beside, kinds + failing - FEW_EFFECTS + 1, 1)


def same_part(machine: Machine, place: Sequence[str], rival: Remainder | None) -> bool:
    """Whether something unnamed was found on a part of the place: a name there is likely half of it."""
    return rival is not None and bool(_parts(machine, place) & _parts(machine, rival.place))


def _parts(machine: Machine, place: Sequence[str]) -> set[str]:
    """Parts that a place is at: a limb for all that belongs to it, a driven joint also for the link that it moves."""
    mechanism = machine.mechanism
    moved = {joint.name: joint.child for joint in mechanism.tree}
    part_of = {limb.reading: limb.name for limb in mechanism.limbs}
    part_of |= {
        moved[a.drives]: part_of.get(a.reading, a.reading) for a in mechanism.actuators if a.drives in moved
    }
    names = map(element_of, place)
    return {part_of.get(name, name) for name in names}


def _shared(finding: Finding, rival: Remainder | None, keep: float) -> Finding:
    place = finding.place if rival is None else rival.place
    unnamed = Alternative(UNNAMED, place, (1.0 - keep) * finding.certainty, finding.log_bayes_factor)
    others = [replace(other, probability=keep * other.probability) for other in finding.equivalents]
    return replace(
        finding,
        probability=keep * finding.probability,
        certainty=keep * finding.certainty,
        equivalents=tuple(sorted((*others, unnamed), key=lambda other: -other.probability)),
    )
