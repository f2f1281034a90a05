"""Which two explanations of a finding rows are to tell apart, and which columns are to be varied again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from truepose.arrays import Array
from truepose.identification.diagnosis.open_question import question
from truepose.identification.diagnosis.posterior_summary import Named, Rival
from truepose.identification.diagnosis.result import Levels, OpenQuestion
from truepose.identification.signatures.candidates import Catalogue
from truepose.models.effect_text import parse_effect
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import EffectAtPlace

UNNAMED = EffectAtPlace("empirical", ("q2",))
LAW, BENT = "joint-compliance@q2:c=2.5e-06", "link-bending@link2"
FORM = "empirical@q2:degree=3,from.load=-9,to.load=9"
CARRIED: dict[str, Array] = {
    "payload": np.array([0.0, 5.0, 0.0, 2.0]),
    "temperature.air": np.array([20.0, 21.0]),
}


def asked(
    arm: Machine, *rivals: Rival, law: str = LAW, unnamed: str = FORM, **changes: Any
) -> OpenQuestion | None:
    """The question of a law at q2 with a probability of 0.7, a form and rivals."""
    placed, bent, form = (parse_effect(text, arm) for text in (law, BENT, unnamed))
    levels = Levels(1.0, placed.kind, 0.99)
    one = Named(placed.at_place, (0,), 0.7, 0.9, rivals, levels=levels, form=form)
    return question(Catalogue((placed, bent, form), (0.0,) * 3, ()), replace(one, **changes), placed, CARRIED)


def test_a_law_is_stated_with_its_size_and_a_form_as_it_was_held(arm: Machine) -> None:
    found = asked(arm, Rival(UNNAMED, 0.3, 0.0))
    assert found is not None
    assert found.explanations == (LAW, FORM)
    assert found.levels == {"payload": (0.0, 2.0, 5.0)} and "payload" in found.experiment


def test_of_rivals_the_likeliest_is_asked_about(arm: Machine) -> None:
    bent = parse_effect(BENT, arm).at_place
    found = asked(arm, Rival(bent, 0.2, 0.0), Rival(UNNAMED, 0.1, 0.0))
    assert found is not None and found.explanations == (LAW, BENT)


def test_what_is_likelier_without_a_name_is_told_from_the_law_of_its_driver(arm: Machine) -> None:
    law = parse_effect(LAW, arm).at_place
    found = asked(arm, Rival(law, 0.3, 0.0), cause=UNNAMED, probability=0.0)
    assert found is not None and found.explanations == (LAW, FORM)
    other = asked(arm, Rival(law, 0.3, 0.0), cause=UNNAMED, levels=Levels(1.0, "temperature", 0.99))
    assert other is None


@pytest.mark.parametrize(
    ("rivals", "changes"),
    [
        ((), {}),
        ((Rival(UNNAMED, 0.3, 0.0),), {"probability": 0.97}),
        ((Rival(UNNAMED, 0.3, 0.0),), {"form": None}),
        ((Rival(EffectAtPlace("link-bending", ("link2",)), 0.3, 0.0, tested=False),), {}),
    ],
    ids=["alone", "certain", "no form", "untested"],
)
def test_where_rows_would_tell_nothing_there_is_no_question(
    arm: Machine, rivals: tuple[Rival, ...], changes: dict[str, Any]
) -> None:
    """So it is of play beside a form of the side of arrival, which has two values only."""
    assert asked(arm, *rivals, **changes) is None
    side = "empirical@q2:degree=1,from.approach.q2=-1,to.approach.q2=1"
    assert asked(arm, Rival(UNNAMED, 0.3, 0.0), law="backlash@q2:b=1e-4", unnamed=side) is None
