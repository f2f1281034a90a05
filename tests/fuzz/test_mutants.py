"""Mutants of every kind of file: done, or refused in one line; never a traceback, 2 GB or half a result."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from fuzzing.kinds import KINDS
from support import ROOT, TESTS
from support.examples import examples

MUTANTS = examples(150)
"""Of each kind: 50 by day; .ci/nightly tries 10,000 more."""
pytestmark = pytest.mark.skipif(os.name == "nt", reason="no fork")


@pytest.mark.parametrize("kind", [kind.name for kind in KINDS])
def test_mutants_are_read_or_refused(kind: str) -> None:
    paths = os.pathsep.join(map(str, (ROOT / "src", TESTS / "lib", ROOT)))
    done = subprocess.run(
        [sys.executable, "-m", "fuzzing", "-n", str(MUTANTS), "-j", "1", "--kind", kind],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": paths},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    _, tried, refused, accepted, broken, *_ = (
        cell.strip() for cell in done.stdout.splitlines()[-1].split("|")[1:-1]
    )
    assert (int(tried), int(broken)) == (MUTANTS, 0)
    assert int(refused) > 0 and int(accepted) > 0  # mutants of all sorts
