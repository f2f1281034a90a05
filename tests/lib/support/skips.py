"""Which tests may be skipped where nothing may be hidden.

With ``TRUEPOSE_CI`` set (``.ci/run`` and ``.ci/nightly`` do) a skipped test has failed, unless its reason is in
``MAY_BE_SKIPPED``: what a test needs is installed there, and a test that never has anything to check is a fault.
"""

from __future__ import annotations

import os

import pytest

from support import ROOT

SHARED = ROOT.parent / "shared"
NOTHING_BESIDE = "no recordings by others beside the checkout (they are no part of the project)"
NO_AVX2 = "this processor has no AVX2"
NO_MUJOCO = "MuJoCo, or a package that ships its arms, is not installed (half a gigabyte)"
MAY_BE_SKIPPED = frozenset({NOTHING_BESIDE, NO_AVX2, NO_MUJOCO})
"""What no package can install, or what is too large to be asked of everybody."""


def reason_of(report: pytest.TestReport | pytest.CollectReport) -> str:
    """Why a test (or all of a file) was skipped."""
    if not isinstance(report.longrepr, tuple):
        return str(report.longrepr)
    return str(report.longrepr[2]).removeprefix("Skipped: ")


def judge(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Make a skip a failure, where ``TRUEPOSE_CI`` is set and its reason is not on the list.

    Whatever wants ``SHARED`` is told to have been skipped there, so that the summary says it in one line.
    """
    if not report.skipped:
        return
    reason = reason_of(report)
    if "TRUEPOSE_CI" in os.environ and reason not in MAY_BE_SKIPPED:
        report.longrepr = f"{report.nodeid} was skipped, which is a failure in CI: {reason}"
        report.outcome = "failed"
    elif reason == NOTHING_BESIDE:
        report.longrepr = (str(SHARED), 0, f"Skipped: {reason}")
