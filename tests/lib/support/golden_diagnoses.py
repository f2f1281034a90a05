"""What a diagnosis says, in short, and what of it has changed.

Kept are verdict, alarms, names, places, classes, families, halves, sets, probabilities, fitted sizes and the proof. Texts
are not kept, nor anything that another processor may round to something else.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

Json = Mapping[str, Any]
PROBABILITY = 0.05
"""How far a probability, or the p of an alarm, may move."""
QUIET = 0.1
"""How far the p of an alarm may move that neither raises: where the free fit ends in its flat valley differs by machine."""
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
        "alarms": {name: _alarm(alarm) for name, alarm in document["alarms"].items()},
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
    """What differs between two summaries by more than it may, a sentence each."""
    out = [
        f"the {key} was {_told(old.get(key))} and is {_told(new[key])}"
        for key in ("verdict", "concealed", "applied", "remainder")
        if old.get(key) != new[key]
    ]
    out += _alarms(old["alarms"], new["alarms"])
    out += _names("finding", old["findings"], new["findings"])
    for name in sorted(old["findings"].keys() & new["findings"].keys()):
        out += [f"{name}: {said}" for said in _finding_changes(old["findings"][name], new["findings"][name])]
    for key, what in (("sets", "set"), ("inclusion", "effect"), ("candidates", "candidate")):
        out += [f"{what} {said}" for said in _moved(old.get(key, {}), new[key])]
    out += _names("untestable effect", old["untestable"], new["untestable"])
    return [*out, *_proof_changes(old["proof"], new["proof"])]


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


def _alarm(alarm: Json) -> dict[str, Any]:
    return {"raised": alarm["raised"], "p": _short(alarm["p"])}


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


def _told(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)


def _names(what: str, old: Iterable[str], new: Iterable[str]) -> list[str]:
    gone, added = sorted(set(old) - set(new)), sorted(set(new) - set(old))
    return [f"{what} {name} is gone" for name in gone] + [f"{what} {name} is new" for name in added]


def _moved(old: Mapping[str, float], new: Mapping[str, float]) -> list[str]:
    """Probabilities that moved; what is not kept counts as 0."""
    pairs = {name: (old.get(name, 0.0), new.get(name, 0.0)) for name in sorted({*old, *new})}
    return [
        f"{name}: the probability was {a:.3f} and is {b:.3f}"
        for name, (a, b) in pairs.items()
        if abs(a - b) > PROBABILITY
    ]


def _alarms(old: Json, new: Json) -> Iterator[str]:
    for name in sorted({*old, *new}):
        a, b = old.get(name), new.get(name)
        allowed = QUIET if a and b and not (a["raised"] or b["raised"]) else PROBABILITY
        if a is None or b is None or a["raised"] != b["raised"] or abs(a["p"] - b["p"]) > allowed:
            yield f"the alarm {name} was {_told(a)} and is {_told(b)}"


def _finding_changes(old: Json, new: Json) -> Iterator[str]:
    for key in ("probability", "certainty", "place known", "driver known"):
        if abs(old.get(key, -1.0) - new[key]) > PROBABILITY:
            yield f"the {key} was {_told(old.get(key))} and is {new[key]:.3f}"
    for key in ("driver", "prior_dependent", "family"):
        if old.get(key) != new[key]:
            yield f"{key} was {_told(old.get(key))} and is {_told(new[key])}"
    if not _same_halves(old.get("replication"), new["replication"]):
        yield f"the halves said {_told(old.get('replication'))} and say {_told(new['replication'])}"
    yield from _names("equivalent", old["equivalents"], new["equivalents"])
    yield from (f"equivalent {said}" for said in _moved(old["equivalents"], new["equivalents"]))
    if not _same_settings(old["settings"], new["settings"]):
        yield f"the settings were {_told(old['settings'])} and are {_told(new['settings'])}"
    yield from _names("parameter", old["parameters"], new["parameters"])
    for name in sorted(old["parameters"].keys() & new["parameters"].keys()):
        a, b = old["parameters"][name], new["parameters"][name]
        if a["unit"] != b["unit"] or abs(a["value"] - b["value"]) > SIZE * a["std"]:
            yield f"{name} was {a['value']:g} +- {a['std']:g} {a['unit']} and is {b['value']:g} {b['unit']}"


def _same_halves(old: Json | None, new: Json | None) -> bool:
    if old is None or new is None:
        return old is new
    apart = [abs(a - b) for a, b in zip(old["halves"], new["halves"], strict=True)]
    return bool(old["agree"] == new["agree"]) and max(apart) <= PROBABILITY


def _same_settings(old: Sequence[Mapping[str, float]], new: Sequence[Mapping[str, float]]) -> bool:
    return len(old) == len(new) and all(
        a.keys() == b.keys() and all(abs(a[k] - b[k]) <= SETTING * abs(a[k]) for k in a)
        for a, b in zip(old, new, strict=True)
    )


def _proof_changes(old: Json | None, new: Json | None) -> Iterator[str]:
    if old is None or new is None:
        if old != new:
            yield f"the proof was {_told(old)} and is {_told(new)}"
        return
    for key in ("held_out", "injected_recovered"):
        if old[key] != new[key]:
            yield f"proof: {key} was {_told(old[key])} and is {_told(new[key])}"
    yield from (f"proof: {said}" for said in _names("block", old["blocks"], new["blocks"]))
    before, after = ({**p["blocks"], "as a whole": {"rows": 0, "ratio": p["ratio"]}} for p in (old, new))
    for name in sorted(before.keys() & after.keys()):
        a, b = before[name], after[name]
        if a["rows"] != b["rows"]:
            yield f"proof: held-out {name} were {a['rows']} rows and are {b['rows']}"
        if abs(a["ratio"] - b["ratio"]) > RATIO * a["ratio"]:
            yield f"proof: held-out {name}: the ratio was {a['ratio']} and is {b['ratio']}"
