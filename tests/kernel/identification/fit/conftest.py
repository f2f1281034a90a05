"""Machines that the tests of fits share."""

from __future__ import annotations

import pytest

from support.built_machines import Machines, read_machines


@pytest.fixture(scope="session")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Machines:
    return read_machines(tmp_path_factory.mktemp("machines"))
