"""Keys of small cases, replies to them made by hand, and scores of a few of both."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from challenge.findings import Reply, read_reply
from challenge.predictions import Predicted
from challenge.score import Score, score
from challenge.solutions import Geometry, HeldOut, Reference, Solution, Truth

GEOMETRY = Geometry(("a", "b"), (1.0, 2.0), (0.1, 0.2), ((1.0, 0.0),))
HELD = HeldOut(("x",), ("mm",), (0.01,), ((1.0,), (2.0,)))
PLAY = Truth("play", "backlash", ("rho1",), 2.0, 1.0, 0.5, 20.0, equivalents=(("zero-shift", ("rho1",)),))
BEND = Truth("bend", "platform-deformation", ("platform",), 3.0, 1.0, 0.5, 30.0)
BEAT = Truth("beat", "", ("rho2",), 2.0, 1.0, 0.5, 20.0)


def key(*truths: Truth, stratum: str = "single", concealed: bool = False) -> Solution:
    """What was put in: nothing, or these."""
    return Solution(
        "case001", "telescope", stratum if truths else "null", "", truths, concealed, 1.1, {"leg1": "rho1"},
        GEOMETRY, HELD, Reference(4.0, 10.0), Reference(1.0, 1.0),
    )  # fmt: skip


def finding(
    effect: str, place: str, probability: float = 0.97, gain: float = 10.0, *others: tuple[str, str, float]
) -> dict[str, Any]:
    """A name, and others that are as good: effect, place, probability."""
    return {
        "effect": effect, "place": place.split("+"), "probability": probability, "certainty": 0.99,
        "log_bayes_factor": gain,
        "equivalents": [{"effect": e, "place": p.split("+"), "probability": q} for e, p, q in others],
    }  # fmt: skip


def leveled(found: dict[str, Any], kind: str, driver: float, place: float | None = None) -> dict[str, Any]:
    """A finding that tells its levels, too: kind and probability of its driver, and of something at its place."""
    law = None if found["effect"] == "empirical" else found["probability"]
    levels = {"place": place or driver, "driver": {"kind": kind, "probability": driver}, "law": law}
    return {**found, "levels": levels}


def nameless(place: str, kind: str, driver: float) -> dict[str, Any]:
    """A finding whose place and driver are known, and no law."""
    return leveled(finding("empirical", place, 0.0), kind, driver)


def reply(tmp_path: Path, verdict: str, *findings: dict[str, Any], concealed: bool = False) -> Reply:
    """A diagnosis as it is read from its file, which stays in ``tmp_path``."""
    document = {
        "verdict": verdict, "concealed": concealed, "findings": list(findings),
        "parameters": {"a": {"value": 1.2}, "b": {"value": 9.0}},
    }  # fmt: skip
    (tmp_path / "diagnosis.json").write_text(json.dumps(document))
    read = read_reply(tmp_path / "diagnosis.json")
    assert read is not None
    return read


def examination(tmp_path: Path) -> list[Score]:
    """Seven scores: nothing there, once without a diagnosis; one effect three times, two, and one outside the library."""
    named = reply(tmp_path, "missing-physics", finding("backlash", "rho1"))
    out = [
        score(key(), reply(tmp_path, "adequate"), predicted=Predicted(4.0)),
        score(key(), None, failure="crash"),
    ]
    out += [
        score(key(PLAY, stratum=s), named, predicted=Predicted(1.2))
        for s in ("single", "concealed", "look-alike")
    ]
    out.append(score(key(PLAY, BEND, stratum="two"), named, predicted=Predicted(2.0)))
    return [*out, score(key(BEAT, stratum="out-of-library"), reply(tmp_path, "unknown"))]
