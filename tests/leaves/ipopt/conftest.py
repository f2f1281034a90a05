"""Machines that every solver calibrates."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from support.solvers import read_machines
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="session")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.mktemp("machines"))
