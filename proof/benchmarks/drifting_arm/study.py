"""One sequence of the study: what ``drift`` says when nothing moves, when one constant does, and when many do."""

from __future__ import annotations

import functools
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from support.drifting_arm import FREE, write_sequence
from truepose.identification.leaves.drift.analysis import Drift, drift
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine


@dataclass(frozen=True)
class Outcome:
    """What was said of one movement: found (as itself, or with itself among the alternatives), others named too,
    and the error of its size in stds (NaN where it was not found)."""

    found: bool
    named: bool
    others: int
    error: float


def compare(seed: int, moves: dict[str, list[float]]) -> Drift:
    """``drift`` on one sequence."""
    with tempfile.TemporaryDirectory() as folder:
        file, recordings = write_sequence(Path(folder), seed, moves)
        machine = load_machine(file)
        return drift(machine, load_recording(machine, recordings))


def still(seed: int) -> tuple[int, list[float], list[bool]]:
    """Movements seen where there are none; p values of older calibrations, and whether they were kept."""
    found = compare(seed, {})
    checks = [c for c in (*found.durability.carried, *found.durability.frames) if c is not None]
    return len(found.moved), [c.p for c in checks], [c.holds for c in checks]


@functools.cache
def hidden() -> dict[str, float]:
    """1-sigma of a movement of each constant, if it moved alone: alike for all arms, from one that stays."""
    return {m.name: m.hidden for m in compare(999, {}).movements}


def moving(seed: int, size: float) -> Outcome:
    """One constant moves by ``size`` times what would stay hidden."""
    name = list(FREE)[seed % len(FREE)]
    step = size * hidden()[name]
    found = compare(seed, {name: [0.0, 0.0, step, step]})
    own = [m for m in found.moved if m.name == name]
    alike = [m for m in found.moved if name in m.alike]
    error = (own[0].change[-1] - step) / own[0].std[-1] if own else np.nan
    return Outcome(bool(own or alike), bool(own), len(found.moved) - len(own or alike), error)


@dataclass(frozen=True)
class Several:
    """How many constants moved, how many of these were named, how many others, and sizes off by more than 4 stds."""

    moved: int
    named: int
    others: int
    far_off: int


def several(seed: int) -> Several:
    """Frames set up anew and up to three parts, each by 4 to 40 times what would stay hidden, at any session."""
    rng, moves = np.random.default_rng(seed), dict[str, list[float]]()
    names = [f"base.{a}" for a in ("x", "y", "z", "rx", "ry", "rz")] if rng.random() < 0.7 else []
    names += [f"tool.{a}" for a in ("x", "y", "z")] if rng.random() < 0.3 else []
    for name in [*names, *map(str, rng.choice(list(FREE), rng.integers(0, 4), replace=False))]:
        step = float(np.exp(rng.uniform(np.log(4.0), np.log(40.0)))) * hidden()[name] * rng.choice([-1, 1])
        before = int(rng.integers(1, 4))
        moves[name] = [0.0] * before + [step] * (4 - before)
    found = compare(1000 + seed, moves).moved
    right = [m for m in found if m.name in moves]
    far_off = sum(abs(m.change[-1] - moves[m.name][-1]) > 4.0 * m.std[-1] for m in right)
    return Several(len(moves), len(right), len(found) - len(right), far_off)
