"""An angle means the same whether it is logged from 0 to 360 degrees or from -180 to 180."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.skips import NOTHING_BESIDE, SHARED
from truepose.identification.load import load_recording
from truepose.models.load import load_machine
from truepose.models.machine import Machine

ARM = """
schema: truepose/machine/1
name: arm
mechanism:
  type: serial
  joints: [{name: q1, kind: revolute, d: 100, r: 50}, {name: q2, kind: revolute, d: 200, alpha: 90%s}]
sensor: {type: position, sigma: {xyz: 0.1}}
tolerances: {length: 0.1, angle: 0.1}
"""


@pytest.fixture(scope="module")
def arms(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Machine]:
    """Return an arm without a range, and one whose second joint has one."""
    out = {}
    for name, text in (("free", ""), ("ranged", ", range: [0, 360]")):
        path = tmp_path_factory.mktemp(name) / "arm.yaml"
        path.write_text(ARM % text)
        out[name] = load_machine(path)
    return out


def readings(machine: Machine, q: np.ndarray) -> np.ndarray:
    """Return the joint readings, deg, that a recording of these columns is read as."""
    table = {"q1": q[:, 0].tolist(), "q2": q[:, 1].tolist(), **dict.fromkeys("xyz", [0.0] * len(q))}
    return np.degrees(load_recording(machine, table).q)


@given(
    angles=st.lists(st.floats(-179.0, 179.0), min_size=4, max_size=12),
    beside=st.floats(-179.0, 179.0),
)
def test_angles_logged_from_zero_are_read_as_those_about_zero(
    arms: dict[str, Machine], angles: list[float], beside: float
) -> None:
    q = np.array([[*pair] for pair in zip([-5.0, 5.0, *angles], [beside] * (len(angles) + 2), strict=True)])
    np.testing.assert_allclose(readings(arms["free"], q % 360.0)[:, 0], q[:, 0], atol=1e-9)
    np.testing.assert_allclose(readings(arms["free"], q)[:, 0], q[:, 0], atol=1e-9)


def test_an_arc_that_is_whole_and_a_stated_range_stay(arms: dict[str, Machine]) -> None:
    q = np.column_stack([np.linspace(100.0, 250.0, 7), np.linspace(5.0, 355.0, 7)])
    np.testing.assert_allclose(readings(arms["ranged"], q), q)


@pytest.mark.parametrize("case", ["s_", ""])
def test_both_ways_of_logging_read_the_same_recording(case: str) -> None:
    folder = SHARED / "cases" / "wrapped-readings"
    if not folder.is_dir():
        pytest.skip(NOTHING_BESIDE)
    machine = load_machine(folder / "nolim.yaml")
    wrapped, signed = (
        load_recording(machine, [folder / f"{case}{name}.csv"]) for name in ("wrapped", "signed")
    )
    np.testing.assert_allclose(wrapped.q, signed.q, atol=1e-12)
