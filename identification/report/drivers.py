"""Columns of a recording that residuals may follow, in the units people read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array
from truepose.identification.recording.recording import Recording
from truepose.identification.report.numbers import unit_symbol
from truepose.models.file.driver import ROW
from truepose.models.machine.machine import Machine
from truepose.models.machine.sensor import Channel

MOST = 12


@dataclass(frozen=True)
class Column:
    """A driver's name, its axis title with unit, and values (n,)."""

    name: str
    title: str
    values: Array


def columns(machine: Machine, recording: Recording, first: Sequence[str] = ()) -> list[Column]:
    """Joints, what was logged and varies, the order of rows: twelve at most, those of ``first`` kept."""
    found = [column_of(machine, recording, name) for name in (*recording.joints, *recording.logged)]
    out = [column for column in found if column is not None]
    varying = [c for c in out if np.ptp(c.values) > 0.0]
    kept = {c.name for c in sorted(varying, key=lambda c: c.name not in first)[: MOST - 1]}
    return [
        *(c for c in varying if c.name in kept),
        order_column(recording),
    ]


def column_of(machine: Machine, recording: Recording, name: str) -> Column | None:
    """A joint or a logged driver; None where the recording has neither."""
    if name in recording.joints:
        return joint_column(machine, recording, name)
    values = recording.driver(name)
    if values is None:
        return None
    if name == ROW:
        return Column(name, "rows before the last [1]", values)
    unit = machine.driver_unit(name)
    shown = "±1" if unit == "1" else unit_symbol(unit) or "as recorded"
    return Column(name, f"{name} [{shown}]", values)


def order_column(recording: Recording) -> Column:
    """The order in which rows were recorded."""
    return Column("order", "row in order of acquisition [1]", np.arange(1.0, len(recording) + 1.0))


def joint_column(machine: Machine, recording: Recording, name: str) -> Column:
    """A joint's own motion, angles in degrees."""
    factor, unit = reading_unit(machine, name)
    values = recording.moved[:, recording.joints.index(name)]
    return Column(name, f"{name} [{unit}]", values * factor)


def reading_unit(machine: Machine, name: str) -> tuple[float, str]:
    """Factor and unit in which a joint's readings are shown."""
    unit = machine.mechanism.actuator(name).reading_unit
    return (float(np.degrees(1.0)), "°") if unit == "rad" else (1.0, unit_symbol(unit))


def component_groups(channels: Sequence[Channel]) -> dict[str, list[int]]:
    """Indices of residual components that share an axis (P1.x, P2.x: x), six groups at most."""
    out: dict[str, list[int]] = {}
    for k, channel in enumerate(channels):
        out.setdefault(channel.name.rsplit(".", 1)[-1], []).append(k)
    return dict(list(out.items())[:6])
