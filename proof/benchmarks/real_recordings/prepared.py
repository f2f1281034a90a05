"""Machine file and recording of every machine, with a column ``role`` that keeps some rows out of every fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from real_recordings.panda import SENSORS, panda_files, with_gravity

from truepose.identification.leaves.readers.importing import frame_of, machine_of, read_foreign

UR10 = ("configurations", "random", "grid")
STEWART = ("session_108", "session_60")
PANDA, MOUNT = "panda", "gem-28"
SETS = {PANDA: tuple(SENSORS), **{name: (name,) for name in SENSORS}}
"""Names for the Panda's rows, with the sets that they hold: both together, and each alone, with gravity stated."""
NAMES = (*UR10, *STEWART, *SETS, MOUNT)
HELD_OUT = (3, 6, 9)
"""Goals, or stars, modulo ten that are held out."""
EVERY = 5
"""Every fifth row of a session without goals is held out."""


def prepared(data: Path, work: Path, name: str) -> tuple[Path, Path]:
    """Machine file and recording, the latter in ``work``: ready for ``truepose diagnose``."""
    work.mkdir(parents=True, exist_ok=True)
    if name in SETS:
        machine, recording = panda_files(data, work, SETS[name], name)
        if name != PANDA:
            with_gravity(machine)
        return machine, recording
    if name == MOUNT:
        stars = data / "telescope-mount" / f"{name}.dat"
        machine = work / "mount.yaml"
        machine.write_text(machine_of(stars), encoding="utf-8")
        table = frame_of(read_foreign(stars))
        held = np.isin(np.arange(len(table)) % 10, HELD_OUT)
    else:
        folder = data / ("stewart-mocap" if name in STEWART else "ur10-laser-tracker")
        machine, table = folder / "machine.yaml", pd.read_csv(folder / f"{name}.csv")
        turn = np.arange(len(table))
        held = turn % EVERY == EVERY - 1 if name in STEWART else np.isin(table["goal"] % 10, HELD_OUT)
    table["role"] = np.where(held, "validation", "calibration")
    table.to_csv(work / f"{name}.csv", index=False)
    return machine, work / f"{name}.csv"
