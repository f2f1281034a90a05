"""Hostile files that once did harm are refused in one line, within 2 GB."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

import pytest

from fuzzing.listed import CASES
from support import ROOT, TESTS

pytestmark = pytest.mark.skipif(os.name == "nt", reason="no fork")


@pytest.fixture(scope="module")
def outcomes() -> dict[str, Any]:
    """What came of every case: tried in a process of its own, which is copied for each."""
    paths = os.pathsep.join(map(str, (ROOT / "src", TESTS / "lib", ROOT)))
    done = subprocess.run(
        [sys.executable, "-m", "fuzzing.listed"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": paths},
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_what_once_did_harm_is_refused_in_words(outcomes: dict[str, Any], case: Any) -> None:
    outcome = outcomes[case.name]
    assert not outcome["fault"], outcome["said"]
    if case.words:
        assert outcome["code"] == 2
        assert case.words in outcome["said"]
    else:
        assert outcome["code"] == 0
