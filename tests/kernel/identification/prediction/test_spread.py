"""The 1-sigma of a prediction, worked out from the derivatives of its columns by other code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support import MACHINES
from support.simulated import drawn_table, machine_from, poses_of
from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.prediction.predict import LEAST_RANGE, column_std, predictor_for
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prior import FORM_ERROR
from truepose.models.effect_text import parse_effect
from truepose.models.machine.machine import Machine

EFFECTS = """
drivers: [payload, temperature.link2]
effects:
  - {effect: actuator-scale, place: [q2], parameters: {s: {value: 1.0e-3, unit: '1', std: 2.0e-4}}}
  - {effect: thermal-expansion, place: [link2], parameters: {alpha: {value: 2.0e-5, unit: 1/K, std: 1.0e-6}}}
  - {effect: joint-compliance, place: [q2], parameters: {c: {value: 3.0e-6, unit: rad/(N*m)}}}
"""
SCALE, HEAT, LOAD = "actuator-scale@q2:s", "thermal-expansion@link2:alpha", "joint-compliance@q2:c"
COVARIANCE = {"names": ["q2.d", SCALE, "q3.r"], "factor": ["0.01", "1e-4 2e-4", "0.002 -0.001 0.03"]}


def machine_of(folder: Path, name: str = "serial", effects: str = EFFECTS) -> Machine:
    """An arm with a stated base, so that all constants are known to some tolerance, or another machine."""
    text = (MACHINES / f"{name}.yaml").read_text(encoding="utf-8") + effects
    return machine_from(folder, text, "machine")


def with_covariance(machine: Machine, covariance: Mapping[str, Any] | None) -> Machine:
    assert machine.file is not None
    return replace(machine, file=replace(machine.file, covariance=covariance))


def predictor_of(machine: Machine, columns: Mapping[str, Any] | None = None) -> Predictor:
    """At five places, with a payload and a temperature."""
    logged = {"payload": [0.0, 1.0, 2.0, 3.0, 4.0], "temperature.link2": [18.0, 20.0, 22.0, 24.0, 30.0]}
    table = drawn_table(machine, 5, 2, **logged).assign(**(columns or {}))
    return predictor_for(machine, poses_of(machine, table))


def found(machine: Machine, columns: Mapping[str, Any] | None = None) -> tuple[Array, Array, list[str]]:
    """1-sigmas (n, k), derivatives (n, k, np), and the names of p."""
    predictor = predictor_of(machine, columns)
    p = predictor.model.p_home
    _, values, jacobian, _ = predictor.columns(p, predictor.assemble(p)[0])
    return column_std(predictor, values, jacobian), jacobian, list(predictor.model.names)


def tolerances(machine: Machine, names: list[str]) -> Array:
    """As the file states them, effects by their ``std``."""
    stated = {p.name: p.tolerance for p in machine.parameters} | {SCALE: 2e-4, HEAT: 1e-6}
    return np.array([stated.get(name, 0.0) for name in names])


def test_without_a_covariance_tolerances_and_stds_count_as_independent(tmp_path: Path) -> None:
    machine = machine_of(tmp_path)
    std, jacobian, names = found(machine)
    np.testing.assert_allclose(std**2, (jacobian**2) @ tolerances(machine, names) ** 2)
    # the std of an effect that the file does not have in that place says nothing
    other = machine.with_effects((parse_effect("actuator-scale@q3:s=1e-3", machine), *machine.effects[:1]))
    std, jacobian, names = found(other)
    stated = [tolerances(machine, [name])[0] if "@" not in name else 0.0 for name in names]
    stated[names.index("actuator-scale@q3:s")] = 2e-4  # the first of the file, which is of the same kind
    np.testing.assert_allclose(std**2, (jacobian**2) @ np.array(stated) ** 2)


def test_what_a_covariance_names_it_says_and_of_the_rest_tolerances(tmp_path: Path) -> None:
    machine = with_covariance(machine_of(tmp_path), COVARIANCE)
    std, jacobian, names = found(machine)
    sigma = tolerances(machine, names)
    at = [names.index(name) for name in COVARIANCE["names"]]
    sigma[at] = 0.0
    factor = np.array([[0.01, 0, 0], [1e-4, 2e-4, 0], [0.002, -0.001, 0.03]])
    known = np.einsum("nki,ij,nkj->nk", jacobian[..., at], factor @ factor.T, jacobian[..., at])
    np.testing.assert_allclose(std**2, known + (jacobian**2) @ sigma**2)


def test_a_covariance_of_another_machine_is_refused(tmp_path: Path) -> None:
    machine = with_covariance(machine_of(tmp_path), {"names": ["q2.d", "q9.d"], "factor": ["1", "0 1"]})
    with pytest.raises(InputError, match=r"machine.yaml: covariance\.names: found 'q9\.d', no parameter"):
        found(machine)


def test_what_no_parameter_explains_is_added_by_kind_of_reading(tmp_path: Path) -> None:
    """Of each sensor, in mm to its lengths and in rad to its turns; where a column shows nothing there is nothing."""
    plain = machine_of(tmp_path, "hybrid", "")
    base = {"names": ["tool.x"], "factor": ["0.01"]}
    own = {
        "sensor.position": {"value": 0.3, "unit": "mm"},
        "sensor.rotation": {"value": 0.004, "unit": "rad"},
    }
    rng = np.random.default_rng(4)
    for told, added in (
        ({}, [0.0] * 6),
        (own, [0.3] * 3 + [0.004] * 3),
        ({"sensor.rotation": own["sensor.rotation"]}, [0.0] * 3 + [0.004] * 3),
        ({"other.position": own["sensor.position"]}, [0.0] * 6),
    ):
        machine = with_covariance(plain, {**base, "unexplained": told})
        predictor = predictor_of(machine)
        p = predictor.model.p_home
        _, values, jacobian, _ = predictor.columns(p, predictor.assemble(p)[0])
        jacobian = np.zeros(jacobian.shape)
        jacobian[:, :, predictor.model.names.index("tool.x")] = rng.normal(size=values.shape)
        jacobian[2, 4] = 0.0
        expected = np.sum((0.01 * jacobian) ** 2, axis=2) + np.array(added) ** 2
        expected[2, 4] = 0.0
        np.testing.assert_allclose(column_std(predictor, values, jacobian) ** 2, expected, atol=1e-18)


def beyond(machine: Machine, seen: Mapping[str, list[float]]) -> tuple[Array, Array, list[str]]:
    """Variance (n, k) added by ranges that were seen, derivatives, and names."""
    with_ranges = with_covariance(machine, {**COVARIANCE, "seen": seen})
    std, jacobian, names = found(with_ranges)
    plain, *_ = found(with_covariance(machine, COVARIANCE))
    return std**2 - plain**2, jacobian, names


@pytest.mark.parametrize(
    ("seen", "name", "value", "over"),
    [
        ({"temperature.link2": [19.0, 23.0]}, HEAT, 2e-5, [0.5, 0.0, 0.0, 0.5, 3.5]),
        ({"temperature.link2": [18.0, 30.0]}, HEAT, 2e-5, [0.0] * 5),
        ({"payload": [1.0, 2.0]}, LOAD, 3e-6, [2.0, 0.0, 0.0, 2.0, 4.0]),
        (
            {"payload": [2.0, 2.0]},
            LOAD,
            3e-6,
            [2.0 / LEAST_RANGE - 1.0] * 2 + [0.0] + [1.0 / LEAST_RANGE - 1.0] * 2,
        ),
    ],
)
def test_out_of_what_was_seen_an_effect_is_off_by_a_share_of_its_signal(
    tmp_path: Path, seen: dict[str, list[float]], name: str, value: float, over: list[float]
) -> None:
    """Held at the end of its range: 2 (1 - exp(-overshoot)) of the square of the error of form."""
    added, jacobian, names = beyond(machine_of(tmp_path), seen)
    signal = FORM_ERROR * value * jacobian[:, :, names.index(name)]
    expected = 2.0 * (1.0 - np.exp(-np.array(over)))[:, None] * signal**2
    np.testing.assert_allclose(added, expected, rtol=1e-6, atol=1e-9 * np.max(signal**2))


def test_several_sources_out_of_what_was_seen_add_up(tmp_path: Path) -> None:
    """Joints count for every effect, and each driver for those that read it."""
    columns = {"q2 [rad]": [0.0, 0.1, 0.2, 0.3, 0.4], "q3 [rad]": [0.5] * 5}
    seen = {"q2": [0.0, 0.2], "temperature.link2": [20.0, 22.0], "payload": [0.0, 2.0], "unknown": [0.0, 1.0]}
    machine = with_covariance(machine_of(tmp_path), {**COVARIANCE, "seen": seen})
    std, jacobian, names = found(machine, columns)
    plain, *_ = found(with_covariance(machine, COVARIANCE), columns)
    turned, warm, loaded = (
        np.array(v, dtype=float) for v in ([0, 0, 0, 1, 2], [2, 0, 0, 2, 8], [0, 0, 0, 1, 2])
    )
    expected = np.zeros(std.shape)
    for name, value, over in (
        (SCALE, 1e-3, turned), (HEAT, 2e-5, turned + warm), (LOAD, 3e-6, turned + loaded),
    ):  # fmt: skip
        signal = FORM_ERROR * value * jacobian[:, :, names.index(name)]
        expected += 2.0 * (1.0 - np.exp(-over))[:, None] * signal**2
    np.testing.assert_allclose(std**2 - plain**2, expected, rtol=1e-6, atol=1e-12)
