"""The real arm whose programs are corrected."""

from __future__ import annotations

import pytest

from support.program_robots import arms, machine_file
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="session")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return load_machine(machine_file(tmp_path_factory.mktemp("arm"), arms()[1]))
