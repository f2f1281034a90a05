"""Settings of the whole test run: one BLAS thread a worker, and no deadlines on a shared machine."""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy is imported; workers of pytest-xdist inherit it

from hypothesis import settings  # noqa: E402

settings.register_profile("truepose", deadline=None, derandomize=True)
settings.load_profile("truepose")
