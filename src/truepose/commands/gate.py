"""The gate before a fit: files that do not belong together are refused, in the words of ``truepose check``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.errors import InputError

if TYPE_CHECKING:
    from truepose.identification.leaves.check.result import Check
    from truepose.identification.recording.recording import Recording
    from truepose.models.machine.machine import Machine

GateOption = Annotated[
    bool,
    typer.Option(
        "--anyway", help="Go on although 'truepose check' says that the files do not belong together."
    ),
]


def gated(
    machine: Path,
    recordings: Sequence[Path],
    *,
    irradiance: Sequence[Path] = (),
    anyway: bool = False,
    tried: Sequence[str] | None = None,
    shuffled: bool = False,
) -> tuple[Machine, Recording, Check]:
    """The machine and its rows, checked. Raises InputError where the check is certain that something is wrong.

    With ``anyway`` what was found stands above the result; a file without a sensor is refused all the same. ``tried``: columns
    that nobody declared and that are to be drivers (none named: all). ``shuffled`` rows are no visits one after the other.
    """
    from truepose.identification.leaves.check.run import check_files
    from truepose.identification.leaves.check.words import refusal

    check, loaded, rows = check_files(
        machine, recordings, irradiance=irradiance, tried=tried, shuffled=shuffled
    )
    if loaded is None or rows is None or (check.verdict == "wrong" and not anyway):
        raise InputError(f"{machine}: {refusal(check)}")
    return loaded, rows, check
