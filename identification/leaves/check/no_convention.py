"""Find the convention of a table that cannot be read because its fields are those of a data sheet."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from truepose.errors import InputError
from truepose.identification.leaves.check.findings import shown
from truepose.identification.leaves.check.pair import Pair
from truepose.identification.leaves.check.result import Check, Found
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.load import load_recording
from truepose.models.file.machine_file import checked_machine
from truepose.models.load import build_machine

_MEANT = {"standard": "a data sheet's standard table", "modified": "a modified table (Craig)"}


def unnamed_table(pair: Pair, recordings: Sequence[Path]) -> Check | None:
    """What to say of joints with a field ``a`` and no convention; None where the file's fault is another one."""
    section: Mapping[str, Any] = pair.get(("mechanism",)) or {}
    joints = section.get("joints") if isinstance(section, Mapping) else None
    if not isinstance(joints, list) or section.get("type") != "serial" or "convention" in section:
        return None
    if not any(isinstance(row, Mapping) and "a" in row for row in joints):
        return None
    left = {convention: _left(pair, recordings, convention) for convention in _MEANT}
    best = min(left, key=lambda convention: left[convention][0])
    if not math.isfinite(left[best][0]):
        return None
    _, length, unit, rows = left[best]
    found = Found(
        "dh-convention",
        ("mechanism.joints", "mechanism.convention"),
        f"the joints have a field 'a' and no convention is stated; as {_MEANT[best]} they fit best",
        f"state 'convention: {best}' beside 'joints'",
        "wrong",
        None,
        length,
        unit,
        lambda pair: pair.with_field(("mechanism", "convention"), best),
    )
    return Check((found,), rows, length, unit, left_rows=rows, left_mended=True)


def _left(pair: Pair, recordings: Sequence[Path], convention: str) -> tuple[float, float | None, str, int]:
    """Misfit, its size and unit, and rows, under a convention; an infinite misfit where the file has other faults."""
    stated = pair.with_field(("mechanism", "convention"), convention).document
    try:
        machine = build_machine(checked_machine(Path(pair.machine), dict(stated)))
        rows = load_recording(machine, recordings)
    except InputError:
        return math.inf, None, "mm", 0
    stand = Rig(machine, rows).stand()
    length, _, unit = shown(stand, stand)
    return stand.misfit, length, unit, len(rows)
