"""How results of the kernel show themselves: loaded for what these modules register."""

from __future__ import annotations

from truepose.identification.report import (
    compensation_words,
    diagnosis,
    estimate,
    files,
    frames,
    identifiability_words,
)

__all__ = ["compensation_words", "diagnosis", "estimate", "files", "frames", "identifiability_words"]
