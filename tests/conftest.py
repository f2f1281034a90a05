"""Settings of the whole test run, and what is compiled once in it.

One BLAS thread a worker, and no deadlines on a shared machine.
"""

from __future__ import annotations

import os
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy is imported; workers of pytest-xdist inherit it

import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

pytest.register_assert_rewrite("support")

from support.generated_c import Built, build  # noqa: E402

settings.register_profile("truepose", deadline=None, derandomize=True)
settings.load_profile("truepose")


@pytest.fixture(scope="session")
def root_directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where C is generated and compiled, each machine once."""
    return tmp_path_factory.mktemp("codegen")


@pytest.fixture
def built(root_directory: Path, request: pytest.FixtureRequest) -> Built:
    """A machine's C, compiled; parametrized by ``support.generated_c.cases``."""
    return build(root_directory, *request.param)
