"""Which rows of a Denavit-Hartenberg table are joints: a row is driven where the table says so, and fixed where it does not.

A table says it by a column ``kind``, by the joint's variable in theta, or in d where theta has none, and by a range. If it says
so of one turning joint, it is taken to say it of all. If it says it of none, names decide: of rows that are counted (q1 to q7)
one without a number is fixed, and so is a flange. What only names say is listed, so that nothing is driven in silence.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence

from truepose.errors import InputError
from truepose.models.leaves.starting.cells import variable_in
from truepose.wording import shortened

Cells = Mapping[str, str]
_KINDS = {
    "": "", "revolute": "revolute", "r": "revolute", "rotary": "revolute", "rotational": "revolute",
    "prismatic": "prismatic", "p": "prismatic", "linear": "prismatic", "t": "prismatic",
    "fixed": "fixed", "f": "fixed", "none": "fixed", "static": "fixed", "constant": "fixed", "-": "fixed",
}  # fmt: skip
_ENDS = {"flange", "tool", "tcp", "ee", "eef", "effector", "endeffector"}
_NAMED = 10


def row_kinds(rows: Sequence[Cells], places: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Return each row's kind (revolute, prismatic, fixed), and notes on what the table leaves open.

    ``places`` open messages. Raises InputError for an unknown kind, and for a row that is fixed and moves.
    """
    stated = [_stated_kind(row, where) for row, where in zip(rows, places, strict=True)]
    labels = [row.get("name", "").strip() for row in rows]
    complete = any(_states_turning(row) for row in rows)
    kinds, assumed, still = [], [], []
    for label, kind, fixed, place in zip(labels, stated, _fixed_by_name(labels), places, strict=True):
        shown = repr(label) if label else place.rpartition(": ")[2]
        if kind:
            kinds.append(kind)
        elif complete or fixed:
            kinds.append("fixed")
            still.append(shown)
        else:
            kinds.append("revolute")
            assumed += [shown] if not re.search(r"\d", label) else []
    notes = []
    if still:
        why = "have no variable, as others have" if complete else "are not named as joints"
        notes.append(f"CHECK rows that {why}, and are fixed here: {shortened(still, _NAMED)}.")
    if assumed:
        notes.append(
            f"CHECK rows that do not say whether they are driven, and are here: {shortened(assumed, _NAMED)}. One that is not "
            "has kind fixed."
        )
    return kinds, tuple(notes)


def _stated_kind(row: Cells, where: str) -> str:
    """Return the kind that a row states, empty where it states none."""
    found = row.get("kind", "").strip().lower()
    if found not in _KINDS:
        raise InputError(f"{where}, column 'kind': found {found!r}, expected revolute, prismatic or fixed")
    moves = next((column for column in ("theta", "d", "r") if variable_in(row.get(column, ""))), "")
    ranged = next((column for column in ("range", "min", "max") if row.get(column, "").strip()), "")
    if _KINDS[found] == "fixed" and (moves or ranged):
        column = moves or ranged
        raise InputError(
            f"{where}, column {column!r}: found {row[column].strip()!r} in a fixed row, expected a joint's row"
        )
    if _KINDS[found]:
        return _KINDS[found]
    if moves:
        return "revolute" if moves == "theta" else "prismatic"
    return "revolute" if ranged else ""


def _states_turning(row: Cells) -> bool:
    """Return whether a row says, by its kind or its variable, that it is a turning joint's."""
    return _KINDS[row.get("kind", "").strip().lower()] == "revolute" or bool(
        variable_in(row.get("theta", ""))
    )


def _fixed_by_name(labels: Sequence[str]) -> list[bool]:
    """Return for each name whether it is a flange's or a tool's, or one without a number among rows that are counted."""
    stems = [re.sub(r"\d+", "", label.lower()) if re.search(r"\d", label) else None for label in labels]
    counted = any(2 * n > len(labels) for stem, n in Counter(stems).items() if stem is not None)
    ends = [bool(_ENDS & set(re.split(r"[^a-z]+", label.lower()))) for label in labels]
    return [end or (counted and stem is None) for end, stem in zip(ends, stems, strict=True)]
