"""Where the JSON Schemas of truepose's files are found, and the line by which a YAML file names its own."""

from __future__ import annotations

from typing import Final

MACHINE_SCHEMA: Final = "https://truepose.dev/schema/machine-1.json"
RECORDING_SCHEMA: Final = "https://truepose.dev/schema/recording-1.json"
SCHEMA_LINE: Final = f"# yaml-language-server: $schema={MACHINE_SCHEMA}"
"""First line of a machine file: editors complete and check what follows. For truepose it is a comment."""
