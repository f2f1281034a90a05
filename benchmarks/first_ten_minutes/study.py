"""From the data sheet and the tracker's file to the report, by commands alone; and again with a line left out."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from .arm import Array
from .commands import Done, run
from .given import Given, write

MACHINE, RECORDING, RESULT = "kr14.yaml", "recording.csv", "result"
TRUTH = {("joint-compliance", "A2"), ("backlash", "A3")}
LADEN = "\nmasses:\n  load: {kg: 14, com: [0, 0, 0], in: tool}\n"
"""What the flange carries: with it the file of which a line is left out carries weight."""
OMISSIONS = ("gravity", "tolerances", "base")


@dataclass(frozen=True)
class Way:
    """One user's way: every command, names found, rms over unseen poses (mm) before and after, what went wrong."""

    seed: int
    done: tuple[Done, ...]
    named: frozenset[tuple[str, str]] = frozenset()
    before: float = float("nan")
    after: float = float("nan")
    faults: tuple[str, ...] = ()

    @property
    def seconds(self) -> float:
        """All commands."""
        return sum(d.seconds for d in self.done)

    @property
    def right(self) -> bool:
        """Both names, no other, and no command that failed."""
        return self.named == TRUTH and not self.faults


@dataclass(frozen=True)
class Told:
    """A line left out: what check and diagnose made of it. guessed: names that were asserted all the same."""

    omitted: str
    kinds: tuple[str, ...]
    verdict: str
    exits: tuple[int, int]
    says: bool
    guessed: frozenset[tuple[str, str]] = field(default_factory=frozenset)

    @property
    def right(self) -> bool:
        """It was told, by name or in words, and nothing was asserted that is not there."""
        return self.says and not self.guessed - TRUTH


def whole(folder: Path, seed: int) -> Way:
    """init, import, check, diagnose, predict."""
    given = write(folder, seed)
    commands = (
        ("init", "--table", given.sheet, "--convention", "standard", "--sensor", "position", "-o", MACHINE),
        ("import", given.points, "--joints", given.log, "-o", RECORDING),
        ("check", MACHINE, RECORDING),
        ("diagnose", MACHINE, RECORDING, "-o", RESULT),
    )
    done: list[Done] = []
    for words in commands:
        done.append(run(folder, *words))
        if done[-1].exit:
            return Way(seed, tuple(done), faults=(_fault(done[-1]),))
    named = _names(folder / RESULT / "diagnosis.json")
    plain = run(folder, "calibrate", MACHINE, RECORDING, "-o", "plain")
    errors = [_error(folder, f"{where}.yaml", given) for where in ("plain/calibrated", f"{RESULT}/improved")]
    missing = () if (folder / RESULT / "report.html").is_file() else ("no report.html",)
    faults = missing if not plain.exit else (*missing, _fault(plain))
    return Way(seed, tuple(done), named, errors[0], errors[1], faults)


def without(folder: Path, omitted: str) -> Told:
    """Check and diagnose of a finished way's files, with a section of the machine file left out."""
    text = left_out((folder / MACHINE).read_text(encoding="utf-8") + LADEN, omitted)
    name = f"without_{omitted}.yaml"
    (folder / name).write_text(text, encoding="utf-8")
    checked = run(folder, "check", name, RECORDING, "--json")
    out = f"without_{omitted}"
    diagnosed = run(folder, "diagnose", name, RECORDING, "-o", out)
    answer: dict[str, Any] = {}
    if checked.printed.strip().startswith("{"):
        answer = json.loads(checked.printed)
    kinds = tuple(str(f["kind"]) for f in answer.get("found", ()))
    wanted = "base-missing" if omitted == "base" else f"no-{omitted}"
    words = omitted if omitted != "base" else "frames.base"
    says = wanted in kinds and words in diagnosed.text
    file = folder / out / "diagnosis.json"
    guessed = _names(file) if file.is_file() else frozenset()
    verdict = str(answer.get("verdict", ""))
    return Told(omitted, kinds, verdict, (checked.exit, diagnosed.exit), says, guessed)


def left_out(text: str, omitted: str) -> str:
    """The machine file without the line or the block that begins with ``omitted``; comments stay."""
    indent = "  " if omitted == "base" else ""
    pattern = rf"^{indent}{omitted}:.*\n(?:{indent}[ ]+.*\n)*"
    out, count = re.subn(pattern, "", text, flags=re.MULTILINE)
    if count != 1:
        raise ValueError(f"{omitted}: found {count} times in the machine file, expected once")
    return out


def _names(path: Path) -> frozenset[tuple[str, str]]:
    """Effect and place of every finding; forms without a name are none."""
    found = json.loads(path.read_text(encoding="utf-8"))["findings"]
    pairs = [(str(f["effect"]), "+".join(f["place"])) for f in found]
    return frozenset(p for p in pairs if p[0] not in ("empirical", "outliers"))


def _error(folder: Path, machine: str, given: Given) -> float:
    """rms of the 3-D error (mm) at poses that nobody measured."""
    out = f"predicted_{Path(machine).stem}.csv"
    done = run(folder, "predict", machine, given.later, "-o", out)
    if done.exit:
        return float("nan")
    predicted: Array = pd.read_csv(folder / out, comment="#")[["x", "y", "z"]].to_numpy(dtype=float)
    return float(np.sqrt(np.mean(np.sum((predicted - given.unseen) ** 2, axis=1))))


def _fault(done: Done) -> str:
    lines = done.text.strip().splitlines() or [""]
    return f"{' '.join(done.words[:2])}: exit {done.exit}: {lines[0]}"


__all__ = ["OMISSIONS", "TRUTH", "Told", "Way", "left_out", "whole", "without"]
