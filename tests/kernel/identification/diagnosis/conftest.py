"""An arm with what its effects shift, and a recording of another: made once for all laws of the catalogue's problem."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.effect_machines import read_machines
from support.linear_models import shifts_of
from support.sensor_bench import Bench
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="session")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    folder: Path = tmp_path_factory.getbasetemp() / "catalogue_arm"
    return read_machines(folder)["arm"]


@pytest.fixture(scope="session")
def shifts(arm: Machine) -> tuple[PlacedEffect, ...]:
    return shifts_of(arm)


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Machine, Recording]:
    bench = Bench(tmp_path_factory.mktemp("bench"), "arm")
    return bench.machine, bench.recording()
