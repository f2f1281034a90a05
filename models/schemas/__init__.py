"""JSON Schemas (draft 2020-12) of truepose's files, made from the code and shipped beside it.

`machine-1.json` and `recording-1.json` are what ``truepose schema`` prints and what editors find at the address in a
machine file's first line. ``python docs/reference_tables.py`` renews them after a change of the code.
"""

from __future__ import annotations

from importlib import resources
from typing import Final

MACHINE, RECORDING = "machine", "recording"
FILES: Final = {MACHINE: "machine-1.json", RECORDING: "recording-1.json"}


def stored(kind: str) -> str:
    """The text of the schema of ``kind`` (``machine``, ``recording``) as it was shipped."""
    return (resources.files(__name__) / FILES[kind]).read_text(encoding="utf-8")
