"""What poses can tell, as a document and as JSON; directions that no reading sees, as sentences.

The sentences say what moves together without a trace, in which proportion. Their wording follows from numbers alone, also
that a common factor or a common shift of many parameters is unseen.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from truepose.identification.identifiability.analysis import Identifiability, ParameterSight
from truepose.identification.identifiability.observability import Direction, Knowledge
from truepose.identification.identifiability.patterns import Blind, Pattern
from truepose.identification.report.json_text import Json, attributes, finite
from truepose.identification.report.notes import worded
from truepose.models.machine.machine import FRAME_OF
from truepose.shown.document import Document, Items, Table
from truepose.shown.result import document
from truepose.wording import joined, shortened

TOGETHER = 10
TERMS = 6
FEW = 6
"""Parameters of a block that are named one by one."""
_NUMBERED = re.compile(r"^(?P<stem>\D+)(?P<number>\d+)\.(?P<rest>.+)$")
_NUMBER_WORDS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}


def unseen_sentences(blind: Blind) -> list[str]:
    """Patterns that explain much in few words, then a sentence for each block of parameters that trade."""
    said = [*_pattern_sentences(blind.patterns, blind.known.names)]
    blocks = _blocks(blind.remaining)
    alone = [block[0] for block in blocks if len(block) == 1 and len(block[0].parts) == 1]
    for kind in (False, True):
        found = {name for d in alone if d.open_ended is kind for name in d.parts}
        names = [name for name in blind.known.names if name in found]
        if names:
            said.append(_alone_sentence(names, kind))
    for block in blocks:
        if block[0] not in alone:
            said += _block_sentences(blind.known, block)
    return said


def _alone_sentence(names: Sequence[str], open_ended: bool) -> str:
    if len(names) == 1:
        who = "nothing decides, it stays at the drawing" if open_ended else "its tolerance decides"
        return f"{names[0]} alone: no reading changes when it moves; {who}"
    who = "nothing decides, they stay at the drawing" if open_ended else "tolerances decide"
    return f"{joined(grouped(names))}, each alone: no reading changes when one of them moves; {who}"


def _pattern_sentences(found: Sequence[Pattern], names: Sequence[str]) -> list[str]:
    """Motions of one body in one sentence; other patterns one each."""
    out, bodies = [], dict[tuple[str, ...], list[Pattern]]()
    for pattern in found:
        if pattern.kind == "scale":
            out.append("scale: all lengths can grow together by one factor; one known length would settle it")
        elif pattern.kind == "shift":
            members = ", ".join(grouped(pattern.members))
            out.append(f"a common change of {members}: only their differences are seen")
        else:
            bodies.setdefault(pattern.members, []).append(pattern)
    for points, motions in bodies.items():
        undone = sorted({name for motion in motions for name in motion.undone_by}, key=list(names).index)
        why = (
            f"{', '.join(undone)} would undo it"
            if undone
            else "where the frame that they are written in sits is nobody's measurement"
        )
        out.append(f"points {_points(points)} move as one body {_motions(motions)}; {why}")
    return out


def _points(points: Sequence[str]) -> str:
    named = grouped([point if "." in point else f"{point}." for point in points])
    return joined([name.rstrip(". ") for name in named])


def _motions(motions: Sequence[Pattern]) -> str:
    axes = {way: [m.motion[-1] for m in motions if m.motion.startswith(way)] for way in ("along", "about")}
    return " and ".join(f"{way} {', '.join(named)}" for way, named in axes.items() if named)


def _block_sentences(known: Knowledge, block: Sequence[Direction]) -> list[str]:
    names = list(dict.fromkeys(name for direction in block for name in direction.parts))
    left = len(names) - len(block)
    if left == 0:
        return [f"{joined(names)}: no reading changes when they move; {_who(block[0])}"]
    texts = [terms(known, direction) for direction in block]
    if len(names) <= FEW:
        seen = f"only {_count(left)} combination{'s' if left > 1 else ''} of the {_count(len(names))}"
        return [
            f"{joined(names)} trade with each other: {seen} {'are' if left > 1 else 'is'} seen "
            f"({'; '.join(texts)}); {_who(block[0])}"
        ]
    return [f"moving {text} changes no reading; {_who(d)}" for text, d in zip(texts, block, strict=True)]


def _who(direction: Direction) -> str:
    return "nothing decides, they stay at the drawing" if direction.open_ended else "tolerances decide"


def _blocks(directions: Sequence[Direction]) -> list[list[Direction]]:
    """Directions that share a parameter, together."""
    blocks: list[tuple[set[str], list[Direction]]] = []
    for direction in directions:
        names, members = set(direction.parts), [direction]
        apart = []
        for other, others in blocks:
            if other & names:
                names, members = names | other, [*others, *members]
            else:
                apart.append((other, others))
        blocks = [*apart, (names, members)]
    return [members for _, members in blocks]


def terms(known: Knowledge, direction: Direction) -> str:
    """``base.z +1 mm, q1.r -1 mm``: parts that move alike are written together."""
    units = dict(zip(known.names, known.units, strict=True))
    lead = next(iter(direction.parts))
    # a length leads with 1 mm, an angle with 1 mrad, anything else (a direction, a gain) with a thousandth
    step = direction.parts[lead] * (1.0 if units[lead] == "mm" else 1e3)
    by_amount: dict[tuple[str, str], list[str]] = {}
    for name, part in direction.parts.items():
        unit = {"rad": "mrad"}.get(units[name], units[name])
        amount = part / step * (1e3 if units[name] == "rad" else 1.0)
        by_amount.setdefault((f"{amount:+.3g}", unit), []).append(name)
    groups = [
        f"{', '.join(grouped(names))} {amount}{'' if unit == '1' else ' ' + unit}"
        for (amount, unit), names in by_amount.items()
    ]
    return shortened(groups, TERMS)


def meaning(direction: Direction) -> str:
    """A sentence: what moves with what, and who decided."""
    names, open_ended = tuple(direction.parts), direction.open_ended
    who = "nothing decided, they stay at the drawing" if open_ended else "tolerances decided"
    groups = grouped(sorted(names, key=lambda name: name not in FRAME_OF))
    if len(names) == 1:
        who = "nothing decided, it stays at the drawing" if open_ended else "its tolerance decided"
        return f"{names[0]} alone is not seen; {who}"
    rest = groups[1:] or groups
    shown = shortened(rest, TOGETHER)
    if len(groups) == 1:
        return f"moving {shown} together is not seen; {who}"
    return f"moving {groups[0]} together with {shown} is not seen; {who}"


def grouped(names: Sequence[str]) -> list[str]:
    """Names with those that differ by a number only drawn together: ``leg1..leg6 a.x``."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name in names:
        match = _NUMBERED.match(name)
        key = (match["stem"], match["rest"]) if match else ("", name)
        groups.setdefault(key, []).append(match["number"] if match else "")
    out = []
    for (stem, rest), numbers in groups.items():
        if not stem:
            out.append(rest)
        elif len(numbers) == 1:
            out.append(f"{stem}{numbers[0]}.{rest}")
        else:
            out.append(f"{_span(stem, sorted(int(n) for n in numbers))} {rest}")
    return out


def _span(stem: str, numbers: Sequence[int]) -> str:
    if numbers[-1] - numbers[0] == len(numbers) - 1:
        return f"{stem}{numbers[0]}..{stem}{numbers[-1]}"
    return ", ".join(f"{stem}{n}" for n in numbers)


def _count(number: int) -> str:
    return _NUMBER_WORDS.get(number, str(number))


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
