"""What is kept of a machine: one JSON-able record of a few kB, from which the table, the page and the prior are made.

``status`` says how far it came, ``why`` what stood in its way:

* ``done``: calibrated and diagnosed;
* ``refused``: the same, but its fit may not be called a calibration;
* ``wrong``: its files do not belong together, as ``truepose check`` says;
* ``failed``: bad input, or a fit without a minimum;
* ``broken``: its process died, ran out of time or met a fault of the program. It is tried again with the next run.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

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


__all__ = ["RECORD", "STATUSES", "Json", "Record", "Status", "figures_of", "parameters_of", "rounded"]
