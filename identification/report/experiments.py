"""The experiments that tell what findings leave open: the command of each, and the one that counts most in words."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

from truepose.identification.diagnosis.result import Diagnosis, Finding, OpenQuestion
from truepose.identification.report.json_text import Json
from truepose.models.file.driver import PAYLOAD

IMPROVED = "improved.yaml"
ROWS = 10
"""Rows of an experiment: an hour's work."""


def questions(findings: Iterable[Finding]) -> list[tuple[Finding, OpenQuestion]]:
    """Return findings with their open questions, the one that moves the tool most first."""
    found = [(one, one.question) for one in findings if one.question is not None]
    return sorted(found, key=lambda pair: -pair[1].tool)


def plan_command(question: OpenQuestion, improved: Path, recordings: Sequence[str]) -> str:
    """Return the command that plans the rows which answer a question, in addition to the recordings."""
    words = ["truepose", "plan", str(improved), "-n", str(ROWS), "-o", "poses.csv"]
    words += ["--discriminate", *question.explanations]
    for driver, levels in question.levels.items():
        told = ",".join(f"{level:.4g}" for level in levels)
        words += ["--payload", told] if driver == PAYLOAD else ["--vary", f"{driver}={told}"]
    words += [word for name in recordings for word in ("--with", name)]
    return shlex.join(words)


def experiments_json(diagnosis: Diagnosis, improved: Path) -> list[Json]:
    """Return each open finding with the command that plans its experiment, the one that counts most first."""
    files = diagnosis.recording.files
    return [
        {"effect": one.effect, "place": list(one.place), "command": plan_command(asked, improved, files)}
        for one, asked in questions(diagnosis.findings)
    ]


def what_would_tell(findings: Iterable[Finding]) -> str:
    """Return a sentence on the experiment that counts most; empty where nothing is open."""
    asked = [question for _, question in questions(findings)]
    if not asked:
        return ""
    names = " ".join(text.partition(":")[0] for text in asked[0].explanations)
    return f" What would tell: {asked[0].experiment.partition(';')[0]} (plan --discriminate {names})."
