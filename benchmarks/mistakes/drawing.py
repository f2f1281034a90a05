"""Cases drawn from a seed: what ``check`` sees, and apart from it the truth and the right pair.

DIR/cases/caseNNN/      machine.yaml, recording.csv (and what lies beside them): all that check sees
TRUTH/truth/caseNNN.json   kind, variant, where, how far it shows
TRUTH/right/caseNNN/    the pair before it was spoilt
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

from truepose.errors import TrueposeError
from truepose.files import atomic_write_text

from .align import Misfit, misfit, sight
from .correct import CORRECT, correct_case
from .kinds import KINDS, Spoilt
from .pairs import Pair, write
from .sources.rota import MOST, turns

SHOWS = 5.0
"""A mistake must make the rigid misfit so many times as large as geometry and physics do."""
TRIES = 60
ELSEWHERE = 7
"""Turns by which the next try goes on."""
SETTINGS = "mistakes.json"
STILL = "joint-never-moves"


@dataclass(frozen=True)
class Truth:
    """What is wrong with a case. shows: misfit over the right pair's; -1 where the pair cannot be read or assembled."""

    name: str
    kind: str
    variant: str
    source: str
    where: tuple[str, ...]
    exact: bool
    kinds: tuple[str, ...]
    mends: bool
    judged: str
    shows: float
    tries: int


@dataclass(frozen=True)
class Asked:
    """What is drawn: n mistakes, ``correct`` right pairs, from a seed; only some kinds."""

    folder: Path
    truth: Path
    n: int
    correct: int
    seed: int
    only: tuple[str, ...] = ()

    @property
    def kinds(self) -> tuple[str, ...]:
        """In the order of the cases."""
        return self.only or tuple(KINDS)

    @property
    def settings(self) -> dict[str, object]:
        """What decides the cases."""
        return {"seed": self.seed, "n": self.n, "correct": self.correct, "kinds": list(self.kinds)}


def draw(asked: Asked, jobs: int, progress: Callable[[str], None]) -> None:
    """Every case that is not there yet. Raises InputError where a folder holds others."""
    settle(asked)
    work = [(k, asked.kinds[k % len(asked.kinds)]) for k in range(asked.n)]
    work += [(asked.n + k, CORRECT) for k in range(asked.correct)]
    order = _shuffled(asked.seed, len(work))
    for said in Parallel(max(jobs, 1), return_as="generator_unordered", batch_size=1)(
        delayed(_case)(asked, f"case{order[k] + 1:03d}", k, kind) for k, kind in work
    ):
        progress(said)


def settle(asked: Asked) -> None:
    """Note down what is asked. Raises InputError where the folder holds something else."""
    from truepose.errors import InputError

    asked.folder.mkdir(parents=True, exist_ok=True)
    for name in ("truth", "right"):
        (asked.truth / name).mkdir(parents=True, exist_ok=True)
    path = asked.truth / SETTINGS
    if path.is_file() and (there := json.loads(path.read_text())) != asked.settings:
        raise InputError(f"{asked.truth}: found cases of {there}, expected {asked.settings}")
    atomic_write_text(path, json.dumps(asked.settings, indent=1) + "\n")


def _shuffled(seed: int, n: int) -> Sequence[int]:
    """The number of a case says nothing of what is wrong with it."""
    return [int(k) for k in np.random.default_rng([seed, 7]).permutation(n)]


def _case(asked: Asked, name: str, index: int, kind: str) -> str:
    if (asked.truth / "truth" / f"{name}.json").is_file():
        return f"{name}: there"
    if kind == CORRECT:
        truth = _right(asked, name, index)
    else:
        truth = mistaken(asked.folder / "cases" / name, asked.truth / "right" / name, asked.seed, index, kind)
    text = json.dumps(asdict(truth), indent=1) + "\n"
    atomic_write_text(asked.truth / "truth" / f"{name}.json", text)
    return f"{name}: drawn"


def _right(asked: Asked, name: str, index: int) -> Truth:
    with tempfile.TemporaryDirectory() as room:
        made = Path(room) / "pair"
        source = correct_case(made, asked.seed, index - asked.n, asked.correct)
        for folder in (asked.folder / "cases" / name, asked.truth / "right" / name):
            shutil.rmtree(folder, ignore_errors=True)
            shutil.copytree(made, folder)
    return Truth(name, CORRECT, "", source, (), False, (), False, "certain", 1.0, 1)


def mistaken(folder: Path, right: Path, seed: int, index: int, kind: str) -> Truth:
    """One case, written to ``folder`` and ``right``. Raises LookupError where no source can have the mistake."""
    turn = turns(np.random.default_rng([seed, 11, list(KINDS).index(kind)]))
    for attempt in range(TRIES):
        source = turn(index // len(KINDS) + ELSEWHERE * attempt)
        rng = np.random.default_rng([seed, index, attempt])
        still = kind == STILL and rng.random() < 0.5
        try:
            pair = source.make(rng, effects=int(rng.integers(0, MOST + 1)), still=still)
        except ValueError:
            continue
        spoilt = KINDS[kind](pair, rng)
        if spoilt is None:
            continue
        with tempfile.TemporaryDirectory() as room:
            shows = _written(Path(room), pair, spoilt)
            if shows is None:
                continue
            for name, to in (("spoilt", folder), ("right", right)):
                shutil.rmtree(to, ignore_errors=True)
                shutil.copytree(Path(room) / name, to)
        return Truth(
            folder.name,
            kind,
            spoilt.variant,
            pair.source,
            tuple(dict.fromkeys(spoilt.where)),
            spoilt.exact,
            spoilt.kinds,
            spoilt.mends,
            spoilt.judged,
            shows,
            attempt + 1,
        )
    raise LookupError(f"{kind}: no source can have it in {TRIES} tries")


def _written(room: Path, pair: Pair, spoilt: Spoilt) -> float | None:
    """Both pairs; by how much the mistake shows, None where it does not."""
    write(room / "right", pair.document, pair.table, pair.files)
    write(room / "spoilt", spoilt.document, spoilt.table, spoilt.files or pair.files)
    if spoilt.judged == "certain":
        return 1.0
    return shows(room / "spoilt", room / "right", held=spoilt.judged == "held")


def shows(spoilt: Path, right: Path, *, held: bool) -> float | None:
    """Misfit of the spoilt pair over that of the right one; -1 where it cannot be read; None below ``SHOWS``."""
    good = misfit(sight(right), held=held)
    try:
        seen = sight(spoilt)
    except (TrueposeError, KeyError, ValueError):
        return -1.0
    if seen.lost > len(seen.flange):
        return -1.0
    over = misfit(seen, held=held).over(_floored(good))
    return over if over > SHOWS else None


def _floored(good: Misfit) -> Misfit:
    return Misfit(max(good.points, 1e-9), good.turns)


__all__ = ["SETTINGS", "Asked", "Truth", "draw", "mistaken", "settle", "shows"]
