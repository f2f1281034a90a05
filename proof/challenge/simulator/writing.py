"""A campaign and its readings as a recording (CSV, mm and deg): what a laboratory would hand over.

Nothing else leaves the simulator: no body temperatures that no thermometer read, no dwell, no true values.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .base import Array, Campaign, SimulatedMachine

DIGITS = 9
"""Decimals of joints and readings: far below any noise."""


def recording_text(
    machine: SimulatedMachine,
    campaign: Campaign,
    observed: Array,
    *,
    withhold: Collection[str] = (),
) -> str:
    """CSV text: pose, time, session, role, joints, approach.*, velocity.*, payload, temperature.*, pressure, from, sensor.

    observed (n, n_columns): mm and rad, with noise. withhold: columns that were not logged, by name or by what
    stands before the dot (``temperature`` for all of them). Raises ValueError for rows that do not fit together
    and for an origin that the column ``from`` cannot name.
    """
    n = len(campaign)
    if observed.shape != (n, len(machine.columns)):
        raise ValueError(f"observed: found shape {observed.shape}, expected {(n, len(machine.columns))}")
    logged = _logged(machine, campaign)
    kept = {name: c for name, c in logged.items() if not {name, name.split(".")[0]} & set(withhold)}
    joints: dict[str, NDArray[np.generic]] = {
        name: _written(campaign.q[:, k], is_angle)
        for k, (name, is_angle) in enumerate(zip(machine.readings, machine.revolute, strict=True))
    }
    sensed: dict[str, NDArray[np.generic]] = {
        name: _written(observed[:, k], unit == "rad")
        for k, (name, unit) in enumerate(zip(machine.columns, machine.column_units, strict=True))
    }
    head = [name for name in ("pose", "time", "session", "role") if name in kept]
    body = [name for name in kept if name not in head]
    columns = {k: kept[k] for k in head} | joints | {k: kept[k] for k in body} | sensed
    table = pd.DataFrame(columns)
    return str(table.to_csv(index=False, float_format=f"%.{DIGITS}f"))


def _logged(machine: SimulatedMachine, campaign: Campaign) -> dict[str, NDArray[np.generic]]:
    """Columns beyond joints and readings, in the order of the file."""
    out: dict[str, NDArray[np.generic]] = {
        "pose": campaign.pose,
        "time": campaign.time,
        "session": campaign.session,
        "role": np.where(campaign.validation, "validation", "calibration"),
    }
    out |= {
        f"approach.{name}": campaign.approach[:, k].astype(np.int64)
        for k, name in enumerate(machine.readings)
    }
    if campaign.velocity is not None:
        for k, name in enumerate(machine.readings):
            out[f"velocity.{name}"] = _written(campaign.velocity[:, k], machine.revolute[k])
    out["payload"] = campaign.payload
    out |= {f"temperature.{place}": values for place, values in campaign.temperatures.items()}
    out["pressure"] = campaign.pressure
    if np.any(campaign.origin != np.arange(len(campaign))):
        out["from"] = _from(campaign)
    return out


def _from(campaign: Campaign) -> NDArray[np.int64]:
    """(n,) pose numbers: ``from`` means the latest earlier row with that number, else the row itself."""
    for row, origin in enumerate(campaign.origin):
        number = campaign.pose[origin]
        earlier = np.nonzero(campaign.pose[:row] == number)[0]
        meant = int(earlier[-1]) if len(earlier) else row
        if meant != origin:
            raise ValueError(
                f"row {row + 1}: its origin is row {origin + 1}, but pose {number} was last at row {meant + 1}"
            )
    return campaign.pose[campaign.origin]


def _written(values: Array, is_angle: bool) -> Array:
    written: Array = np.round(np.degrees(values) if is_angle else values, DIGITS)
    return written
