"""A Panda calibrated by a ball in sockets, where the recording lies beside the checkout."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from real_recordings.panda import SENSORS, panda_files, panda_scatter

from support.round_trips import check_round_trip
from truepose.identification.fit.estimate import estimate
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine


@pytest.mark.parametrize("sets", [tuple(SENSORS), *((name,) for name in SENSORS)], ids=["all", *SENSORS])
def test_an_arm_is_calibrated_by_a_ball_in_sockets(
    shared: Path, tmp_path: Path, sets: tuple[str, ...]
) -> None:
    """Joint readings alone; what is left of the first set is the arm's physics, so that its limit is wider."""
    machine = load_machine(panda_files(shared / "data", tmp_path, sets)[0])
    recording = load_recording(machine, [tmp_path / "panda.csv"])
    fit = estimate(machine, recording)
    check_round_trip(fit, tmp_path)
    scatter = panda_scatter(recording, fit)
    own, seat = (np.concatenate([part[k] for part in scatter.values()]) for k in (0, 1))
    limit = {2: 0.5, 1: 0.6 if sets == ("panda_1",) else 0.25}[len(sets)]
    assert np.sqrt(np.mean(own**2)) <= limit
    assert np.sqrt(np.mean(seat**2)) <= limit
    assert fit.worst_parameter_sigma < 8
    assert {name: len(part[0]) for name, part in scatter.items()} == {
        name: {"panda_1": 36, "panda_1_with_sensor": 24}[name] for name in sets
    }
