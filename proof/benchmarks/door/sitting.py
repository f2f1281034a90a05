"""One pair, from its draw to what ``check`` is found to be worth on it."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truepose.errors import TrueposeError
from truepose.identification.leaves.check.pair import Pair
from truepose.identification.leaves.check.result import Check
from truepose.identification.leaves.check.run import check_files

from .drawing import draw
from .judging import Worth, fits, is_off, may_be_right, shows_sag, worth
from .kinds import Spoilt
from .outcome import RIGHT, Outcome
from .pairs import Pair as Drawn
from .pairs import found, write
from .recordings import recordings
from .slips import NEEDS, SEVERAL, SLIPS, is_told, names_no_cause

TRIES = 300
ELSEWHERE = 7
"""Families by which the next try goes on."""
ENOUGH = (30, 70)
"""Poses of a pair that is spoilt: that rows are few is no second mistake."""
Examinee = Callable[[Path], "Answer"]


@dataclass(frozen=True)
class Answer:
    """What was said of a pair: the check, or the words of an error in its place."""

    check: Check | None
    error: str = ""

    @property
    def verdict(self) -> str:
        """The verdict, ``refused`` where there was an error."""
        return self.check.verdict if self.check is not None else "refused"


def ask(folder: Path) -> Answer:
    """Return what ``check`` says of the pair in a folder; an error other than for bad input counts as one."""
    machine, tables = found(folder)
    try:
        return Answer(check_files(machine, tables)[0])
    except TrueposeError as exc:
        return Answer(None, str(exc))
    except Exception as exc:  # a traceback is an answer, too: the table has it
        return Answer(None, f"{type(exc).__name__}: {exc}")


def sit_recording(name: str, keep: Path, examinee: Examinee = ask) -> Outcome:
    """Return what comes of a recording of others."""
    with tempfile.TemporaryDirectory() as room:
        folder = Path(room) / "pair"
        kind, writer = recordings()[name]
        writer(folder)
        own = worth(folder)
        outcome = _outcome(name.replace(" ", "-"), kind, name, None, own, own, "right", folder, examinee)
        return _kept(outcome, keep, folder)


def sit(kind: str, k: int, seed: int, keep: Path, examinee: Examinee = ask) -> Outcome:
    """Return what comes of the ``k``-th pair of a kind; files of one that breaks the law go to ``keep``.

    Raises LookupError where no machine can have the slip.
    """
    number = sum(map(ord, kind))
    for attempt in range(TRIES):
        rng = np.random.default_rng([seed, number, k, attempt])
        needs = {} if kind == RIGHT else {"poses": int(rng.integers(*ENOUGH)), **NEEDS.get(kind, {})}
        pair = draw(rng, k + ELSEWHERE * attempt, **needs)
        spoilt = None if kind == RIGHT else SLIPS[kind](pair, rng)
        if kind != RIGHT and spoilt is None:
            continue
        with tempfile.TemporaryDirectory() as room:
            outcome = _sit(f"{kind}-{k}".replace(" ", "-"), kind, pair, spoilt, Path(room), keep, examinee)
        if outcome is not None:
            return outcome
    raise LookupError(f"{kind}: found no machine that can have it in {TRIES} tries")


def _sit(
    name: str, kind: str, pair: Drawn, spoilt: Spoilt | None, room: Path, keep: Path, examinee: Examinee
) -> Outcome | None:
    """Return the outcome; None where the right pair is none that the law speaks of."""
    right = room / "right"
    write(right, pair.document, pair.table, pair.files)
    good = worth(right)
    if not may_be_right(good):
        return None
    if spoilt is None:
        return _kept(
            _outcome(name, kind, pair.source, None, good, good, "right", right, examinee), keep, right
        )
    case = room / "case"
    write(case, spoilt.document, spoilt.table, spoilt.files or pair.files)
    own = worth(case)
    if spoilt.judged == "sag" and not shows_sag(good, worth(right, giving=True)):
        return None
    state = _state(own, good, worth(right, rigid=True), spoilt)
    return _kept(
        _outcome(name, kind, pair.source, spoilt, own, good, state, case, examinee), keep, case, right
    )


def _state(own: Worth, right: Worth, drawn: Worth, spoilt: Spoilt) -> str:
    if spoilt.judged in ("certain", "sag") or is_off(own, right, drawn):
        return "off"
    return "right" if may_be_right(own) and fits(own, right) else "between"


def _outcome(
    name: str,
    kind: str,
    source: str,
    spoilt: Spoilt | None,
    own: Worth,
    right: Worth,
    state: str,
    folder: Path,
    examinee: Examinee,
) -> Outcome:
    start = time.perf_counter()
    answer = examinee(folder)
    seconds = time.perf_counter() - start
    advice = advised(answer, kind, spoilt, folder, right)
    said = answer.error
    if answer.check is not None:
        said = "; ".join(f"{f.verdict}: {f.kind}: {f.says}" for f in answer.check.found[:2])
    said = said.replace(f"{folder}/", "")
    variant = spoilt.variant if spoilt is not None else ""
    size = round(own.worst, 2), round(own.times(right), 2)
    return Outcome(name, kind, source, variant, state, answer.verdict, advice, said, seconds, *size)


def advised(answer: Answer, kind: str, spoilt: Spoilt | None, folder: Path, right: Worth) -> str:
    """Return whether what is said to be certain is right: the mended pair is as good as the right one, or a person reads
    the slip in it."""
    if answer.check is None:
        told = spoilt is not None and any(word in answer.error for word in spoilt.where)
        return "right" if told else "none"
    certain = [f for f in answer.check.found if f.verdict == "wrong"]
    if not certain:
        return "none"
    told = spoilt is not None and is_told(certain[0], kind, spoilt)
    if certain[0].mend is None:
        return "right" if told else "none" if names_no_cause(certain[0]) else "wrong"
    if told and spoilt is not None and (not spoilt.mends or kind in SEVERAL):
        return "right"
    return "right" if fits(_mended(answer.check, folder), right) else "wrong"


def _mended(check: Check, folder: Path) -> Worth:
    with tempfile.TemporaryDirectory() as room:
        machine, tables = found(folder)
        try:
            check.mended(Pair.read(machine, tables)).write(Path(room) / "fixed")
        except (TrueposeError, ValueError, KeyError, OSError) as exc:
            return Worth(failed=f"{type(exc).__name__}: {exc}")
        return worth(Path(room) / "fixed")


def _kept(outcome: Outcome, keep: Path, *folders: Path) -> Outcome:
    if outcome.breaks_the_law:
        for folder in folders:
            shutil.copytree(folder, keep / outcome.name / folder.name, dirs_exist_ok=True)
    return outcome


__all__ = ["Answer", "advised", "ask", "sit", "sit_recording"]
