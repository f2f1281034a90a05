"""The examination: cases and keys are written, the engine sits each case in a process and a folder of its own.

    DIR/challenge.json                 what was asked for
    DIR/cases/caseNNN/                 machine.yaml, recording.csv, heldout.csv: all that the engine sees
    DIR/answers/caseNNN.json           the key
    DIR/results/caseNNN/               diagnosis.json, improved.yaml, run.json, and predictions for the held-out rows:
                                       heldout_prediction.csv, tool_prediction.csv, plain_prediction.csv

A case that has a result is not sat again. Cases may be drawn only (``draw``), and sat later by any engine with results of
its own elsewhere: cases and keys are then read from ``drawn``.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from joblib import Parallel, delayed

from challenge import solutions
from challenge.cases import Case, draw_case
from challenge.examinee import HELD_OUT, MACHINE, RECORDING, WRITTEN
from challenge.schedule import SHARES, Seat, schedule
from challenge.simulator.base import SimulatedMachine
from challenge.strata import UndrawnError
from truepose.errors import InputError
from truepose.files import atomic_directory, atomic_write_text
from truepose.models.registry import load_plugin

CASES = 400
SETTINGS, RUN, UNDRAWN = "challenge.json", "run.json", "undrawn.txt"
CLONE = Path(__file__).resolve().parent.parent
TIMEOUT = 900.0
"""Seconds after which a diagnosis counts as failed."""
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Challenge:
    """What is asked for: how many cases, drawn from which seed, at which machines and strata. ``drawn``: a folder of cases
    that are there already, and must be of the same seed, machines and strata."""

    folder: Path
    n: int = CASES
    seed: int = 1
    machines: tuple[str, ...] = ()
    strata: tuple[str, ...] = ()
    timeout: float = TIMEOUT
    plugins: tuple[Path, ...] = ()
    drawn: Path | None = None

    @property
    def source(self) -> Path:
        """Where cases and keys are."""
        return self.drawn or self.folder

    @property
    def seats(self) -> tuple[Seat, ...]:
        """The cases in order."""
        return schedule(self.n, self.machines or tuple(machines()), self.strata or tuple(SHARES))


def machines() -> Mapping[str, Callable[[], SimulatedMachine]]:
    """How to build every simulated machine, by name."""
    from challenge.simulator.registry import MACHINES

    return MACHINES


def challenge(
    folder: Path,
    n: int = CASES,
    *,
    seed: int = 1,
    only_machines: Sequence[str] = (),
    strata: Sequence[str] = (),
    timeout: float = TIMEOUT,
    plugins: Sequence[Path] = (),
) -> Challenge:
    """A checked examination. Raises InputError for unknown machines or strata and for a folder of another one."""
    for given, known, what in (
        (only_machines, tuple(machines()), "machine"),
        (strata, tuple(SHARES), "stratum"),
    ):
        for name in given:
            if name not in known:
                raise InputError(f"challenge: found {what} {name!r}, expected one of {', '.join(known)}")
    out = Challenge(
        folder, n, seed, tuple(only_machines), tuple(strata), timeout, tuple(p.resolve() for p in plugins)
    )
    asked = _settings(out)
    if (folder / SETTINGS).is_file():
        found = json.loads((folder / SETTINGS).read_text(encoding="utf-8"))
        if found != asked:
            raise InputError(
                f"{folder}: found an examination with {found}, expected {asked}: give another directory"
            )
    return out


def _settings(asked: Challenge) -> dict[str, object]:
    """What decides the cases; their number only says where to stop."""
    return {
        "seed": asked.seed,
        "machines": list(asked.machines or machines()),
        "strata": list(asked.strata or SHARES),
    }


def sitting(drawn: Path, folder: Path, n: int | None = None, timeout: float = TIMEOUT) -> Challenge:
    """The examination of a folder of drawn cases (the first n), with results in ``folder``.

    Raises InputError where nothing was drawn.
    """
    if not (drawn / SETTINGS).is_file():
        raise InputError(
            f"{drawn}: found no {SETTINGS}, expected a folder that 'python -m challenge --draw' has drawn"
        )
    said = json.loads((drawn / SETTINGS).read_text(encoding="utf-8"))
    keys = [int(p.stem.removeprefix("case")) for p in (drawn / "answers").glob("case*.json")]
    count = max(keys, default=0)
    return Challenge(
        folder,
        count if n is None else min(n, count),
        said["seed"],
        tuple(said["machines"]),
        tuple(said["strata"]),
        timeout,
        drawn=drawn.resolve(),
    )


def run(
    asked: Challenge,
    *,
    jobs: int = 1,
    again: bool = False,
    draw_only: bool = False,
    progress: Progress = lambda *_: None,
) -> tuple[Seat, ...]:
    """Write and sit every case; the seats that could be filled, in order. ``draw_only``: no case is sat.

    ``progress`` hears how many cases are done, of how many, and the latest. ``again`` sits cases anew that have a
    result; the cases themselves stay. Cases are sat by ``jobs`` processes, or by what ``joblib.parallel_config`` names.
    """
    seats = asked.seats
    asked.folder.mkdir(parents=True, exist_ok=True)
    atomic_write_text(asked.folder / SETTINGS, json.dumps(_settings(asked), indent=1) + "\n")
    sat = Parallel(max(jobs, 1), return_as="generator_unordered", batch_size=1)(
        delayed(_seated)(asked, seat, again, draw_only, os.getpid()) for seat in seats
    )
    for done, name in enumerate(sat, start=1):
        progress(done, len(seats), name)
    return tuple(seat for seat in seats if (asked.source / "answers" / f"{seat.name}.json").is_file())


def _seated(asked: Challenge, seat: Seat, again: bool, draw_only: bool, parent: int) -> str:
    """Name of a case that is done; a process that is not the parent has no plugins yet."""
    if os.getpid() != parent:
        _load(asked.plugins)
    if draw_only:
        write(asked, seat)
    else:
        write_and_sit(asked, seat, again)
    return seat.name


@cache
def _load(plugins: tuple[Path, ...]) -> None:
    """Once in a process."""
    for path in plugins:
        load_plugin(path)


def write_and_sit(asked: Challenge, seat: Seat, again: bool) -> None:
    """Write one case unless it is there, and sit it unless it has a result."""
    results = asked.folder / "results" / seat.name
    if write(asked, seat) and (again or not (results / RUN).is_file()):
        sit(asked.source / "cases" / seat.name, results, asked.timeout, asked.plugins)


def write(asked: Challenge, seat: Seat) -> bool:
    """Write one case unless it is there; whether it is there now. What was drawn elsewhere stays as it is."""
    key, case = asked.source / "answers" / f"{seat.name}.json", asked.source / "cases" / seat.name
    note = case.parent / f"{seat.name}.{UNDRAWN}"
    if key.is_file() and (case / HELD_OUT).is_file():
        return True
    if asked.drawn is not None:
        return False
    try:
        write_case(asked, seat)
    except Exception as exc:  # one case that cannot be made must not end the others; the table tells
        case.parent.mkdir(parents=True, exist_ok=True)
        said = str(exc) if isinstance(exc, UndrawnError) else f"{type(exc).__name__}: {exc}"
        atomic_write_text(note, f"{said}\n")
        return False
    note.unlink(missing_ok=True)
    return True


def _drawn(asked: Challenge, seat: Seat) -> Case:
    """The case of a seat; where its machine has nothing for the stratum, the next machine's."""
    names = asked.machines or tuple(machines())
    first = names.index(seat.machine)
    said = []
    for name in (*names[first:], *names[:first]):
        try:
            return draw_case(machines()[name](), replace(seat, machine=name), asked.seed)
        except UndrawnError as exc:
            said.append(str(exc))
    raise UndrawnError("; ".join(said))


