"""What rows of an experiment would tell: as simulated readings say, whatever the sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from support import MACHINES
from support.experiments import arm, poses, telescope
from truepose.identification.leaves.planning.discriminate.factors import explanation
from truepose.identification.leaves.planning.discriminate.race import Rows, recording_of, signals
from truepose.identification.leaves.planning.information import PoseInformation
from truepose.identification.prediction.predict import simulate
from truepose.models.effects.base import PlacedEffect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.sensors.targets import Targets

Array = NDArray[np.float64]


def part(text: str, machine: Machine) -> PlacedEffect:
    return explanation(text, machine).forms[0][0]


def gram(columns: Array) -> Array:
    """(c, k, k) information of each row."""
    return np.asarray(np.einsum("cmi,cmj->cij", columns, columns))


def rows_of(machine: Machine, q: Array) -> Rows:
    rng = np.random.default_rng(5)
    return Rows(q, {"payload": rng.uniform(1, 5, len(q)), "approach.q2": rng.choice([-1.0, 1.0], len(q))})


def exact() -> Machine:
    """A telescope whose three points are known exactly: nine readings, which tell of six motions of the mirror."""
    (sensor,) = telescope().sensors
    assert isinstance(sensor, Targets)
    points = tuple(replace(point, tolerance=0.0) for point in sensor.parameters)
    return replace(telescope(), sensors=(replace(sensor, parameters=points),))


@pytest.mark.parametrize(("name", "readings"), [("serial", 3), ("ups", 6), ("pus", 9), ("exact", 6)])
def test_rows_say_of_constants_what_planned_poses_say(name: str, readings: int) -> None:
    machine = exact() if name == "exact" else load_machine(MACHINES / f"{name}.yaml")
    information = PoseInformation(machine)
    q = poses(machine, 7)
    found = signals(machine, recording_of(machine, Rows(q, {}), information.home), ())
    assert found.names == information.names
    np.testing.assert_allclose(found.precision, information.weight**2)
    expected = gram(information.at(np.vstack([information.home, q])).signature)
    assert found.geometry.shape[1] == readings
    size = np.sqrt(np.einsum("cii->ci", expected)) + 1e-9
    shown = gram(found.geometry) / size[:, :, None] / size[:, None]
    np.testing.assert_allclose(shown, expected / size[:, :, None] / size[:, None], atol=1e-6)


def test_rows_say_of_effects_what_simulated_readings_say() -> None:
    """Readings with a thousandth of each coefficient's scale, without noise, in sigmas."""
    machine = arm()
    texts = ("joint-compliance@q2", "backlash@q2", "transmission-error@q3:order=2")
    parts = [part(text, machine) for text in texts]
    recording = recording_of(machine, rows_of(machine, poses(machine, 6)), PoseInformation(machine).home)
    found, none = signals(machine, recording, parts), simulate(machine, recording, seed=None).to_numpy()
    assert found.columns == (slice(0, 1), slice(1, 2), slice(2, 4))
    for effect, columns in zip(parts, found.columns, strict=True):
        for k, coefficient in enumerate(effect.coefficients):
            values = [0.0] * len(effect.coefficients)
            values[k] = 1e-3 * coefficient.scale
            read = simulate(machine, recording, [effect.with_values(values)], seed=None).to_numpy()
            moved = 1e3 * (read - none) / machine.channels[0].sigma
            shift = found.effects[:, :, columns.start + k]
            np.testing.assert_allclose(shift, moved, atol=2e-2 * np.max(np.abs(moved)))


def test_an_effect_of_the_file_that_is_in_question_is_asked_anew() -> None:
    machine = arm()
    own = part("joint-compliance@q2", machine)
    filed = machine.with_effects((own.with_values([3e-5]), part("backlash@q3", machine)))
    rows = recording_of(machine, rows_of(machine, poses(machine, 4)), PoseInformation(machine).home)
    assert signals(machine, rows, [own]).names == signals(filed, rows, [own]).names[:-1]
    assert signals(filed, rows, [own]).names[-1] == "backlash@q3:b"


def test_rows_that_cannot_be_assembled_and_those_held_back_tell_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also where a whole block of rows is none."""
    machine = exact()
    q = poses(machine, 9)
    far = q.copy()
    far[:4] = 1e5
    home = PoseInformation(machine).home
    whole = signals(machine, recording_of(machine, Rows(q, {}), home), ())
    monkeypatch.setattr("truepose.identification.prediction.predictor.BLOCK", 5)
    recording = recording_of(machine, Rows(far, {}), far[0])
    found = signals(machine, recording, ())
    assert not found.geometry[:5].any() and found.geometry.shape == whole.geometry.shape
    np.testing.assert_allclose(gram(found.geometry[5:]), gram(whole.geometry[5:]), rtol=1e-6, atol=1e-6)
    held = np.arange(10) == 7
    validation = signals(machine, replace(recording_of(machine, Rows(q, {}), home), validation=held), ())
    assert not validation.geometry[7].any() and validation.geometry[6].any() and validation.geometry[8].any()


def test_rows_have_no_past_but_their_own() -> None:
    """A joint came by a long move from its side; bodies have the temperatures of their thermometers."""
    machine, q = arm(), np.array([[0.0, 0.5, -0.2], [10.0, -0.3, 0.1]])
    drivers = {"approach.q2": np.array([1.0, -1.0]), "temperature.link2": np.array([20.0, 25.0])}
    found = recording_of(machine, Rows(q, drivers), np.zeros(3))

    def told(name: str) -> list[float] | None:
        values = found.driver(name)
        return None if values is None else values.tolist()[1:]

    assert told("temperature.link2~300") == told("temperature.link2") == [20.0, 25.0]
    assert told("stop.q2~0.01") == [0.01, -0.01]
    assert told("stop.q3~0.01") is None  # nobody says from where it came
    assert told("stop.q9~0.01") is None
    loop = told("loop.q2~0.5~-1~1")
    # the line of the whole loop has the slope 3 t^2 - 2 t^3, t the width's share of the range
    assert loop == pytest.approx([0.5 - 0.5 * 0.5, -0.5 + 0.5 * 0.3])
    assert found.from_row is not None and found.from_row.tolist() == [0, 0, 0] and found.shuffled
    assert found.session_recorded.all() and found.session.tolist() == [1, 1, 1] and found.time is None
