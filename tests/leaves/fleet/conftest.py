"""A recording of an arm for the laws of the prior."""

from __future__ import annotations

import pytest

from support.sensor_bench import Bench
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Machine, Recording]:
    bench = Bench(tmp_path_factory.mktemp("bench"), "arm")
    return bench.machine, bench.recording()
