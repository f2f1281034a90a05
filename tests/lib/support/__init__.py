"""What several test files share: machines, closed forms, recordings. Nothing here is collected as a test."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
"""The checkout."""
TESTS = ROOT / "tests"
MACHINES = TESTS / "machines"
"""Machine files of the tests."""
