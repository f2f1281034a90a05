"""Base and tool swapped, left out, or stated as exact where they are not."""

from __future__ import annotations

import numpy as np

from ..pairs import Document, Pair
from .spoilt import Spoilt


def _known(pair: Pair, name: str) -> bool:
    """Whether the frame stands somewhere and is told so within a tolerance."""
    section = pair.document.get("frames", {}).get(name)
    if not section or not np.any([*section.get("xyz", [0]), *section.get("rpy", [0])]):
        return False
    tolerance = section.get("tolerance", {})
    return bool(np.all(np.isfinite([tolerance.get("xyz", 0.0), tolerance.get("rpy", 0.0)])))


def frames_swapped(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """The base's numbers under ``tool``, and the reverse."""
    if not (_known(pair, "base") and _known(pair, "tool")) or pair.sensor == "ballbar":
        return None
    document, table = pair.draft()
    base, tool = document["frames"]["base"], document["frames"]["tool"]
    own = {"base": base.get("in", "world"), "tool": tool.get("in", "flange")}
    document["frames"] = {"base": {**tool, "in": own["base"]}, "tool": {**base, "in": own["tool"]}}
    return Spoilt("swapped", document, table, ("base", "tool", "frames"))


def base_missing(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """No base, a base at zero that is exact, or an exact one that stands elsewhere."""
    return _missing(pair, "base", rng)


def tool_missing(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """No tool, a tool at zero that is exact, or an exact one that is another."""
    return _missing(pair, "tool", rng)


def _missing(pair: Pair, name: str, rng: np.random.Generator) -> Spoilt | None:
    if not _known(pair, name):
        return None
    if name == "tool" and pair.form == "3ups-up-3r":
        return None  # the form has a tool of its own
    document, table = pair.draft()
    variant = str(rng.choice(["left out", "exact zero", "exact, elsewhere"]))
    if variant == "left out":
        _leave_out(document, name)
    else:
        section = document["frames"][name]
        section["tolerance"] = {"xyz": 0.0, "rpy": 0.0}
        if variant == "exact zero":
            section["xyz"], section["rpy"] = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        else:
            size = max(float(np.linalg.norm(section["xyz"])), 50.0)
            moved = np.array(section["xyz"]) + size * rng.uniform(0.2, 0.8, 3) * rng.choice([-1, 1], 3)
            section["xyz"] = np.round(moved, 1).tolist()
    return Spoilt(variant, document, table, (name, "frames", f"frames.{name}"))


def _leave_out(document: Document, name: str) -> None:
    del document["frames"][name]
    if not document["frames"]:
        del document["frames"]
