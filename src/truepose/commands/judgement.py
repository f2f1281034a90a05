"""The end of a command whose result is no calibration: its files are written to be looked at, and it has failed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from truepose.commands.common import BAD_INPUT, fail
from truepose.commands.progress import quiet

if TYPE_CHECKING:
    from truepose.identification.fit.summary import Judgement


def refuse(judgement: Judgement, output: Path, *, as_json: bool) -> None:
    """Exit with 2 and one line on standard error; nothing for a calibration."""
    if judgement.calibrated:
        return
    why = judgement.refusal if quiet() or as_json else "not calibrated, for the reason above"
    fail(f"{why}; {output} holds it to be looked at: no command applies it without --anyway", BAD_INPUT)
