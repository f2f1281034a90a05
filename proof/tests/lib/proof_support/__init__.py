"""What test files of the examination and of the studies share; nothing here is collected as a test."""

from __future__ import annotations

from pathlib import Path

PROOF = Path(__file__).resolve().parents[3]
"""The folder of this distribution."""
BENCHMARKS = PROOF / "benchmarks"
