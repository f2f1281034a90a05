"""Many mutants of one kind: each is made from a number, so that a single one can be made again."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

from fuzzing.kinds import Kind, Seed
from fuzzing.trial import Outcome, attempt


@dataclass(frozen=True)
class Trial:
    """A mutant by its number, the command that read it, and what came of it."""

    kind: str
    number: int
    command: tuple[str, ...]
    outcome: Outcome


def good_files(kind: Kind) -> list[Seed]:
    """What mutants of a kind are made from."""
    with tempfile.TemporaryDirectory() as home:
        return kind.make(Path(home))


def mutant(kind: Kind, made: Sequence[Seed], number: int) -> tuple[Seed, bytes, tuple[str, ...]]:
    """The good file that a mutant is made from, the mutant, and the command."""
    rng = Random(f"{kind.name} {number}")
    seed, other = rng.choice(made), rng.choice(made)
    return seed, kind.mutate(rng, seed.data, other.data), tuple(rng.choice(seed.commands))


def tried(
    kind: Kind,
    made: Sequence[Seed],
    numbers: Sequence[int],
    hear: Callable[[Trial], None] = lambda trial: None,
) -> list[Trial]:
    """Try the mutants of these numbers, one after another; ``made``: the good files of the kind."""
    out = []
    with tempfile.TemporaryDirectory() as home:
        folder = Path(home)
        for number in numbers:
            seed, data, command = mutant(kind, made, number)
            seed.laid_out(folder, data)
            out.append(Trial(kind.name, number, command, attempt(command, folder)))
            hear(out[-1])
    return out


__all__ = ["Trial", "good_files", "mutant", "tried"]
