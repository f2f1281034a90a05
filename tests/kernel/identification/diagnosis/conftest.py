"""Machines and recordings that the tests of a diagnosis share."""

from __future__ import annotations

import pytest

from support.effect_machines import read_machines
from support.linear_models import shifts_of
from support.sensor_bench import Bench
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="session")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return read_machines(tmp_path_factory.getbasetemp() / "catalogue_arm")["arm"]


@pytest.fixture(scope="session")
def shifts(arm: Machine) -> tuple[PlacedEffect, ...]:
    return shifts_of(arm)


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Machine, Recording]:
    bench = Bench(tmp_path_factory.mktemp("bench"), "arm")
    return bench.machine, bench.recording()


@pytest.fixture(scope="session")
def case(recorded: tuple[Machine, Recording]) -> tuple[Estimate, Recording]:
    """A fit of an arm and its recording; tests replace residuals and what else they need."""
    return estimate(*recorded), recorded[1]
