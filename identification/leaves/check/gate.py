"""The check as the gate that every fit from files goes through."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from truepose.identification.leaves.check.run import check_files
from truepose.identification.leaves.check.showing import caution, checked, refusal
from truepose.identification.load import Caution
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine


def load_checked(
    machine: Path,
    recordings: Sequence[Path],
    *,
    irradiance: Sequence[Path] = (),
    tried: Sequence[str] | None = None,
    shuffled: bool = False,
) -> tuple[Caution, Machine | None, Recording | None]:
    """Load and check files (`truepose.identification.load.load_checked`)."""
    check, loaded, rows = check_files(
        machine, recordings, irradiance=irradiance, tried=tried, shuffled=shuffled
    )
    refused = refusal(check) if loaded is None or rows is None or check.verdict == "wrong" else ""
    return Caution(check.verdict, tuple(caution(check)), checked(check), refused), loaded, rows
