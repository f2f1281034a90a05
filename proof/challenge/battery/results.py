"""What a folder of the battery holds: scores of simulated cases, diagnoses and measures of real ones."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from challenge.battery.parts import RECORDED, SIMULATED
from challenge.battery.recorded import MEASURES
from challenge.examine import RUN
from challenge.examinee import DIAGNOSIS
from challenge.score import Score, read_score
from truepose.errors import InputError

Json = Mapping[str, Any]


@dataclass(frozen=True)
class Results:
    """One part of one folder, by case. scores: of simulated cases; measures: of real recordings that were diagnosed; runs: how
    long, and what went wrong; diagnoses: those that there are."""

    runs: Mapping[str, Json] = field(default_factory=dict)
    diagnoses: Mapping[str, Json] = field(default_factory=dict)
    scores: tuple[Score, ...] = ()
    measures: Mapping[str, Json] = field(default_factory=dict)


def done(folder: Path, part: str) -> set[str]:
    """Cases of a part that have a result."""
    return {file.parent.name for file in (folder / part / "results").glob(f"*/{RUN}")}


def read(folder: Path, part: str, cases: Collection[str]) -> Results:
    """The results of some cases, in order. Raises InputError where the key of a simulated case is not beside them."""
    own, names = folder / part, sorted(cases)
    for key in (own / "answers" / f"{case}.json" for case in names if part in SIMULATED):
        if not key.is_file():
            raise InputError(f"{key}: found no such file, expected the key of a case that was sat")
    diagnoses = _files(own, names, DIAGNOSIS)
    scores = tuple(read_score(own, own, case) for case in names) if part in SIMULATED else ()
    measures = _files(own, names, MEASURES) if part == RECORDED else {}
    return Results(_files(own, names, RUN), diagnoses, scores, measures)


def _files(folder: Path, cases: Collection[str], name: str) -> dict[str, Json]:
    files = {case: folder / "results" / case / name for case in cases}
    return {case: json.loads(f.read_text(encoding="utf-8")) for case, f in files.items() if f.is_file()}


__all__ = ["Results", "done", "read"]
