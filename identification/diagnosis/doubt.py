"""Names are worth less when the model with them still fails: something that has no name is there beside them.

What has no name may also be what the named effect stands in for. On simulated machines about half of the names
that were given beside an unexplained remainder were right (docs/challenge.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from truepose.identification.diagnosis.alarms import Alarm
from truepose.identification.diagnosis.result import Alternative, Finding, Remainder
from truepose.identification.diagnosis.unnamed import UNNAMED

SHARE = 0.5
"""Probability that goes to something without a name."""
FAILS_P = 1e-3


def fails(rival: Remainder | None, alarms: Mapping[str, Alarm]) -> bool:
    """Whether an unnamed rival was found beside the names, or the model with them raises an alarm clearly."""
    return rival is not None or any(alarm.p < FAILS_P for alarm in alarms.values())


def doubted(findings: Sequence[Finding], rival: Remainder | None) -> tuple[Finding, ...]:
    """The findings with half of their probability given to something unnamed, which joins their class."""
    return tuple(_halved(finding, rival) for finding in findings)


def _halved(finding: Finding, rival: Remainder | None) -> Finding:
    keep = 1.0 - SHARE
    place = finding.place if rival is None else rival.place
    unnamed = Alternative(UNNAMED, place, SHARE * finding.certainty, finding.log_bayes_factor)
    others = [replace(other, probability=keep * other.probability) for other in finding.equivalents]
    return replace(
        finding,
        probability=keep * finding.probability,
        certainty=keep * finding.certainty,
        equivalents=tuple(sorted((*others, unnamed), key=lambda other: -other.probability)),
        explanation=f"{finding.explanation} The model with it still does not fit: something else is there, and this "
        "name may stand in for it.",
    )


__all__ = ["doubted", "fails"]
