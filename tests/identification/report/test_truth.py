"""What a demonstration's known truth is set beside: the names that were found."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from support.results import machine as bundled
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.report.closing import truth_section
from truepose.shown.document import Block, Text

Array = NDArray[np.float64]
BENDS = ("platform-deformation", ("platform",))
PLAY = ("backlash", ("q1",))


def told(*found: tuple[str, tuple[str, ...]], **more: Any) -> Diagnosis:
    findings = [SimpleNamespace(effect=slug, place=place) for slug, place in found]
    return cast(
        Diagnosis, SimpleNamespace(**{"findings": findings, "nominal": bundled(), "terms": (), **more})
    )


def blocks(diagnosis: Diagnosis, truth: dict[str, object]) -> list[Block]:
    section = truth_section(diagnosis, truth)
    assert section.title == "Truth against what was found"
    return list(section.blocks)


def stated(*real: tuple[str, tuple[str, ...]]) -> dict[str, object]:
    return {"effects": [{"effect": slug, "place": list(place)} for slug, place in real]}


LEAD = "This recording was simulated, so the truth is known (the diagnosis never saw it)."


@pytest.mark.parametrize(
    ("real", "found", "tone", "said"),
    [
        ((), (), "good", "nothing; nothing was to be found; beyond it: nothing."),
        ((), (PLAY, BENDS), "warn", "nothing; nothing was to be found; beyond it:"
         " backlash at q1 and platform-deformation at platform."),
        ((PLAY,), (PLAY,), "good", "backlash at q1; all of it was found; beyond it: nothing."),
        ((PLAY,), (PLAY, BENDS), "warn", "backlash at q1; all of it was found; beyond it: platform-deformation at platform."),
        ((PLAY, BENDS), (PLAY,), "warn", "backlash at q1 and platform that bends (platform-deformation) at platform;"
         " not found under that name: platform-deformation; beyond it: nothing."),
        ((PLAY,), (("backlash", ("q2",)),), "warn", "backlash at q1; not found under that name: backlash;"
         " beyond it: backlash at q2."),
    ],
)  # fmt: skip
def test_the_verdict_says_what_was_missed_and_what_was_named_beyond_it(
    real: tuple[tuple[str, tuple[str, ...]], ...],
    found: tuple[tuple[str, tuple[str, ...]], ...],
    tone: str,
    said: str,
) -> None:
    (text,) = blocks(told(*found), stated(*real))
    assert isinstance(text, Text) and (text.text, text.tone) == (
        f"{LEAD} Left out of the machine file: {said}",
        tone,
    )


def test_one_effect_or_several_may_be_stated() -> None:
    one = {"effect": "backlash", "place": ["q1"]}
    truths: tuple[dict[str, object], ...] = (
        {"effect": one},
        {"effects": [one, "no mapping"]},
        {"effects": [], "effect": one},
    )
    for truth in truths:
        (text,) = blocks(told(PLAY), truth)
        assert isinstance(text, Text) and text.tone == "good"
