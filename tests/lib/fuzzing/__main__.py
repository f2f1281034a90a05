"""``python -m fuzzing [-n 10000] [--kind NAME] [--first K] [-j 2] [--keep DIR] [-o TABLE.md]``: all kinds, and a table.

A mutant that broke the promise is told at once, and kept with its command where ``--keep`` names a folder. Exit code 1 when
any did. ``--first K -n 1`` makes mutant K again.
"""

from __future__ import annotations

import argparse
import multiprocessing
import shutil
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from fuzzing.campaign import Trial, good_files, mutant, tried
from fuzzing.kinds import KINDS, Kind, Seed
from fuzzing.warm import warmed


def main() -> int:
    """Run from the command line."""
    parser = argparse.ArgumentParser(prog="fuzzing", description=__doc__)
    parser.add_argument("-n", type=int, default=10000, help="mutants of each kind")
    parser.add_argument("--kind", action="append", help="only kinds whose name begins so")
    parser.add_argument("--first", type=int, default=0, help="number of the first mutant")
    parser.add_argument("-j", type=int, default=2, help="processes")
    parser.add_argument("--keep", type=Path, help="folder for mutants that broke the promise")
    parser.add_argument("-o", type=Path, help="table to write (Markdown)")
    asked = parser.parse_args()
    warmed()
    kinds = [
        kind for kind in KINDS if not asked.kind or any(kind.name.startswith(name) for name in asked.kind)
    ]
    rows, broken = [], 0
    for kind in kinds:
        made = good_files(kind)
        trials, seconds = _all(kind, made, range(asked.first, asked.first + asked.n), asked.j)
        broken += sum(bool(trial.outcome.fault) for trial in trials)
        rows.append(_row(kind, trials, seconds))
        sys.stdout.write(rows[-1] + "\n")
        sys.stdout.flush()
        if asked.keep:
            _keep(kind, made, trials, asked.keep)
    if asked.o:
        asked.o.write_text(_table(rows), encoding="utf-8")
    return int(broken > 0)


def _all(kind: Kind, made: Sequence[Seed], numbers: range, processes: int) -> tuple[list[Trial], float]:
    began = time.monotonic()
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    workers = [
        context.Process(target=_work, args=(kind, made, numbers[k::processes], queue))
        for k in range(processes)
    ]
    for worker in workers:
        worker.start()
    trials = []
    for _ in numbers:
        trial = queue.get()
        trials.append(trial)
        if trial.outcome.fault:
            said = trial.outcome.said.strip().splitlines()
            told = f"{kind.name} {trial.number}: {trial.outcome.fault}: {' '.join(trial.command)}: {said[-1] if said else ''}"
            sys.stdout.write(told[:400] + "\n")
            sys.stdout.flush()
    for worker in workers:
        worker.join()
    return trials, time.monotonic() - began


def _work(kind: Kind, made: Sequence[Seed], numbers: range, queue: multiprocessing.Queue[Trial]) -> None:
    tried(kind, made, numbers, queue.put)


def _row(kind: Kind, trials: list[Trial], seconds: float) -> str:
    outcomes = [trial.outcome for trial in trials]
    refused = sum(o.code in (2, 3) for o in outcomes)
    slowest, largest = max(o.seconds for o in outcomes), max(o.megabytes for o in outcomes)
    broken = sum(bool(o.fault) for o in outcomes)
    return (
        f"| {kind.name} | {len(trials):,} | {refused:,} | {sum(o.accepted for o in outcomes):,} | {broken} | "
        f"{slowest:.1f} s | {largest:,.0f} MB | {seconds / 60:.0f} min |"
    )


def _table(rows: Iterable[str]) -> str:
    names = (
        "kind",
        "mutants",
        "refused",
        "accepted",
        "promise broken",
        "slowest (processor)",
        "largest",
        "took",
    )
    head = f"| {' | '.join(names)} |\n{'|---' * len(names)}|\n"
    return head + "\n".join(rows) + "\n"


def _keep(kind: Kind, made: Sequence[Seed], trials: list[Trial], folder: Path) -> None:
    """Lay out what broke the promise, with the command and what was said."""
    for trial in trials:
        if trial.outcome.fault:
            place = folder / f"{kind.name} {trial.number}"
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir(parents=True)
            seed, data, _ = mutant(kind, made, trial.number)
            seed.laid_out(place, data)
            (place / "command").write_text(" ".join(("truepose", *trial.command)) + "\n", encoding="utf-8")
            (place / "said").write_text(f"{trial.outcome.fault}\n{trial.outcome.said}", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
