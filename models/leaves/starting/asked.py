"""A table by questions: one answer a joint, in the order of the convention."""

from __future__ import annotations

from collections.abc import Callable

from truepose.errors import InputError
from truepose.models.leaves.starting.cells import UNITS
from truepose.models.leaves.starting.start import Start
from truepose.models.leaves.starting.table import CONVENTIONS, FIELDS, Row, start_of

Ask = Callable[[str, str], str]
"""Puts a question, with what an empty answer means; gives the answer."""


def asked_start(ask: Ask) -> Start:
    """The start that the answers describe. Raises InputError for an answer that is none, naming its question."""
    name = ask("Name of the machine", "arm")
    convention = ask(f"Convention of the table ({', '.join(CONVENTIONS)})", "standard").strip().lower()
    if convention not in CONVENTIONS:
        raise InputError(f"convention: found {convention!r}, expected one of {', '.join(CONVENTIONS)}")
    count = ask("Number of joints", "6").strip()
    if not count.isdigit() or not 1 <= int(count) <= 20:
        raise InputError(f"number of joints: found {count!r}, expected a whole number from 1 to 20")
    units = {
        "length": ask("Lengths in mm or m", "mm").strip(),
        "angle": ask("Angles in deg or rad", "deg").strip(),
    }
    for dimension, unit in units.items():
        if unit not in UNITS[dimension]:
            raise InputError(
                f"{dimension}s: found the unit {unit!r}, expected one of {', '.join(UNITS[dimension])}"
            )
    fields = FIELDS[convention]
    rows = []
    for k in range(1, int(count) + 1):
        where = f"joint {k}"
        words = ask(f"Joint {k}: {' '.join(fields)} [prismatic] [min max]", "").split()
        rows.append(Row(_cells(words, fields, where), _units(fields, units, words), where))
    return start_of(rows, convention, name, "a table typed in", "the table")


def _cells(words: list[str], fields: tuple[str, ...], where: str) -> dict[str, str]:
    rest = list(words)
    numbers, rest = rest[: len(fields)], rest[len(fields) :]
    kind = rest.pop(0) if rest and rest[0][:1].isalpha() else "revolute"
    if len(numbers) != len(fields) or len(rest) not in (0, 2):
        raise InputError(
            f"{where}: found {' '.join(words)!r}, expected {' '.join(fields)}, then `prismatic` and the ends of its range "
            "where they apply"
        )
    ends = dict(zip(("min", "max"), rest, strict=True)) if rest else {}
    return {**dict(zip(fields, numbers, strict=True)), "kind": kind, **ends}


def _units(fields: tuple[str, ...], units: dict[str, str], words: list[str]) -> dict[str, str]:
    """Unit of each column; a range is in the unit of the joint's variable."""
    own = {field: units["angle" if field in ("alpha", "beta", "theta") else "length"] for field in fields}
    slides = any(word.lower() in ("p", "prismatic", "linear") for word in words)
    return own | dict.fromkeys(("min", "max"), units["length" if slides else "angle"])
