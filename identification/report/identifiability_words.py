"""What poses can tell, as a document and as JSON."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from truepose.identification.identifiability.analysis import Identifiability, ParameterSight
from truepose.identification.identifiability.observability import Direction
from truepose.identification.report.json_text import Json, attributes, finite
from truepose.identification.report.notes import worded
from truepose.identification.report.unseen_words import grouped, terms, unseen_sentences
from truepose.shown.document import Document, Items, Table
from truepose.shown.result import document
from truepose.wording import shortened

SCHEMA = "truepose/identifiability/1"
SHOWN = 8
HEAD = ("least known", "tolerance", "1-sigma to expect", "status")


@document.register
def identifiability_document(found: Identifiability) -> Document:
    """Return what was looked at, rank, unseen directions, nearly unseen ones, and parameters."""
    i, left = found.indices, found.subset.relations
    seen = f"the readings see {found.rank} of {found.free} directions of the free parameters"
    exactly = (
        f" ({found.rank_at_drawing} exactly at the drawing)" if found.rank > found.rank_at_drawing else ""
    )
    indices = ", ".join(f"O{k} {v:.3g}" for k, v in enumerate((i.o1, i.o2, i.o3, i.o4, i.o5), start=1))
    facts = [
        f"{seen}{exactly}",
        f"condition number {i.condition:.3g}; observability {indices}"
        " (seen directions; columns in tolerances, readings in sigmas)",
    ]
    built = [terms(found.known, d) for d in found.unseen_at_drawing]
    nearly = [
        f"{terms(found.known, d)} (readings alone: {1 / d.size:.3g} tolerances)"
        for d in found.nearly
        if d.size > 0
    ]
    alike = (
        f"{len(found.subset.kept)} parameters can be told apart from each other; left out as alike:"
        f" {shortened(list(left), SHOWN)}"
    )
    size = f"(at best {found.as_built_size:.3g} sigmas a tolerance)"
    lists = [
        Items(facts),
        Items(unseen_sentences(found.unseen), "What no reading sees", label="no reading sees"),
        Items(built, f"Unseen at the drawing, hardly seen on a machine as built {size}", label="hardly seen"),
        Items(
            nearly, "Seen worse than the tolerances say, so that tolerances decide", label="tolerances decide"
        ),
        Items(status_lines(found), "Parameters"),
        Items([alike] if left else []),
    ]
    order = sorted(found.parameters, key=lambda p: -_left(p.std, p.tolerance))
    rows = [[p.name, quantity(p.tolerance, p.unit), quantity(p.std, p.unit), _remark(p)] for p in order]
    return Document(
        f"Identifiability of {found.machine}",
        poses_line(found),
        summary=[*(one for one in lists if one.items), Table(HEAD, rows)],
        notes=worded(found.notes),
        more="to_frame(), or --json, has all",
    )


def _left(std: float, tolerance: float) -> float:
    """What is left of a tolerance, to what is no rounding; more than anything where nothing decides."""
    return round(std / tolerance, 6) if np.isfinite(tolerance) else float(np.inf if np.isinf(std) else 0.0)


def poses_line(found: Identifiability) -> str:
    if found.seed is not None:
        source = f"{found.poses} poses drawn over the joints' ranges (seed {found.seed})"
    else:
        source = f"{found.poses} poses of {', '.join(Path(name).name for name in found.files)}"
    return f"{found.machine}: {source}, {found.n_observations} readings"


def status_lines(found: Identifiability) -> list[str]:
    out = []
    for status in ("determined", "partly", "tolerance decides", "nothing decides"):
        names = [p.name for p in found.parameters if p.status == status]
        if names:
            out.append(f"{status} ({len(names)}): {', '.join(grouped(names))}")
    return out


def _remark(parameter: ParameterSight) -> str:
    if not parameter.partners:
        return parameter.status
    return f"{parameter.status}; trades with {shortened(grouped(parameter.partners), 3)}"


def quantity(value: float, unit: str) -> str:
    if np.isinf(value):
        return "unknown"
    factor, name = {"rad": (180.0 / np.pi, "deg")}.get(unit, (1.0, unit))
    return f"{value * factor:.3g} {'' if name == '1' else name}".rstrip()


def identifiability_json(found: Identifiability) -> Json:
    """Everything, in mm and rad; what is infinite or no number becomes null."""
    i = found.indices
    out = {
        "schema": SCHEMA,
        **attributes(found, "machine", "files", "seed", "poses"),
        "readings": found.n_observations,
        "free_parameters": found.free,
        **attributes(found, "rank", "rank_at_drawing"),
        "condition": i.condition,
        "observability": {"O1": i.o1, "O2": i.o2, "O3": i.o3, "O4": i.o4, "O5": i.o5},
        "parameters": {
            p.name: attributes(p, "unit", "tolerance", "std", "std_at_drawing", "status")
            | {"trades_with": list(p.partners)}
            for p in found.parameters
        },
        "unseen": [_direction(found, d) for d in found.unseen.directions],
        "unseen_at_drawing": [_direction(found, d) for d in found.unseen_at_drawing],
        "nearly_unseen": [{**_direction(found, d), "sigmas_a_tolerance": d.size} for d in found.nearly],
        "sentences": unseen_sentences(found.unseen),
        "independent": {
            "kept": list(found.subset.kept),
            "left_out": {name: dict(terms) for name, terms in found.subset.relations.items()},
            "condition": found.subset.condition,
        },
        "notes": worded(found.notes),
    }
    return dict(finite(out))


def _direction(found: Identifiability, direction: Direction) -> Json:
    return {"parts": dict(direction.parts), "meaning": terms(found.known, direction)}
