"""A fleet written down: ``fleet.json`` and ``fleet.html``."""

from __future__ import annotations

from pathlib import Path

from truepose.files import atomic_write_text
from truepose.identification.leaves.fleet.page import fleet_document
from truepose.identification.leaves.fleet.result import Fleet
from truepose.identification.leaves.fleet.words import fleet_json
from truepose.identification.report.json_text import json_text
from truepose.shown.html import page

DOCUMENT, PAGE = "fleet.json", "fleet.html"


def put_fleet(fleet: Fleet, partial: Path) -> None:
    """Into a folder that is not published yet."""
    atomic_write_text(partial / DOCUMENT, json_text(fleet_json(fleet)))
    atomic_write_text(partial / PAGE, page(fleet_document(fleet)))


__all__ = ["DOCUMENT", "PAGE", "put_fleet"]
