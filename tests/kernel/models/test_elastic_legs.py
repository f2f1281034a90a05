"""The telescope's elastic legs: chains of rods, the limit of ball joints, and weight. mm, N, rad."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from support.telescope_models import (
    LOADED,
    TRAVEL,
    apart,
    hinged,
    machine_of,
    number,
    poses_of,
)
from truepose.errors import InputError
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.near_home import chain_energy

Array = NDArray[np.float64]


# -- a rod ---------------------------------------------------------------------------------------------


def test_a_chain_of_equal_pieces_is_a_cantilever() -> None:
    ei, ea, gj, length = 3e6, 5e5, 2e6, 120.0
    pieces = [(ca.SX(v), ca.SX(ei), ca.SX(ea), ca.SX(gj)) for v in (20.0, 70.0, 30.0)]
    along, side, up, still = ca.SX([1, 0, 0]), ca.SX([0, 1, 0]), ca.SX([0, 0, 1]), ca.SX.zeros(3)

    def stiffness(shift: ca.SX, turned: ca.SX) -> float:
        return 2 * number(chain_energy(pieces, along, shift, turned))

    assert stiffness(along, still) == pytest.approx(ea / length, rel=1e-12)
    assert stiffness(still, along) == pytest.approx(gj / length, rel=1e-12)
    assert stiffness(side, still) == pytest.approx(12 * ei / length**3, rel=1e-12)
    assert stiffness(still, up) == pytest.approx(4 * ei / length, rel=1e-12)
    both = 12 * ei / length**3 - 12 * ei / length**2 + 4 * ei / length
    assert stiffness(side, up) == pytest.approx(both, rel=1e-12)


# -- six legs ------------------------------------------------------------------------------------------


def test_hinged_stiff_legs_are_ball_joints(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "elastic")
    ball = poses_of(tmp_path, machine_of(tmp_path, "spherical"), TRAVEL)
    real = apart(poses_of(tmp_path, machine, TRAVEL), ball)
    free = apart(poses_of(tmp_path, machine_of(tmp_path, "elastic", *hinged(machine)), TRAVEL), ball)
    # ten orders of stiffness apart: what flexures do shrinks to the rounding of the printed numbers
    assert real > 1e-3 and free < 1e-9 * 500


def test_elastic_legs_carry_the_platform(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "stiffness", *LOADED)
    light = poses_of(tmp_path, machine_of(tmp_path, "stiffness"), np.zeros((1, 6)))
    loaded = poses_of(tmp_path, machine, np.zeros((1, 6)))
    sag = loaded[0, :3, 3] - light[0, :3, 3]
    pull = machine.mechanism.rods[0].elastic
    assert pull is not None
    cosine = light[0, 2, 3] - 120.0
    vertical = 6 * pull.stiffness * (cosine / 500.0) ** 2
    # bending of the clamped legs helps by less than 1 %
    assert -sag[2] == pytest.approx(20 * 9.80665 / vertical, rel=0.01)
    assert np.abs(sag[:2]).max() < 1e-6


def test_an_effect_of_loads_is_refused_where_legs_are_elastic(tmp_path: Path) -> None:
    line = "tolerances:"
    soft = "effects:\n  - {effect: leg-compliance, place: [leg1], parameters: {c: {value: 1e-4, unit: mm/N}}}\ntolerances:"
    machine = machine_of(tmp_path, "stiffness", *LOADED, (line, soft))
    with pytest.raises(InputError, match=r"leg-compliance@leg1.*elastic.*expected model: spherical"):
        symbolic_model(machine, machine.effects)


def heights(folder: Path, machine: Machine, loads: list[float]) -> Array:
    """(n,) z of the tool at home under recorded payloads, mm."""
    columns = [*machine.mechanism.readings, *(c for s in machine.sensors for c in s.columns)]
    frame = pd.DataFrame(np.zeros((len(loads), len(columns))), columns=columns).assign(payload=loads)
    frame.to_csv(folder / "loads.csv", index=False)
    predictor = Predictor(machine, load_recording(machine, [folder / "loads.csv"]))
    poses, good = predictor.poses(predictor.model.p_home)
    assert good.all()
    return np.asarray(poses[:, 2, 3])


def test_elastic_legs_sag_by_the_recorded_payload(tmp_path: Path) -> None:
    """In proportion to it (the legs are linear springs), and by as much as under a mass of that weight in the file."""
    empty = [(old, new.replace("kg: 20", "kg: 0")) for old, new in LOADED]
    z = heights(tmp_path, machine_of(tmp_path, "stiffness", *empty), [0.0, 10.0, 20.0])
    sag = z[0] - z
    assert sag[2] > 5e-4
    assert sag[1] == pytest.approx(sag[2] / 2, rel=1e-3)
    fixed = heights(tmp_path, machine_of(tmp_path, "stiffness", *LOADED), [20.0])
    assert z[2] == pytest.approx(fixed[0], abs=1e-9)
