"""Draws what the battery consists of, and gives it to the engine.

    DRAWN/real-like, outside, mujoco   cases and keys, as the examination draws them
    DIR/real-like, outside, mujoco     answers/ (copies of the keys) and results/
    DIR/recorded/results/CASE/         diagnosis.json, measures.json and run.json of a part of a real recording

A case that has a result is not sat again.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from joblib import Parallel, delayed

from challenge import examine
from challenge.battery.parts import ARMS, CASES, MUJOCO, RECORDED, SIMULATED, STRATA
from challenge.battery.recorded import MEASURES
from challenge.examine import CLONE, RUN
from challenge.examinee import DIAGNOSIS
from truepose.errors import InputError

BESIDE = (CLONE, CLONE / "benchmarks")
"""Where a process that diagnoses a real recording finds the examination and the studies."""
Say = Callable[[str], None]


def draw(folder: Path, seed: int, parts: Sequence[str], jobs: int, say: Say) -> None:
    """Cases of every part that is drawn, unless they are there."""
    for part in (p for p in STRATA if p in parts):
        stratum, count = STRATA[part]
        asked = examine.challenge(folder / part, count, seed=seed, strata=(stratum,))
        seats = examine.run(asked, jobs=jobs, draw_only=True)
        say(f"{part}: {len(seats)} of {count} cases drawn")
    if MUJOCO in parts:
        _draw_arms(folder / MUJOCO, seed, say)


def _draw_arms(folder: Path, seed: int, say: Say) -> None:
    """Arms in MuJoCo; without it, a line."""
    try:
        from challenge.mujoco.written import Asked, write  # says what is missing where it is not installed

        done = write(Asked(folder, ARMS, seed))
    except InputError as exc:
        say(f"{MUJOCO} skipped: {exc}")
        return
    say(f"{MUJOCO}: {len(done)} of {ARMS} cases drawn")


def sit(
    drawn: Path, output: Path, parts: Sequence[str], *, jobs: int, data: Path | None, timeout: float, say: Say
) -> None:
    """Every part; what was not drawn, and real recordings without their folder, are skipped with a line.

    Raises InputError where nothing is left.
    """
    there = [part for part in SIMULATED if part in parts and (drawn / part / examine.SETTINGS).is_file()]
    real = RECORDED in parts and data is not None
    if not there and not real:
        raise InputError(f"{drawn}: found no cases, expected some of the folders {', '.join(SIMULATED)}")
    for part in (p for p in parts if p not in there and not (real and p == RECORDED)):
        say(f"{part} skipped: " + ("no --data" if part == RECORDED else f"not in {drawn}"))
    for part in there:
        examined(drawn / part, output / part, jobs, timeout, say)
    if real and data is not None:
        recorded(data, output / RECORDED, jobs, timeout, say)


def examined(drawn: Path, output: Path, jobs: int, timeout: float, say: Say) -> None:
    """Cases of one folder, by the examination; their keys are copied, so that the table needs no other folder."""
    asked = examine.sitting(drawn, output, timeout=timeout)
    shutil.copytree(drawn / "answers", output / "answers", dirs_exist_ok=True)
    examine.run(
        asked, jobs=jobs, progress=lambda done, of, name: say(f"{output.name}: {done} of {of} ({name})")
    )


def recorded(
    data: Path, output: Path, jobs: int, timeout: float, say: Say, cases: Sequence[str] = ()
) -> None:
    """Parts of real recordings (all, or some ``cases``), each in a process and a folder of its own."""
    wanted = [case for case in cases or CASES if not (output / "results" / case / RUN).is_file()]
    sat = Parallel(max(jobs, 1), return_as="generator_unordered", batch_size=1)(
        delayed(_recorded)(data.resolve(), output / "results", case, timeout) for case in wanted
    )
    for done, name in enumerate(sat, start=1):
        say(f"{RECORDED}: {done} of {len(wanted)} ({name})")


def _recorded(data: Path, results: Path, case: str, timeout: float) -> str:
    module = ("challenge.battery.recorded", str(data), case)
    with tempfile.TemporaryDirectory() as room:
        examine.kept(module, Path(room), results / case, timeout, (DIAGNOSIS, MEASURES), BESIDE)
    return case


__all__ = ["draw", "examined", "recorded", "sit"]
