"""What an answer of ``check`` is worth: kind, place, verdict, and whether the corrected pair fits."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from truepose.errors import TrueposeError
from truepose.models.load import load_machine

from .align import misfit, sight
from .correct import CORRECT
from .pairs import MACHINE, found

FITS = 2.0
"""Misfit of a corrected pair over the right one's, at most."""
SIGMA_WITHIN = 5.0
VERDICTS = ("ok", "suspect", "wrong")


@dataclass(frozen=True)
class Answer:
    """``check --json`` and how it ended; verdict "" where nothing could be read."""

    verdict: str
    found: tuple[Mapping[str, Any], ...]
    exit: int
    seconds: float
    wall: float
    said: str


@dataclass(frozen=True)
class Scored:
    """One case. fits is None where no fix is asked for; over: its misfit over the right pair's."""

    name: str
    kind: str
    variant: str
    source: str
    verdict: str
    kinds: tuple[str, ...]
    where: tuple[str, ...]
    first: bool
    named: bool
    placed: bool
    fits: bool | None
    over: float | None
    exit: int
    seconds: float
    wall: float
    said: str


def scored(truth: Mapping[str, Any], answer: Answer, right: Path, fixed: Path) -> Scored:
    """The answer against the truth; ``fixed`` is where ``--fix`` wrote, or nothing."""
    kinds = tuple(str(f.get("kind")) for f in answer.found)
    good = {truth["kind"], *truth["kinds"]}
    own = [f for f in answer.found if f.get("kind") in good]
    where = tuple(str(w) for f in (own or answer.found[:1]) for w in f.get("where", ()))
    fits, over = (None, None) if not truth["mends"] else _mended(truth, right, fixed)
    return Scored(
        truth["name"],
        truth["kind"],
        truth["variant"],
        truth["source"],
        answer.verdict,
        kinds,
        where,
        first=bool(kinds) and kinds[0] in good,
        named=bool(own),
        placed=bool(own) and truth["kind"] != CORRECT and _placed(truth, own, right),
        fits=fits,
        over=over,
        exit=answer.exit,
        seconds=answer.seconds,
        wall=answer.wall,
        said=answer.said,
    )


def _placed(truth: Mapping[str, Any], own: Sequence[Mapping[str, Any]], right: Path) -> bool:
    """Whether one of the entries of the right kind says where."""
    legs, names = _names(right)
    for entry in own:
        words = {w for text in entry.get("where", ()) for w in _words(str(text))}
        words |= {legs[w] for w in words if w in legs}
        if truth["exact"]:
            if words & names == set(truth["where"]):
                return True
        elif words & set(truth["where"]):
            return True
    return False


def _words(text: str) -> set[str]:
    """A place as it stands, what is before its dots, and its words."""
    words = {text, *re.split(r"[\s,:;()\[\]]+", text)}
    return words | {w.split(".")[0] for w in words} | {w.split(".")[-1] for w in words}


def _names(right: Path) -> tuple[dict[str, str], set[str]]:
    """Joints by the name of their leg, and all joints and targets."""
    document = yaml.safe_load((right / MACHINE).read_text(encoding="utf-8"))
    legs = {leg["name"]: leg["joint"] for leg in document["mechanism"].get("legs", ())}
    joints = {a.reading for a in load_machine(right / MACHINE).mechanism.actuators}
    sensor = document["sensor"]
    return legs, joints | set(sensor.get("points", ()) if isinstance(sensor, dict) else ())


def _mended(truth: Mapping[str, Any], right: Path, fixed: Path) -> tuple[bool, float | None]:
    """Whether the corrected pair fits with base and tool alone, and by what factor."""
    held = truth["judged"] == "held"
    try:
        pair = sight(fixed)
        if pair.lost > 0.1 * len(pair.flange):
            return False, None
        over = misfit(pair, held=held).over(misfit(sight(right), held=held))
        fits = over < FITS and _alike(truth["kind"], right, fixed)
    except (TrueposeError, OSError, KeyError, ValueError):
        return False, None
    return fits, round(over, 3)


def _alike(kind: str, right: Path, fixed: Path) -> bool:
    """What a rigid fit does not see: rows that came twice are gone, sigma is near the right one."""
    if kind == "duplicated-rows":
        rows = [sum(len(pd.read_csv(p, comment="#")) for p in found(d)[1]) for d in (right, fixed)]
        return rows[1] <= rows[0]
    if kind == "sigma":
        sigmas = [[c.sigma for c in load_machine(found(d)[0]).channels] for d in (right, fixed)]
        return all(1 / SIGMA_WITHIN < a / b < SIGMA_WITHIN for a, b in zip(*sigmas, strict=True))
    return True


__all__ = ["FITS", "VERDICTS", "Answer", "Scored", "scored"]
