"""Machines that the tests of effects share."""

from __future__ import annotations

import pytest

from support.effect_machines import Machines, read_machines


@pytest.fixture(scope="session")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Machines:
    return read_machines(tmp_path_factory.getbasetemp() / "effects")
