"""Small fleets: arms of two joints beside a tracker, some with a gain or a play that their model lacks. mm, deg."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from challenge.simulator.base import Imperfection, Plan
from support.tiny_machine import Tiny

GAIN = Imperfection("gain", ("q1",), 2e-3, {})
PLAY = Imperfection("play", ("q2",), 2e-3, {})
ROWS = 16


def rows(seed: int, faults: Sequence[Imperfection] = (), count: int = ROWS) -> pd.DataFrame:
    """A recording: readings of the joints and of the tracker, and the sides that joints came from."""
    arm, rng = Tiny(), np.random.default_rng(seed)
    campaign = arm.campaign(Plan(poses=count, repeats=1, both_sides=True), rng)
    exact = arm.measure(arm.specimen(rng), tuple(faults), campaign)
    readings = arm.noisy(exact, campaign, rng)
    columns = {name: np.degrees(campaign.q[:, k]) for k, name in enumerate(arm.readings)}
    columns |= {name: readings[:, k] for k, name in enumerate(arm.columns)}
    columns |= {f"approach.{name}": campaign.approach[:, k] for k, name in enumerate(arm.readings)}
    return pd.DataFrame(columns)


def write_machine(folder: Path, recording: pd.DataFrame, name: str = "recording.csv") -> None:
    """A folder of one machine."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "machine.yaml").write_text(Tiny().machine_text(), encoding="utf-8")
    recording.to_csv(folder / name, index=False)


def write_fleet(folder: Path, faults: Mapping[str, Sequence[Imperfection]]) -> Path:
    """A folder of machines by name."""
    for seed, (name, own) in enumerate(faults.items()):
        write_machine(folder / name, rows(seed, own))
    return folder


__all__ = ["GAIN", "PLAY", "rows", "write_fleet", "write_machine"]
