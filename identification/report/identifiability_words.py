"""What poses can tell, as lines for a terminal and as JSON."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truepose.identification.identifiability.analysis import Identifiability, ParameterSight
from truepose.identification.identifiability.observability import Direction
from truepose.identification.report.json_text import Json, finite
from truepose.identification.report.notes import worded
from truepose.identification.report.unseen_words import grouped, terms, unseen_sentences
from truepose.wording import shortened

SCHEMA = "truepose/identifiability/1"
SHOWN = 8


def identifiability_lines(found: Identifiability, *, every: bool = False) -> list[str]:
    """Plain lines: what was looked at, rank, unseen directions, nearly unseen ones, parameters.

    ``every``: all parameters and directions, else the first few of each kind.
    """
    most = None if every else SHOWN
    lines = [poses_line(found), *rank_lines(found)]
    lines += _titled("no reading sees:", unseen_sentences(found.unseen), most)
    lines += _titled(_as_built_title(found), [terms(found.known, d) for d in found.unseen_at_drawing], most)
    nearly = [
        f"{terms(found.known, d)} (readings alone: {_short(1 / d.size)} tolerances)"
        for d in found.nearly
        if d.size > 0
    ]
    lines += _titled("seen worse than the tolerances say, so that tolerances decide:", nearly, most)
    lines += status_lines(found)
    left = len(found.subset.relations)
    if left:
        lines.append(
            f"  {len(found.subset.kept)} parameters can be told apart from each other; "
            f"left out as alike: {shortened(list(found.subset.relations), most or left)}"
        )
    return [*lines, *_table(found, every)]


def poses_line(found: Identifiability) -> str:
    if found.seed is not None:
        source = f"{found.poses} poses drawn over the joints' ranges (seed {found.seed})"
    else:
        source = f"{found.poses} poses of {', '.join(found.files)}"
    return f"{found.machine}: {source}, {found.n_observations} readings"


def rank_lines(found: Identifiability) -> list[str]:
    i = found.indices
    seen = f"  the readings see {found.rank} of {found.free} directions of the free parameters"
    if found.rank > found.rank_at_drawing:
        seen += f" ({found.rank_at_drawing} exactly at the drawing)"
    indices = ", ".join(f"O{k} {_short(v)}" for k, v in enumerate((i.o1, i.o2, i.o3, i.o4, i.o5), start=1))
    return [
        seen,
        f"  condition number {_short(i.condition)}; observability {indices} "
        "(seen directions; columns in tolerances, readings in sigmas)",
    ]


def _as_built_title(found: Identifiability) -> str:
    return (
        "unseen at the drawing, hardly seen on a machine as built "
        f"(at best {_short(found.as_built_size)} sigmas a tolerance):"
    )


def _titled(title: str, items: Sequence[str], most: int | None) -> list[str]:
    if not items:
        return []
    shown = list(items[:most])
    more = [f"    and {len(items) - len(shown)} more (--json has all)"] if len(items) > len(shown) else []
    return [f"  {title}", *(f"    {item}" for item in shown), *more]


def status_lines(found: Identifiability) -> list[str]:
    out = []
    for status in ("determined", "partly", "tolerance decides", "nothing decides"):
        names = [p.name for p in found.parameters if p.status == status]
        if names:
            out.append(f"  {status} ({len(names)}): {', '.join(grouped(names))}")
    return out


def _table(found: Identifiability, every: bool) -> list[str]:
    """Expected 1-sigma of every parameter; without ``every`` of machines of a few parameters only."""
    if not every and len(found.parameters) > 40:
        return [f"  --json has the 1-sigma to expect of each of the {len(found.parameters)} parameters"]
    rows = [("parameter", "tolerance", "1-sigma to expect", "")]
    rows += [
        (p.name, quantity(p.tolerance, p.unit), quantity(p.std, p.unit), _remark(p)) for p in found.parameters
    ]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    return [
        f"  {row[0]:<{widths[0]}}  {row[1]:>{widths[1]}}  {row[2]:>{widths[2]}}  {row[3]}".rstrip()
        for row in rows
    ]


def _remark(parameter: ParameterSight) -> str:
    if not parameter.partners:
        return parameter.status
    return f"{parameter.status}; trades with {shortened(grouped(parameter.partners), 3)}"


def quantity(value: float, unit: str) -> str:
    if np.isinf(value):
        return "unknown"
    factor, name = {"rad": (180.0 / np.pi, "deg")}.get(unit, (1.0, unit))
    return f"{value * factor:.3g} {'' if name == '1' else name}".rstrip()


def _short(value: float) -> str:
    return f"{value:.3g}"


def identifiability_json(found: Identifiability) -> Json:
    """Everything, in mm and rad; what is infinite or no number becomes null."""
    i = found.indices
    out = {
        "schema": SCHEMA,
        "machine": found.machine,
        "files": list(found.files),
        "seed": found.seed,
        "poses": found.poses,
        "readings": found.n_observations,
        "free_parameters": found.free,
        "rank": found.rank,
        "rank_at_drawing": found.rank_at_drawing,
        "condition": i.condition,
        "observability": {"O1": i.o1, "O2": i.o2, "O3": i.o3, "O4": i.o4, "O5": i.o5},
        "parameters": {p.name: _parameter(p) for p in found.parameters},
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


def _parameter(p: ParameterSight) -> Json:
    return {
        "unit": p.unit,
        "tolerance": p.tolerance,
        "std": p.std,
        "std_at_drawing": p.std_at_drawing,
        "status": p.status,
        "trades_with": list(p.partners),
    }


def _direction(found: Identifiability, direction: Direction) -> Json:
    return {"parts": dict(direction.parts), "meaning": terms(found.known, direction)}
