"""Machines of texts, by way of their files, and what their sensors read where effects act."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from truepose.identification.prediction.predict import simulate
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.effect_text import parse_effect
from truepose.models.effects.base import PlacedEffect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.units import UnitSystem, convert


def machine_from(folder: Path, text: str, name: str = "machine") -> Machine:
    """Return the machine of a text, which is written to a file of this name."""
    path = folder / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return load_machine(path)


def poses_of(machine: Machine, table: pd.DataFrame) -> Recording:
    """Return a recording of joints and drivers alone."""
    return load_recording(machine, table, need_observations=False)


def readings_of(
    machine: Machine, table: pd.DataFrame, *effects: str | PlacedEffect, seed: int | None = 3
) -> pd.DataFrame:
    """Return the table with what the sensors read of a machine with these effects too."""
    placed = [parse_effect(one, machine) if isinstance(one, str) else one for one in effects]
    return pd.concat([table, simulate(machine, poses_of(machine, table), placed, seed=seed)], axis=1)


def recorded(
    machine: Machine, table: pd.DataFrame, *effects: str | PlacedEffect, seed: int | None = 3
) -> Recording:
    """Return the recording of such a table."""
    return load_recording(machine, readings_of(machine, table, *effects, seed=seed))


def drawn_table(machine: Machine, rows: int, seed: int, **columns: Any) -> pd.DataFrame:
    """Return joints at random within their ranges beside other columns; rows of changes count from the row before."""
    rng, data = np.random.default_rng(seed), dict[str, Any]()
    if any(sensor.differs_from_row for sensor in machine.sensors):
        data |= {"pose": np.arange(rows), "from": np.maximum(np.arange(rows) - 1, 0)}
    data |= columns
    for actuator in machine.mechanism.actuators:
        assert actuator.range is not None
        data[f"{actuator.reading} [{actuator.reading_unit}]"] = rng.uniform(*actuator.range, rows)
    return pd.DataFrame(data)


def observed(
    machine: Machine, poses: Recording, effects: Sequence[PlacedEffect] = (), seed: int | None = None
) -> Recording:
    """Return the same rows with what the sensors read, whatever units the machine's file has."""
    frame = simulate(replace(machine, file=None), poses, effects, seed=seed)
    units = {name: unit for sensor in machine.sensors for name, unit in sensor.columns.items()}
    read = {
        name: convert(frame[name].to_numpy(), UnitSystem().written(unit), unit)
        for name, unit in units.items()
    }
    return replace(poses, observations=read)
