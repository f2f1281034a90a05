"""A calibrated arm on a rail, a path for it, and the commands of ``truepose compensate``: what a controller must do.

Its joints are in mm and rad, and its errors depend on a payload and a temperature.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from support.calibrated_machines import calibrated
from support.command import run
from truepose.arrays import Array
from truepose.codegen.c import generate
from truepose.codegen.printer import Real
from truepose.models.load import load_machine

NAME = "arm"
READINGS = ["q1 [mm]", "q2 [rad]", "q3 [rad]", "q4 [rad]", "q5 [rad]", "q6 [rad]"]
DRIVERS = ["payload", "temperature.link2"]
MIDDLE = np.array([10.0, -0.5, 0.3, 0.2, 0.8, -0.4])
REACH = np.array([90.0, 0.3, 0.3, 0.5, 0.2, 0.6])
"""About the middle; joint 5 stays off the straight wrist."""
STRAIGHT = np.radians(-84.0)
"""Of joint 3: almost the elbow's straight position, -atan(420 / 35)."""


@dataclass(frozen=True)
class Path6:
    """``nominal`` and ``command`` joints (n, 6) in mm and rad, and the drivers (n, 2) beside them."""

    nominal: Array
    drivers: Array
    command: Array


def planned(ticks: int = 150) -> tuple[Array, Array]:
    """Nominal joints (n, 6) along a smooth path, and drivers (n, 2): a payload taken up on the way, a link that warms up."""
    share = np.linspace(0.0, 1.0, ticks)
    phase = np.arange(6.0)
    nominal = MIDDLE + REACH * np.sin(2 * np.pi * share[:, None] + phase)
    drivers = np.column_stack([np.where(share < 0.5, 0.0, 3.0), 20.0 + 12.0 * share])
    return nominal, drivers


def compensated(folder: Path, machine: Path, nominal: Array, drivers: Array) -> Path6:
    """The path with the commands that the command line gives for it."""
    table, commands = folder / "path.csv", folder / "commands.csv"
    pd.DataFrame(np.hstack([drivers, nominal]), columns=[*DRIVERS, *READINGS]).to_csv(table, index=False)
    run("compensate", machine, table, "-o", commands)
    return Path6(nominal, drivers, pd.read_csv(commands)[READINGS].to_numpy())


def written(folder: Path, real: Real = "double") -> Path:
    """The machine's file, with its C in ``controller/`` beside it."""
    machine = calibrated("rail", folder)
    assert machine.file is not None
    generate(machine, folder / "controller", real, nominal=machine.file.nominal)
    return folder / "calibrated.yaml"


def parameter(machine: Path, name: str) -> float:
    """A parameter's value in a machine file, mm or rad."""
    return next(p.nominal for p in load_machine(machine).parameters if p.name == name)
