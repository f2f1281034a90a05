"""What a diagnosis says, in short, and what of it has changed.

Kept are verdict, alarms, names, places, classes, families, halves, sets, probabilities, fitted sizes and the proof. Texts
are not kept, nor anything that another processor may round to something else.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from support.golden import Where, differences

Json = Mapping[str, Any]
PROBABILITY = 0.05
"""How far a probability may move."""
QUIET = 0.1
"""How far the p of an alarm may move: where the free fit ends in its flat valley differs by machine."""
SIZE = 0.5
"""How far a fitted size may move, in its own 1-sigma."""
RATIO = 0.05
"""How far a held-out ratio may move, as a share of it."""
SETTING = 0.1
"""How far a setting (a lag, a period) may move, as a share of it."""
LEAST = 0.02
"""Candidates, sets and effects of the posterior that are less probable are not kept."""


def summary(document: Json) -> dict[str, Any]:
    """What is kept of ``diagnosis.json``. Lists have an order of their own, so that equal probabilities cannot swap."""
    return {
        "verdict": document["verdict"],
        "concealed": document["concealed"],
        "alarms": {
            name: {"raised": a["raised"], "p": _short(a["p"])} for name, a in document["alarms"].items()
        },
        "findings": {_name(f): _finding(f) for f in sorted(document["findings"], key=_name)},
        "applied": (document["applied"] or {}).get("model"),
        "sets": {name: p for name, p in _sets(document["sets"]).items() if p >= LEAST},
        "inclusion": {k: p for k, p in _probabilities(document["inclusion"]).items() if p >= LEAST},
        "remainder": _remainder(document["remainder"]),
        "candidates": {k: p for k, p in _probabilities(document["candidates"]).items() if p >= LEAST},
        "untestable": sorted({u["effect"] for u in document["untestable"]}),
        "proof": _proof(document["proof"]),
    }


def text(kept: Json) -> str:
    """The content of ``expected.json``."""
    return json.dumps(kept, indent=1, ensure_ascii=False) + "\n"


def changes(old: Json, new: Json) -> list[str]:
    """Return what differs between two summaries by more than it may, a sentence each."""
    return list(differences(_without_sizes(old), _without_sizes(new), _is_same)) + _size_changes(old, new)


def _name(entry: Json) -> str:
    return f"{entry['effect']}@{'+'.join(entry['place'])}"


def _probabilities(entries: Sequence[Json]) -> dict[str, float]:
    """Probability of each name: settings of one effect at one place count together."""
    total: dict[str, float] = {}
    for entry in entries:
        total[_name(entry)] = total.get(_name(entry), 0.0) + float(entry["probability"])
    return {name: _short(total[name]) for name in sorted(total)}


def _sets(entries: Sequence[Json]) -> dict[str, float]:
    """Probability of each set of names, whatever the order of its names."""
    total: dict[str, float] = {}
    for entry in entries:
        name = (
            " & ".join(sorted(f"{slug}@{'+'.join(place)}" for slug, place in entry["effects"])) or "nothing"
        )
        total[name] = total.get(name, 0.0) + float(entry["probability"])
    return {name: _short(total[name]) for name in sorted(total)}


def _short(value: float) -> float:
    return round(float(value), 3)


def _finding(finding: Json) -> dict[str, Any]:
    return {
        "probability": _short(finding["probability"]),
        "certainty": _short(finding["certainty"]),
        "place known": _short(finding["levels"]["place"]),
        "driver": finding["levels"]["driver"]["kind"],
        "driver known": _short(finding["levels"]["driver"]["probability"]),
        "prior_dependent": finding["prior_dependent"],
        "family": finding["family"],
        "replication": _replication(finding["replication"]),
        "equivalents": _probabilities(finding["equivalents"]),
        "settings": [{k: _digits(v) for k, v in sorted(one.items())} for one in finding["settings"]],
        "parameters": {
            name: {"value": _digits(q["value"]), "std": _digits(q["std"]), "unit": q["unit"]}
            for name, q in sorted(finding["parameters"].items())
        },
    }


def _replication(halves: Json | None) -> dict[str, Any] | None:
    if halves is None:
        return None
    return {"halves": [_short(p) for p in halves["halves"]], "agree": halves["agree"]}


def _digits(value: float) -> float:
    return float(f"{value:.3g}")


def _remainder(left: Json | None) -> dict[str, Any] | None:
    if left is None:
        return None
    # what follows the first semicolon tells shares in whole percent, which may round otherwise elsewhere
    return {"place": left["place"], "driver": left["driver"], "form": left["form"].partition(";")[0]}


def _proof(proof: Json | None) -> dict[str, Any] | None:
    if proof is None:
        return None
    return {
        "held_out": proof["held_out"],
        "ratio": _short(proof["ratio"]),
        "blocks": {b["name"]: {"rows": b["rows"], "ratio": _short(b["ratio"])} for b in proof["blocks"]},
        "injected_recovered": proof["injected_recovered"],
    }


def _without_sizes(kept: Json) -> Json:
    """Return a summary with the units of parameters in the place of their sizes."""
    findings = {
        name: {**finding, "parameters": {k: q["unit"] for k, q in finding["parameters"].items()}}
        for name, finding in kept["findings"].items()
    }
    return {**kept, "findings": findings}


def _size_changes(old: Json, new: Json) -> list[str]:
    """Return the fitted sizes that moved, of findings and parameters that both summaries have."""
    return [
        f"{finding}: {name} was {a['value']:g} +- {a['std']:g} {a['unit']} and is {b['value']:g}"
        for finding in old["findings"].keys() & new["findings"].keys()
        for name, a in old["findings"][finding]["parameters"].items()
        if (b := new["findings"][finding]["parameters"].get(name))
        and abs(a["value"] - b["value"]) > SIZE * a["std"]
    ]


def _is_same(where: Where, old: Any, new: Any) -> bool:
    """Return whether numbers are as near as they must be; what is too improbable to be kept counts as 0."""
    if where[0] in ("sets", "inclusion", "candidates"):
        old, new = old or 0.0, new or 0.0
    if not (isinstance(old, float) and isinstance(new, float)):
        return bool(old == new)
    allowed = PROBABILITY
    if where[0] == "alarms":
        allowed = QUIET
    elif "settings" in where:
        allowed = SETTING * abs(old)
    elif where[-1] == "ratio":
        allowed = RATIO * old
    return abs(old - new) <= allowed
