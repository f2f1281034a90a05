"""A result written, read, predicted and generated: all of them must be the same machine."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np

import truepose
from support.generated_c import COMPILER, LEVEL, compile_library
from truepose.identification.compensation.inverse import PoseSolver
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.write_machine import calibrated_text
from truepose.identification.report.files import file_of
from truepose.models import lie
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES

POSES = 5


def check_round_trip(found: Estimate | Calibration | Diagnosis, folder: Path) -> None:
    """Write the machine of a result, read it and generate it; predictions and poses are those of the result."""
    path = folder / "improved.yaml"
    path.write_text(calibrated_text(path, **file_of(found))[0], encoding="utf-8")
    again = truepose.load_machine(path)
    rows = found.recording.subset(slice(0, 50))
    expected = truepose.predict(again, rows)
    off = (truepose.predict(found, rows) - expected).abs().max()
    assert (off <= 1e-9 * expected.abs().max().clip(lower=1e-9)).all(), off[off > 0].to_dict()
    named = replace(found.machine, name="machine")  # not every name is one of C
    truepose.generate(named, folder / "c", features="warm")
    if COMPILER is not None:
        q = found.recording.q[:: max(1, len(found.recording) // POSES)]
        _check_poses(replace(again, name="machine"), folder / "c", q)


def _check_poses(machine: Machine, folder: Path, q: np.ndarray) -> None:
    """Compile the C and compare the tool's poses at readings q (n, nq) with those in Python, drivers at their defaults."""
    forward = getattr(compile_library(folder, [f"{machine.name}_kin.c"], LEVEL), f"{machine.name}_fk")
    poses, good = PoseSolver(machine).forward(q)
    base = [ca.SX(machine.geometry[f"base.{axis}"].nominal) for axis in AXES]
    stand = np.linalg.inv(ca.evalf(lie.rpy_transform(base[:3], base[3:])).full())
    for row, pose in zip(np.ascontiguousarray(q[good]), stand @ poses[good], strict=True):
        out = np.zeros(12)
        pointers = (ctypes.c_void_p(array.ctypes.data) for array in (row, out))
        assert forward(None, None, *pointers) == 0
        np.testing.assert_allclose(out.reshape(3, 4), pose[:3], rtol=0.0, atol=1e-6)
