"""What is kept of a machine: one JSON-able record of a few kB, from which the table, the page and the prior are made.

``status`` says how far it came, ``why`` what stood in its way:

* ``done``: calibrated and diagnosed;
* ``refused``: the same, but its fit may not be called a calibration;
* ``wrong``: its files do not belong together, as ``truepose check`` says;
* ``failed``: bad input, or a fit without a minimum;
* ``broken``: its process died, ran out of time or met a fault of the program. It is tried again with the next run.

Records are kept a line each: those of the last run that ended in ``records.jsonl``, by name, and those of a run that has not
in its journal, where a line is added when a machine is done. A run that was killed left what it had done there.

What changed in a fleet since its last run: machines new and gone, verdicts, names, parameters that moved.

A parameter has moved where the difference of its two values is more than chance allows: beyond ``FALSE`` for one such among
all that were compared, whatever their number.
"""

from __future__ import annotations

import heapq
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import IO, Any, Literal, get_args

from scipy.stats import norm

# -- What is kept of a machine: one JSON-able record of a few kB, from which the table, the page and the prior are made

Json = dict[str, Any]
Status = Literal["done", "refused", "wrong", "failed", "broken"]
STATUSES: tuple[Status, ...] = get_args(Status)
SCHEMA = "truepose/fleet-record/1"
RECORD = "record.json"
DIGITS = 6
"""Significant digits of figures: more than a table shows."""
FINE = 1e-3
"""Parameters are kept to this part of their 1-sigma."""


