"""Cases on MuJoCo's arms, written where the examination looks for its own: cases/, answers/, challenge.json."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from challenge import solutions
from challenge.cases import Case, draw_case
from challenge.examine import SETTINGS, UNDRAWN
from challenge.examinee import HELD_OUT, MACHINE, RECORDING
from challenge.mujoco.arms import MujocoArm, machines
from challenge.schedule import CONCEALED, SHARES, Seat, schedule
from challenge.strata import UndrawnError
from truepose.errors import InputError
from truepose.files import atomic_directory, atomic_write_text

STRATA = tuple(stratum for stratum in SHARES if stratum != CONCEALED)
"""Nothing that these arms can have is hidden by their geometry."""
STRAIGHT = 3
"""Every third case is measured without overshoots, and does not say from which side a joint came."""
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Asked:
    """How many cases, from which seed, on which arms and of which strata (none: all)."""

    folder: Path
    n: int
    seed: int = 1
    arms: tuple[str, ...] = ()
    strata: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Arms in turn. Raises InputError for one that is unknown or not installed."""
        return _known(self.arms, machines(), "arm")

    @property
    def seats(self) -> tuple[Seat, ...]:
        """The cases in order, the same for any number that begins alike."""
        return schedule(self.n, self.names, _known(self.strata, STRATA, "stratum"))


def write(asked: Asked, progress: Progress = lambda _: None) -> tuple[str, ...]:
    """Draw every case that is not there yet; names of those that were drawn or found. ``progress`` hears of each.

    Raises InputError where the folder holds cases that were asked for otherwise.
    """
    settings = {"seed": asked.seed, "machines": list(asked.names), "strata": list(asked.strata or STRATA)}
    about = asked.folder / SETTINGS
    if about.is_file() and (found := json.loads(about.read_text(encoding="utf-8"))) != settings:
        raise InputError(
            f"{asked.folder}: found cases of {found}, expected {settings}: give another directory"
        )
    asked.folder.mkdir(parents=True, exist_ok=True)
    atomic_write_text(about, json.dumps(settings, indent=1) + "\n")
    done = []
    for seat in asked.seats:
        key = asked.folder / "answers" / f"{seat.name}.json"
        if not key.is_file():
            note = asked.folder / "cases" / f"{seat.name}.{UNDRAWN}"
            try:
                case = drawn(seat, asked.names, asked.seed)
            except (
                UndrawnError,
                ValueError,
            ) as exc:  # nothing for the stratum, or nothing that comes to rest
                note.parent.mkdir(exist_ok=True)
                atomic_write_text(note, f"{exc}\n")
                progress(f"{seat.name}: {exc}")
                continue
            note.unlink(missing_ok=True)
            _files(asked.folder / "cases" / seat.name, case)
            key.parent.mkdir(exist_ok=True)
            atomic_write_text(key, solutions.to_text(case.solution))
        done.append(seat.name)
        progress(seat.name)
    return tuple(done)


def drawn(seat: Seat, names: Sequence[str], seed: int) -> Case:
    """The case of a seat; where its arm has nothing for the stratum, the next arm's. Raises UndrawnError."""
    first, known, said = names.index(seat.machine), machines(), []
    straight = seat.index % STRAIGHT == 0
    for name in (*names[first:], *names[:first]):
        arm: MujocoArm = known[name](straight=straight)
        try:
            case = draw_case(arm, replace(seat, machine=name), seed)
        except UndrawnError as exc:
            said.append(str(exc))
            continue
        return replace(case, recording=unsaid(case.recording)) if straight else case
    raise UndrawnError("; ".join(said))


def unsaid(text: str) -> str:
    """A recording without its columns ``approach.*``: the order of its rows tells as much."""
    table = pd.read_csv(io.StringIO(text), dtype=str, keep_default_na=False)
    gone = [name for name in table.columns if name.startswith("approach.")]
    return str(table.drop(columns=gone).to_csv(index=False))


def _known(given: tuple[str, ...], known: Collection[str], what: str) -> tuple[str, ...]:
    for name in given:
        if name not in known:
            raise InputError(f"challenge.mujoco: found {what} {name!r}, expected one of {', '.join(known)}")
    return given or tuple(known)


def _files(folder: Path, case: Case) -> None:
    folder.parent.mkdir(parents=True, exist_ok=True)
    with atomic_directory(folder) as partial:
        for name, text in ((MACHINE, case.machine), (RECORDING, case.recording), (HELD_OUT, case.held_out)):
            (partial / name).write_text(text, encoding="utf-8")


__all__ = ["Asked", "drawn", "unsaid", "write"]
