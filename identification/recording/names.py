"""Names of columns as people write them: case, units glued on with an underscore, letters swapped."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from truepose.errors import InputError
from truepose.identification.recording.table import Table
from truepose.models.units import is_unit
from truepose.wording import close_matches, meant


def in_known_case(table: Table, known: Iterable[str]) -> Table:
    """The table with ``Q1`` called `q1`, where one known name alone is meant; a note says so.

    Raises InputError where several columns could be the same one.
    """
    folded: dict[str, list[str]] = {}
    for name in dict.fromkeys(known):
        folded.setdefault(name.casefold(), []).append(name)
    found: dict[str, list[str]] = {}
    for name in table.names:
        match = folded.get(name.casefold(), [])
        if len(match) == 1 and match[0] not in table:
            found.setdefault(match[0], []).append(name)
    for name, written in found.items():
        if len(written) > 1:
            both = " and ".join(repr(text) for text in written)
            raise InputError(f"{table.file}: found the columns {both}, expected one column {name!r}")
    if not found:
        return table
    told = ", ".join(f"{written[0]!r} as {name!r}" for name, written in found.items())
    renamed = table.renamed({written[0]: name for name, written in found.items()})
    return renamed.with_note(f"{table.file}: read without case: {told}")


_VECTOR, _QUATERNION = ("rx", "ry", "rz"), ("qx", "qy", "qz", "qw")
_ANGLES = {
    ("roll", "pitch", "yaw"): "",
    ("c", "b", "a"): " --columns roll=C,pitch=B,yaw=A",
    ("w", "p", "r"): " --columns roll=W,pitch=P,yaw=R",
}
"""Roll, pitch and yaw as robots call them, and what `truepose import` has to be told of them."""


def missing_column(table: Table, name: str, known: Collection[str]) -> InputError:
    """The error of a column that is not there, with what was written in its place."""
    spare = [written for written in table.names if written not in known]
    glued = next((written for written in spare if _glued(written, name)), None)
    indexed = next((w for w in spare if w.casefold().startswith(f"{name.casefold()}[")), None)
    if indexed is not None:
        hint = f"found {indexed!r}, whose brackets hold no unit"
    elif glued is not None:
        unit = glued[len(name) + 1 :]
        hint = f"found {glued!r}: write it '{name} [{unit}]'"
    elif name.casefold() in _VECTOR and (turned := _rotation_hint({w.casefold() for w in spare})):
        hint = turned
    elif meant(name, spare):
        hint = meant(name, spare)
    else:
        hint = close_matches(name, table.names)
    return InputError(f"{table.file}: missing column {name!r}; {hint}")


def _rotation_hint(spare: set[str]) -> str:
    """Return what to do with a rotation that is there in another form; nothing where there is none."""
    if spare >= set(_QUATERNION):
        return "found a quaternion (qx, qy, qz, qw), which `truepose import` writes as rx, ry, rz"
    for names, asked in _ANGLES.items():
        if spare >= set(names):
            told = ", ".join(n.upper() if len(n) == 1 else n for n in names)
            return f"found {told}: if they are roll, pitch and yaw, `truepose import --rotation rpy{asked}` writes rx, ry, rz"
    return ""


def _glued(written: str, name: str) -> bool:
    """Whether a column is ``x_mm``: the name and a unit."""
    start, unit = written[: len(name)], written[len(name) + 1 :]
    return (
        start.casefold() == name.casefold()
        and written[len(name) :][:1] in ("_", "-", ".", "/")
        and is_unit(unit)
    )
