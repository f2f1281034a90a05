"""What several test files share: machines, closed forms, recordings. Nothing here is collected as a test."""

from __future__ import annotations

from pathlib import Path

MACHINES = Path(__file__).parents[1] / "machines"
"""Machine files of the tests."""
