"""The arm of which most tests of reports tell, and a diagnosis of it that is put together by hand."""

from __future__ import annotations

import pytest

from support.reports import arm, synthetic
from truepose.identification.diagnosis.result import Diagnosis
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="session")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return arm(tmp_path_factory.mktemp("machine"))


@pytest.fixture(scope="session")
def plain(machine: Machine) -> Diagnosis:
    """As it is put together without changes."""
    return synthetic(machine)
