"""The first line of every machine file that is written: editors fetch the schema it names and check what is typed."""

from __future__ import annotations

from typing import Final

SCHEMA_LINE: Final = "# yaml-language-server: $schema=https://truepose.dev/schema/machine-1.json"
