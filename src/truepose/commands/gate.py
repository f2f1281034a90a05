"""The gate before a fit: files that do not belong together are refused."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.errors import InputError

if TYPE_CHECKING:
    from truepose.identification.load import Caution
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
) -> tuple[Machine, Recording, Caution]:
    """Load and check files (``identification/load.py``). Raises InputError where the check is certain of a mistake.

    With ``anyway`` what was found stands above the result; a file without a sensor is refused all the same.
    """
    from truepose.identification.load import load_checked

    caution, loaded, rows = load_checked(
        machine, recordings, irradiance=irradiance, tried=tried, shuffled=shuffled
    )
    if loaded is None or rows is None or (caution.refusal and not anyway):
        raise InputError(f"{machine}: {caution.refusal}")
    return loaded, rows, caution
