"""Which lines of a machine's drawing an effect's place means."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import element_of
from truepose.models.machine.skeleton import Piece


def pieces_of(place: Sequence[str], pieces: Sequence[Piece], machine: Machine) -> list[int]:
    """Pieces that a place's names mean; none for a place that is not of the mechanism, such as a sensor."""
    found: list[int] = []
    for name in place:
        for wanted in _meant(name, machine):
            at = [k for k, piece in enumerate(pieces) if wanted in piece.names]
            if at:
                found += at
                break
    return list(dict.fromkeys(found))


def _meant(name: str, machine: Machine) -> list[str]:
    """What a name may mean, nearest first: itself, the part that it is of, the joint of a length that heats up."""
    lengths: Mapping[str, tuple[str, ...]] = machine.mechanism.lengths
    parts = [element_of(port) for port in lengths.get(name, ())]
    return list(dict.fromkeys([name, element_of(name), *parts]))
