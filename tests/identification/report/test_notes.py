"""Remarks beside a result: each where it holds, at both sides of what it depends on, and in their order."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import pytest

from support.reports import synthetic
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.tolerance_classes import PartClass
from truepose.identification.report.notes import diagnosis_notes, driver_notes
from truepose.models.machine.machine import Machine


@pytest.mark.parametrize(
    ("noise", "said"), [(0.5, "0.5"), (0.8, "0.8"), (0.81, ""), (1.0, ""), (1.24, ""), (1.25, "1.2"), (3.04, "3")]
)  # fmt: skip
def test_scatter_far_from_the_stated_sigma_is_noted(machine: Machine, noise: float, said: str) -> None:
    told = f"without effects the readings scatter {said} times the stated sigma"
    assert diagnosis_notes(synthetic(machine, noise=noise)) == ((told,) if said else ())


def test_rows_that_cannot_be_assembled_are_noted_by_their_file(machine: Machine) -> None:
    found = synthetic(machine)
    two = replace(
        found.recording,
        files=("a.csv", "b.csv"),
        source_file=(found.recording.source_row > 20).astype("int64"),
    )
    gone = replace(found, recording=two, before=replace(found.before, unassembled=(3, 24)))
    assert diagnosis_notes(gone) == (
        "row 4 of a.csv cannot be assembled and was left out",
        "row 25 of b.csv cannot be assembled and was left out",
    )


def test_notes_of_the_recording_stand_first_then_those_of_the_prior_drivers_rows_and_tolerances(
    machine: Machine,
) -> None:
    found = synthetic(machine, noise=2.0, inflation={PartClass("angle"): 2.04}, prior_notes=("a fleet's",))
    own = replace(found, recording=replace(found.recording, notes=("as recorded",), untried=("fan",)))
    assert diagnosis_notes(own) == (
        "as recorded",
        "a fleet's",
        "no driver: fan; --try-columns tries them, `drivers:` declares them",
        "without effects the readings scatter 2 times the stated sigma",
        "without effects, angle tolerances look 2.0 times too small",
    )


@pytest.mark.parametrize(
    ("names", "untried", "said"),
    [
        ((), (), []),
        (("fan",), (), ["tried as drivers: fan"]),
        (("fan", "oil"), (), ["tried as drivers: fan and oil: each has 1/2 of the prior of a driver"]),
        (("a", "b", "c"), (), ["tried as drivers: a, b and c: each has 1/3 of the prior of a driver"]),
        (("fan",), ("oil", "air"), ["tried as drivers: fan", "no driver: oil and air; --try-columns tries them,"
         " `drivers:` declares them"]),
    ],
)  # fmt: skip
def test_columns_that_are_tried_share_the_prior_of_a_driver(
    names: tuple[str, ...], untried: tuple[str, ...], said: list[str]
) -> None:
    declared = [SimpleNamespace(name="pump", tried=False)]  # a driver of the machine file
    declared += [SimpleNamespace(name=name, tried=True) for name in names]
    found = SimpleNamespace(
        nominal=SimpleNamespace(declared_drivers=declared), recording=SimpleNamespace(untried=untried)
    )
    assert driver_notes(cast(Diagnosis, found)) == said
