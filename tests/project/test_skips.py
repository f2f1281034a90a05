"""What is skipped where nothing may be hidden: lib/support/skips.py."""

from __future__ import annotations

import pytest

from support.skips import MAY_BE_SKIPPED, NOTHING_BESIDE, SHARED, judge, reason_of


def skipped(reason: str) -> pytest.TestReport:
    where = ("test_this.py", 3, f"Skipped: {reason}")
    return pytest.TestReport("test_this.py::test", ("test_this.py", 3, "test"), {}, "skipped", where, "setup")


def test_a_skip_fails_in_ci_unless_its_reason_is_on_the_list(monkeypatch: pytest.MonkeyPatch) -> None:
    for ci in (False, True):
        monkeypatch.setenv("TRUEPOSE_CI", "1") if ci else monkeypatch.delenv("TRUEPOSE_CI", raising=False)
        for reason in (*MAY_BE_SKIPPED, "no C compiler found"):
            report = skipped(reason)
            judge(report)
            assert report.failed == (ci and reason not in MAY_BE_SKIPPED)
            assert reason in reason_of(report)


def test_what_stands_beside_the_checkout_is_missed_in_one_place() -> None:
    report = skipped(NOTHING_BESIDE)
    judge(report)
    assert isinstance(report.longrepr, tuple)
    assert report.longrepr[0] == str(SHARED)
