"""A machine file and its recording, as data: what the sources make, the mistakes spoil and the gate is shown."""

from __future__ import annotations

import copy
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from numpy.typing import NDArray

Array = NDArray[np.float64]
Document = dict[str, Any]
MACHINE, RECORDING = "machine.yaml", "recording.csv"
XYZ, TURNS, ANGLES = ("x", "y", "z"), ("rx", "ry", "rz"), ("azimuth", "elevation")
TABLES = (".csv", ".parquet")


@dataclass(frozen=True)
class Pair:
    """A machine file (as data, mm and deg) and one recording.

    joints: kinds (``revolute`` or ``prismatic``) by column. files: what lies beside the machine file, by name.
    sheet: rows of the data sheet (standard convention: a, alpha, d, theta) where the machine is made from one.
    masses: whether the machine states weights. plain: whether nothing but geometry and noise is in the readings.
    tool: true poses (n, 4, 4) of the tool in the sensor's frame, where the source knows them.
    """

    source: str
    document: Document
    table: pd.DataFrame
    joints: Mapping[str, str]
    files: Mapping[str, str] = field(default_factory=dict)
    sheet: tuple[Mapping[str, float], ...] = ()
    plain: bool = False
    tool: Array | None = None

    @property
    def form(self) -> str:
        """``mechanism.type``."""
        return str(self.document["mechanism"]["type"])

    @property
    def sensor(self) -> str:
        """``sensor.type``."""
        return str(self.document["sensor"]["type"])

    @property
    def points(self) -> tuple[tuple[str, str, str], ...]:
        """Columns of each point that is read."""
        if self.sensor == "targets":
            return tuple((f"{p}.x", f"{p}.y", f"{p}.z") for p in self.document["sensor"]["points"])
        return (("x", "y", "z"),) if self.sensor in ("pose", "position") else ()

    @property
    def readings(self) -> tuple[str, ...]:
        """All columns of the sensor."""
        other = {"pose": TURNS, "distance": ("dL",), "ballbar": ("length",), "direction": ANGLES}.get(
            self.sensor, ()
        )
        return (*(c for point in self.points for c in point), *other)

    @property
    def lengths(self) -> tuple[str, ...]:
        """Columns of the sensor that are lengths."""
        return tuple(c for c in self.readings if c not in (*TURNS, *ANGLES))

    def draft(self) -> tuple[Document, pd.DataFrame]:
        """Copies to be spoilt."""
        return copy.deepcopy(self.document), self.table.copy()


def text_of(document: Mapping[str, Any]) -> str:
    """The machine file."""
    return str(yaml.safe_dump(dict(document), sort_keys=False, default_flow_style=None, width=120))


def write(folder: Path, document: Mapping[str, Any], table: pd.DataFrame, files: Mapping[str, str]) -> None:
    """``machine.yaml``, ``recording.csv`` and what lies beside them, in a new folder."""
    folder.mkdir(parents=True)
    (folder / MACHINE).write_text(text_of(document), encoding="utf-8")
    table.to_csv(folder / RECORDING, index=False, float_format="%.9g")
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")


def copied(folder: Path, machine: Path, recordings: Sequence[Path]) -> None:
    """A machine file with recordings that others wrote; recordings keep their names."""
    folder.mkdir(parents=True)
    shutil.copy(machine, folder / MACHINE)
    for path in recordings:
        shutil.copy(path, folder / path.name)


def found(folder: Path) -> tuple[Path, list[Path]]:
    """Machine file and recordings of a folder. Raises FileNotFoundError where one of them is missing."""
    machines = sorted(folder.glob("*.yaml"))
    tables = sorted(p for p in folder.iterdir() if p.suffix in TABLES)
    if len(machines) != 1 or not tables:
        raise FileNotFoundError(f"{folder}: found {len(machines)} machine files and {len(tables)} recordings")
    return machines[0], tables


__all__ = [
    "MACHINE",
    "RECORDING",
    "TURNS",
    "XYZ",
    "Array",
    "Document",
    "Pair",
    "copied",
    "found",
    "text_of",
    "write",
]