@dataclass(frozen=True)
class Record:
    """One machine.

    key: of its inputs (``Member.key``); figures: what the table shows of it, empty unless it was diagnosed; parameters: value
    and 1-sigma (mm, rad) of each that its readings show; evidence: what the fleet's statistics are made of.
    """

    name: str
    key: str
    status: Status
    why: str = ""
    figures: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    evidence: Mapping[str, Any] = field(default_factory=dict)

    @property
    def diagnosed(self) -> bool:
        """Whether there is a diagnosis."""
        return self.status in ("done", "refused")

    @property
    def final(self) -> bool:
        """Whether the same files would give the same again."""
        return self.status != "broken"

    def document(self) -> Json:
        """As it is stored."""
        return {"schema": SCHEMA, **{name: getattr(self, name) for name in _FIELDS}}

    def text(self) -> str:
        """One line of JSON; the same record, the same text."""
        return json.dumps(self.document(), ensure_ascii=False, separators=(",", ":"), allow_nan=False)

    @classmethod
    def of_text(cls, text: str) -> Record | None:
        """What a text holds; None where it is no whole record, or another program's."""
        try:
            document = json.loads(text)
            if document["schema"] != SCHEMA or document["status"] not in STATUSES:
                return None
            pairs = {name: (float(v), float(s)) for name, (v, s) in document["parameters"].items()}
            return cls(**{name: document[name] for name in _FIELDS} | {"parameters": pairs})
        except (ValueError, KeyError, TypeError, AttributeError):
            return None

    @classmethod
    def read(cls, folder: Path) -> Record | None:
        """The record in a machine's folder of results; None where there is none that is whole."""
        try:
            return cls.of_text((folder / RECORD).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None


_FIELDS = ("name", "key", "status", "why", "figures", "parameters", "evidence")


def figures_of(diagnosis: Mapping[str, Any], check: str) -> Json:
    """What the table shows, from the content of a ``diagnosis.json`` and the verdict of the ``check``."""
    before, after, proof = diagnosis["fit"]["before"], diagnosis["fit"]["after"], diagnosis["proof"]
    return {
        "machine": diagnosis["machine"],
        "check": check,
        "verdict": diagnosis["verdict"],
        "concealed": diagnosis["concealed"],
        "chi2": [rounded(before["chi2_per_dof"]), rounded(after["chi2_per_dof"])],
        "rms": dict(_rms(before, after)),
        "ratio": proof and rounded(proof["ratio"]),
        "noise": rounded(diagnosis["noise"]),
        "findings": [_finding(one) for one in diagnosis["findings"]],
        "remainder": diagnosis["remainder"] and diagnosis["remainder"]["driver"],
    }


def parameters_of(diagnosis: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Value and 1-sigma of every parameter that the readings show."""
    return {
        name: (_resolved(one["value"], one["std"]), rounded(one["std"]))
        for name, one in diagnosis["parameters"].items()
        if one["identifiable"] and one["std"] is not None
    }


def _rms(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[tuple[str, Json]]:
    """Rms by kind of reading, before and after: of held-out rows where there are some, else of the fitted ones."""
    held = bool(before["validation_rms"] and after["validation_rms"])
    which = "validation_rms" if held else "rms"
    for kind, last in after[which].items():
        first = before[which].get(kind)
        if first is not None:
            values = {"before": rounded(first["value"]), "after": rounded(last["value"])}
            yield kind, {**values, "unit": last["unit"], "held_out": held}


def _finding(one: Mapping[str, Any]) -> Json:
    return {
        "effect": one["effect"],
        "place": one["place"],
        "driver": one["levels"]["driver"]["kind"],
        "probability": rounded(one["probability"]),
    }


def _resolved(value: float, std: float) -> float:
    """A value to a small part of its 1-sigma."""
    return round(value, -math.floor(math.log10(FINE * std))) if std > 0 else value


def rounded(value: float | None) -> Any:
    """To ``DIGITS`` significant digits; None for what is no number."""
    return None if value is None else float(f"{value:.{DIGITS}g}")


RECORDS, JOURNAL = "records.jsonl", "journal.jsonl"


@dataclass(frozen=True)
class Records:
    """A file of records, a line each: those of the last run that ended, by name, or the journal of one that has not.

    The last line of a machine holds. A line that was cut off is none, and so is one of another version.
    """

    path: Path

    @property
    def exists(self) -> bool:
        """Whether there is such a file."""
        return self.path.is_file()

    def keys(self) -> dict[str, str]:
        """The key of every machine whose files would give the same again."""
        return {name: key for name, (key, final, _) in self._places().items() if final}

    def read(self, keys: Mapping[str, str] | None = None) -> Iterator[Record]:
        """Records by name, all or those whose key is the one given for their name; only where they are is held in memory."""
        places = self._places()
        if not places:
            return
        with self.path.open("rb") as stream:
            for name, (key, _, at) in sorted(places.items()):
                stream.seek(at)
                if keys is None or keys.get(name) == key:
                    record = _of_line(stream.readline())
                    if record is not None:
                        yield record

    def _places(self) -> dict[str, tuple[str, bool, int]]:
        """Key of each machine, whether its record is final, and where in the file that begins, in bytes."""
        found, at = dict[str, tuple[str, bool, int]](), 0
        if not self.exists:
            return found
        with self.path.open("rb") as stream:
            for line in stream:
                record = _of_line(line)
                if record is not None:
                    found[record.name] = record.key, record.final, at
                at += len(line)
        return found

    def open(self) -> IO[str]:
        """For more lines."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        stream = self.path.open("a", encoding="utf-8", newline="\n")
        stream.write("\n")  # ends what was cut off
        return stream

    @staticmethod
    def note(stream: IO[str], record: Record) -> None:
        """A line, in the hands of the system before the next machine is."""
        stream.write(record.text() + "\n")
        stream.flush()

    def write(self, records: Iterable[Record]) -> None:
        """Records, by name; the same records, the same bytes."""
        with self.path.open("w", encoding="utf-8", newline="\n") as stream:
            stream.writelines(record.text() + "\n" for record in records)


def _of_line(line: bytes) -> Record | None:
    return Record.of_text(line.decode("utf-8", errors="replace").rstrip("\n"))


# -- What changed in a fleet since its last run: machines new and gone, verdicts, names, parameters that moved

FALSE = 0.05
"""Probability that of all parameters compared one that stands still is said to have moved. The usual level."""
LEAST = 3.0
"""Difference in 1-sigma below which nothing is said to have moved, however few were compared: the field's three sigma."""


@dataclass(frozen=True)
class Moved:
    """A parameter that moved by ``change`` (mm or rad), ``sigma`` times its 1-sigma."""

    machine: str
    parameter: str
    change: float
    sigma: float


@dataclass(frozen=True)
class Change:
    """Something that is said of a machine otherwise than before. what: ``status``, ``verdict`` or ``findings``."""

    machine: str
    what: str
    before: str
    after: str


@dataclass(frozen=True)
class Changes:
    """All of it, by machine; moved: largest first. compared: parameters of machines that were worked with again."""

    new: tuple[str, ...] = ()
    gone: tuple[str, ...] = ()
    said: tuple[Change, ...] = ()
    moved: tuple[Moved, ...] = ()
    compared: int = 0
    again: int = 0

    @property
    def any(self) -> bool:
        """Whether there is something to tell."""
        return bool(self.new or self.gone or self.said or self.moved)

    @property
    def limit(self) -> float:
        """Difference in 1-sigma beyond which chance is no explanation."""
        return limit(self.compared)


def limit(compared: int) -> float:
    """Two-sided normal quantile, the level shared out among all comparisons (Bonferroni); never below ``LEAST``."""
    return max(float(norm.isf(FALSE / 2 / max(compared, 1))), LEAST)


@dataclass
class Comparison:
    """Pairs of records, taken one after the other."""

    new: list[str] = field(default_factory=list)
    gone: list[str] = field(default_factory=list)
    said: list[Change] = field(default_factory=list)
    far: list[Moved] = field(default_factory=list)
    compared: int = 0
    again: int = 0

    def take(self, before: Record | None, after: Record | None) -> None:
        """A machine's record of the last run and of this one; None where there is none."""
        if after is None:
            self.gone.append(before.name if before else "")
        elif before is None:
            self.new.append(after.name)
        elif before != after:
            self.again += 1
            self.said += _said(before, after)
            shared = before.parameters.keys() & after.parameters.keys()
            self.compared += len(shared)
            self.far += [one for one in (_moved(before, after, name) for name in sorted(shared)) if one]

    def result(self) -> Changes:
        """What changed."""
        least = limit(self.compared)
        moved = sorted(
            (m for m in self.far if m.sigma > least), key=lambda m: (-m.sigma, m.machine, m.parameter)
        )
        return Changes(
            tuple(self.new), tuple(self.gone), tuple(self.said), tuple(moved), self.compared, self.again
        )


def compared(before: Iterable[Record], after: Iterable[Record]) -> Changes:
    """Two runs, both by name."""
    comparison = Comparison()
    for old, new in paired(before, after):
        comparison.take(old, new)
    return comparison.result()


def paired(
    before: Iterable[Record], after: Iterable[Record]
) -> Iterator[tuple[Record | None, Record | None]]:
    """Records of two runs, by machine; each run in the order of names."""
    both = heapq.merge(
        ((r.name, 0, r) for r in before), ((r.name, 1, r) for r in after), key=lambda one: one[:2]
    )
    for _, several in groupby(both, key=lambda one: one[0]):
        by_run = {which: item for _, which, item in several}
        yield by_run.get(0), by_run.get(1)


def _said(before: Record, after: Record) -> Iterator[Change]:
    pairs = {
        "status": (before.status, after.status),
        "verdict": (_verdict(before), _verdict(after)),
        "findings": (findings_text(before), findings_text(after)),
    }
    for what, (old, new) in pairs.items():
        if old != new:
            yield Change(after.name, what, old, new)
        if what == "status" and before.diagnosed != after.diagnosed:
            return  # the others are known of one of them only


def _verdict(record: Record) -> str:
    return str(record.figures.get("verdict", ""))


def findings_text(record: Record) -> str:
    """``backlash at q2; link-bending at link2 + link3``: what was found, in the order of names."""
    found: Iterable[Mapping[str, Any]] = record.figures.get("findings", ())
    return "; ".join(sorted(f"{one['effect']} at {' + '.join(one['place'])}" for one in found))


def _moved(before: Record, after: Record, name: str) -> Moved | None:
    (old, old_std), (new, new_std) = before.parameters[name], after.parameters[name]
    std = math.hypot(old_std, new_std)
    sigma = abs(new - old) / std if std > 0 else 0.0
    return Moved(after.name, name, new - old, sigma) if sigma > LEAST else None
