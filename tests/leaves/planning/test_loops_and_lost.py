"""Loops that are closed from near and far, and readings that were lost."""

from __future__ import annotations

import base64
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from support import MACHINES
from truepose.errors import InputError
from truepose.identification.prediction import predict as predict_module
from truepose.identification.prediction.covariance import Covariance
from truepose.identification.prediction.predict import predict, simulate
from truepose.identification.prediction.predictor import Predictor, all_lost, lost_of
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.load import load_machine
from truepose.models.machine.closure import slides_of
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Parameter
from truepose.models.sensors.targets import Targets

Array = NDArray[np.float64]


def machine_of(name: str) -> Machine:
    return load_machine(MACHINES / f"{name}.yaml")


def rows_of(machine: Machine, q: Array, **columns: Any) -> Recording:
    data = {f"{a.reading} [{a.reading_unit}]": q[:, k] for k, a in enumerate(machine.mechanism.actuators)}
    unbound = tuple(replace(a, range=None) for a in machine.mechanism.actuators)
    free = replace(machine, mechanism=replace(machine.mechanism, actuators=unbound))
    return load_recording(free, pd.DataFrame({**data, **columns}), need_observations=False)


def drawn(machine: Machine, n: int) -> Array:
    low, high = np.array([a.range for a in machine.mechanism.actuators], dtype=float).T
    return np.random.default_rng(7).uniform(low, high, (n, len(low)))


@pytest.mark.parametrize("name", ["pus", "planar"])
def test_a_machine_a_thousand_times_larger_closes_its_loops_alike(name: str) -> None:
    """Lengths a thousandfold, angles as they are: in the same few steps, none of which is too long for it."""
    machine, factor = machine_of(name), 1000.0
    q = drawn(machine, 6)
    small = Predictor(machine, rows_of(machine, q))
    p = small.model.p_home
    x, good = small.assemble(p)
    units = [a.reading_unit for a in machine.mechanism.actuators]
    grown = q * np.where([unit == "mm" for unit in units], factor, 1.0)
    kinds = {parameter.name: parameter.unit for parameter in machine.parameters}
    lengths = [kinds[n] == "mm" for n in small.model.names]
    large = Predictor(machine, rows_of(machine, grown))
    y, same = large.assemble(np.where(lengths, factor, 1.0) * p, larger=factor)
    assert good.all() and same.all()
    slides = list(slides_of(machine.mechanism))
    slides += [False] * (x.shape[1] - len(slides))
    np.testing.assert_allclose(y, x * np.where(slides, factor, 1.0), rtol=1e-7, atol=1e-6)


def test_rows_out_of_newton_s_reach_are_followed_from_others_or_given_up() -> None:
    """Whether they are: the loops are closed there all the same, and of rows that cannot be nothing is said."""
    machine = machine_of("ups")
    span = np.array([a.range for a in machine.mechanism.actuators], dtype=float)[:, 1]
    q = np.outer(np.linspace(-4.0, 4.0, 9), span) * [1, -1, 1, -1, 1, -1]
    q = np.vstack([q, np.full((1, 6), 1e6)])
    predictor = Predictor(machine, rows_of(machine, q))
    p = predictor.model.p_home
    x, good = predictor.assemble(p)
    few, reached = predictor.assemble(p, follow=False)
    assert not good[-1] and good[4] and not (reached & ~good).any()
    np.testing.assert_allclose(few[reached], x[reached], atol=1e-6)
    again, same = predictor.assemble(p, x)
    np.testing.assert_array_equal(same[good], good[good])
    np.testing.assert_allclose(again[good], x[good], atol=1e-6)


# -- lost readings -------------------------------------------------------------------------------------


def test_a_lost_reading_takes_the_channels_with_it_that_depend_on_it() -> None:
    """Of a pose all turns with one of them, a length alone; of points each by itself."""
    machine = machine_of("ups")
    point = (
        Parameter(f"T1.{axis}", "mm", value, 0.0, "target")
        for axis, value in zip("xyz", (1.0, 2.0, 3.0), strict=True)
    )
    machine = replace(machine, sensors=(*machine.sensors, Targets(tuple(point), 0.01)))
    q = drawn(machine, 4)
    read = simulate(machine, rows_of(machine, q), seed=None)
    read.loc[1, "ry"] = read.loc[2, "x"] = read.loc[2, "T1.z"] = np.nan
    recording = replace(
        rows_of(machine, q), observations={str(name): read[name].to_numpy() for name in read.columns}
    )
    pose, points = machine.sensors
    found, other = lost_of(pose, recording), lost_of(points, recording)
    assert found is not None and other is not None
    nothing, turns = [False] * 6, [False] * 3 + [True] * 3
    assert found.tolist() == [nothing, turns, [True, *nothing[1:]], nothing]
    assert other.tolist() == [[False] * 3, [False] * 3, [False, False, True], [False] * 3]
    both = all_lost(machine, [found, other], 4)
    assert both is not None and both.tolist() == np.hstack([found, other]).tolist()
    alone = all_lost(machine, [None, other], 4)
    assert alone is not None and alone.tolist() == np.hstack([np.zeros((4, 6), dtype=bool), other]).tolist()
    assert all_lost(machine, [None, None], 4) is None
    predictor = Predictor(machine, recording)
    assert predictor.lost is not None and predictor.lost.tolist() == both.tolist()
    (block,) = predictor.blocks(predictor.model.p_home, predictor.assemble(predictor.model.p_home)[0])
    assert not block.residual[both].any() and not block.jacobian[both].any()
    whole = replace(recording, observations={k: np.nan_to_num(v) for k, v in recording.observations.items()})
    assert lost_of(pose, whole) is None and Predictor(machine, whole).lost is None
    none = replace(recording, observations={k: v for k, v in recording.observations.items() if k != "x"})
    assert lost_of(pose, none) is None and lost_of(points, none) is not None


# -- changes, some rows at a time ----------------------------------------------------------------------


def test_changes_are_predicted_with_all_rows_that_they_count_from(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = machine_of("distance")
    recording = rows_of(machine, drawn(machine, 6), **{"pose": np.arange(6), "from": [0, 1, 0, 1, 2, 0]})
    whole = predict(machine, recording)
    monkeypatch.setattr(predict_module, "TOGETHER", 2)
    pd.testing.assert_frame_equal(predict(machine, recording), whole)


@pytest.mark.parametrize(("text", "read"), [("{}", True), ("{} ", True), ("*{}", False), ("{}AAAA", False)])
def test_a_packed_factor_is_read_whole_or_refused(text: str, read: bool) -> None:
    packed = base64.b64encode(np.array([1.0, 0.5, 2.0], dtype="<f4").tobytes()).decode("ascii")
    section = {"names": ["a", "b"], "factor": text.format(packed)}
    if not read:
        with pytest.raises(InputError, match=r"cannot be read|rows of factor"):
            Covariance.read(section, "here")
        return
    np.testing.assert_array_equal(Covariance.read(section, "here").factor, [[1.0, 0.0], [0.5, 2.0]])
