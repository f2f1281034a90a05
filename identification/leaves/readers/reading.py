"""Kinds of files that are read as tables beside text and Parquet: ROS bags and workbooks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from truepose.identification.leaves.readers.bags import is_bag, read_bag
from truepose.identification.leaves.readers.spreadsheet import MAGIC, read_spreadsheet
from truepose.identification.recording.table import Table, table_of
from truepose.identification.recording.text import TextTable


def read_cells(path: Path, readings: Sequence[str]) -> TextTable | None:
    """Return the cells of a bag, a row for each stretch in which all joints stand, or of a workbook; None for other files."""
    if is_bag(path):
        return read_bag(path, None, (), readings)
    with path.open("rb") as stream:
        workbook = stream.read(8).startswith(MAGIC)
    return read_spreadsheet(path) if workbook else None


def bag_table(
    path: Path, topic: str | None = None, joints: Sequence[str] = (), readings: Sequence[str] = ()
) -> Table:
    """Return a ROS bag as a table; see ``bags.read_bag``."""
    return table_of(str(path), read_bag(path, topic, joints, readings))