def write_case(asked: Challenge, seat: Seat) -> None:
    """Draw the case of a seat and write its files and its key."""
    folder = asked.folder
    drawn = _drawn(asked, seat)
    with atomic_directory(folder / "cases" / seat.name) as partial:
        for name, text in (
            (MACHINE, drawn.machine),
            (RECORDING, drawn.recording),
            (HELD_OUT, drawn.held_out),
        ):
            (partial / name).write_text(text, encoding="utf-8")
    key = folder / "answers" / f"{seat.name}.json"
    key.parent.mkdir(parents=True, exist_ok=True)
    atomic_write_text(key, solutions.to_text(drawn.solution))


def sit(case: Path, results: Path, timeout: float, plugins: Sequence[Path] = ()) -> None:
    """Give the engine copies of the case's files in a folder that says nothing, and keep what it writes."""
    with tempfile.TemporaryDirectory() as room:
        for name in (MACHINE, RECORDING, HELD_OUT):
            shutil.copy(case / name, room)
        kept(("challenge.examinee", *map(str, plugins)), Path(room), results, timeout, WRITTEN)


def kept(
    module: Sequence[str],
    room: Path,
    results: Path,
    timeout: float,
    written: Sequence[str],
    beside: Sequence[Path] = (CLONE,),
) -> None:
    """Run a module with its arguments in a folder, and keep in another what it has ``written`` there. ``beside``: folders that
    it imports from.

    A crash, or more than ``timeout`` seconds, leaves a run.json with the message and nothing else of worth.
    """
    start, busy, message = time.perf_counter(), _cpu(), ""
    threads = {f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "OMP", "MKL")}
    command = [sys.executable, "-P", "-m", *module]
    try:
        done = subprocess.run(
            command, cwd=room, env=_beside(threads, beside), capture_output=True, timeout=timeout, check=False
        )
        said = done.stderr.decode(errors="replace").strip().splitlines()
        message = "" if done.returncode == 0 else (said or [f"exit code {done.returncode}"])[-1]
    except subprocess.TimeoutExpired:
        message = f"timeout after {timeout:g} s"
    shutil.rmtree(results, ignore_errors=True)
    with atomic_directory(results) as partial:
        for name in written:
            if (room / name).is_file():
                shutil.copy(room / name, partial)
        seconds = {"seconds": time.perf_counter() - start, "cpu": _cpu() - busy}
        about = {name: round(value, 2) for name, value in seconds.items()} | {"message": message}
        (partial / RUN).write_text(json.dumps(about) + "\n", encoding="utf-8")


def _cpu() -> float:
    """Seconds of processor time of all processes that this one has started and that have ended."""
    used = os.times()
    return used.children_user + used.children_system


def _beside(more: Mapping[str, str], folders: Sequence[Path]) -> dict[str, str]:
    """The environment, with folders that are not installed where a process in another folder finds them."""
    here = (*map(str, folders), os.environ.get("PYTHONPATH", ""))
    return os.environ | more | {"PYTHONPATH": os.pathsep.join(filter(None, here))}


__all__ = [
    "CASES", "Challenge", "challenge", "kept", "run", "sit", "sitting", "write", "write_and_sit", "write_case",
]  # fmt: skip
