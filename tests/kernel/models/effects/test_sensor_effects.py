"""Effects of the sensors themselves: their signatures, what a fit makes of them, and what they must leave alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from support.sensor_bench import TEXTS, Bench
from support.simulated import machine_from
from truepose.errors import InputError
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.fit.estimate import estimate
from truepose.identification.prediction.predict import simulate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

CASES = {
    "arm": (
        "sensor-scale@sensor:s=2e-4",
        "air-refraction@sensor:share=1",
        "air-refraction@sensor:share=0.8,temperature=1,pressure=0",
        "air-refraction@sensor:share=0.8,temperature=0,pressure=1",
        "sensor-periodic@sensor:axis=1,order=1,a=3e-5,b=-2e-5",
        "sensor-periodic@sensor:axis=1,order=2,a=3e-5,b=2e-5",
        "sensor-periodic@sensor:axis=2,order=1,a=1e-4,b=1e-4",
        "sensor-periodic@sensor:axis=2,order=2,a=1e-4,b=-1e-4",
        "latency@sensor:tau=0.004",
    ),
    "telescope": (
        "sensor-scale@sensor:s=-3e-4",
        "target-offset@P3:x=0.03,y=-0.02,z=0.05",
        "lens-distortion@sensor:terms=1,k1=2e-3",
        "lens-distortion@sensor:terms=2,k1=4e-3,k2=-8e-3",
        "air-refraction@sensor:share=1",
        "latency@sensor:tau=-0.01",
    ),
    "stage": (
        "sensor-scale@sensor:s=5e-4",
        "sensor-periodic@sensor:order=1,a=8e-6,b=-6e-6",
        "sensor-periodic@sensor:order=2,a=-5e-6,b=4e-6",
        "air-refraction@sensor:share=1",
        "latency@sensor:tau=0.002",
    ),
}
EVERY = [(name, text) for name, texts in CASES.items() for text in texts]
FAINT = {"stage": ("air-refraction@sensor:share=1",), "telescope": ("air-refraction@sensor:share=1",)}
"""What cannot be seen at this noise: half a millimetre of air, and dn times half a metre, are less than the noise."""


@pytest.fixture(scope="module")
def benches(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Bench]:
    return {name: Bench(tmp_path_factory.mktemp(name), name) for name in TEXTS}


# -- signatures and fits -------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "text"), [e for e in EVERY if e[1] not in FAINT.get(e[0], ())])
def test_a_fit_finds_the_truth_within_its_uncertainty(
    benches: Mapping[str, Bench], name: str, text: str
) -> None:
    bench = benches[name]
    true = bench.placed(text)
    fit = estimate(bench.machine, bench.recording(text), (true.with_values([0.0] * len(true.coefficients)),))
    std = fit.std[-len(true.coefficients) :]
    off = np.array(fit.fitted_effects()[0].amplitudes) - true.amplitudes
    assert np.all(abs(off) < 4 * std)
    assert np.linalg.norm(true.amplitudes) > 4 * np.linalg.norm(std)
    freedom = fit.n_observations - fit.effective_parameters
    assert abs(fit.chi2 - freedom) < 4 * np.sqrt(2 * freedom)


# -- what the formulas say -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", TEXTS)
def test_a_scale_stretches_every_reading_alike(benches: Mapping[str, Bench], name: str) -> None:
    bench, rows = benches[name], benches[name].rows()
    plain = simulate(bench.machine, rows, seed=None)
    scaled = simulate(bench.machine, rows, [bench.placed("sensor-scale@sensor:s=1e-3")], seed=None)
    top = float(plain.abs().to_numpy().max())
    np.testing.assert_allclose(scaled, 1.001 * plain, rtol=0, atol=1e-12 * top)


def test_a_periodic_error_comes_back_after_half_a_wavelength(benches: Mapping[str, Bench]) -> None:
    """Along the beam: a step of half a wavelength changes nothing of the error, a quarter turns it round."""
    bench = benches["stage"]
    (sensor,) = bench.machine.sensors
    half = 1.56e-3 / 2
    frame = pd.DataFrame({"pose": range(4), "from": [0, 0, 0, 0], "x [mm]": 0.0})
    frame["y [mm]"] = [0.0, half, half / 2, half / 4]
    frame["t [rad]"] = 0.0
    axis = {"x [mm]": "y [mm]", "y [mm]": "x [mm]"}
    moved = []
    for columns in ({}, axis):
        path = bench.folder / "steps.csv"
        frame.rename(columns=columns).to_csv(path, index=False)
        rows = load_recording(bench.machine, [path], need_observations=False)
        placed = bench.placed("sensor-periodic@sensor:order=1,a=2e-5")
        plain, wavy = (simulate(bench.machine, rows, e, seed=None)["dL"] for e in ([], [placed]))
        if abs(plain[1]) > 0.9 * 1e3 * half:  # the axis along the beam
            moved.append((wavy - plain).to_numpy() / 1e3)
    (error,) = moved
    assert error[1] == pytest.approx(0, abs=1e-10)
    assert abs(error[2:]).max() > 1e-6
    assert sensor.type == "distance"


def test_air_shortens_where_it_is_warm_and_lengthens_where_it_is_dense(benches: Mapping[str, Bench]) -> None:
    bench = benches["arm"]
    frame = bench.drivers.iloc[[0, 0, 0]].copy()
    frame["temperature.air"], frame["pressure [hPa]"] = [20.0, 21.0, 20.0], [1013.25, 1013.25, 1014.25]
    frame.to_csv(bench.folder / "air.csv", index=False)
    rows = load_recording(bench.machine, [bench.folder / "air.csv"], need_observations=False)
    plain, air = (
        simulate(bench.machine, rows, e, seed=None).to_numpy()
        for e in ([], [bench.placed("air-refraction@sensor:share=1")])
    )
    strain = np.sum((air - plain) * plain, axis=1) / np.sum(plain**2, axis=1)
    np.testing.assert_allclose(strain, [0.0, -0.92e-6, 0.266e-6], atol=1e-8)


def test_refractivity_is_that_of_standard_air() -> None:
    """Ciddor's dispersion of standard air at 15 degC, thinned by the ideal gas law to 20 degC."""
    from truepose.models.effects.air_refraction import REFRACTIVITY

    for wavelength in (0.633, 1.55):
        wave = wavelength**-2
        standard = 0.05792105 / (238.0185 - wave) + 0.00167917 / (57.362 - wave)
        assert standard * 288.15 / 293.15 == pytest.approx(REFRACTIVITY, rel=0.01)


def test_a_late_sensor_sees_where_the_joints_stood(benches: Mapping[str, Bench]) -> None:
    bench, tau = benches["arm"], 0.004
    late = simulate(bench.machine, bench.rows(), [bench.placed(f"latency@sensor:tau={tau}")], seed=None)
    frame = bench.drivers
    for name in bench.machine.mechanism.readings:
        frame[f"{name} [rad]"] -= tau * frame[f"velocity.{name} [rad/s]"]
    frame.to_csv(bench.folder / "earlier.csv", index=False)
    rows = load_recording(bench.machine, [bench.folder / "earlier.csv"], need_observations=False)
    np.testing.assert_allclose(late, simulate(bench.machine, rows, seed=None), atol=1e-6)


def test_a_lens_moves_points_across_its_axis_only(benches: Mapping[str, Bench]) -> None:
    bench, k1 = benches["telescope"], 1e-3
    placed = bench.placed(f"lens-distortion@sensor:terms=1,k1={k1}")
    plain, seen = (simulate(bench.machine, bench.rows(), e, seed=None) for e in ([], [placed]))
    for point in ("P1", "P4"):
        x, y, z = (plain[f"{point}.{axis}"] for axis in "xyz")
        factor = 1 + k1 * (x**2 + y**2) / z**2
        np.testing.assert_allclose(seen[f"{point}.x"], factor * x, atol=1e-9)
        np.testing.assert_allclose(seen[f"{point}.y"], factor * y, atol=1e-9)
        np.testing.assert_allclose(seen[f"{point}.z"], z, atol=1e-12)


def test_an_encoder_of_a_tracker_moves_points_across_the_line_of_sight(benches: Mapping[str, Bench]) -> None:
    bench = benches["arm"]
    for axis, order in ((1, 1), (1, 2), (2, 1), (2, 2)):
        placed = bench.placed(f"sensor-periodic@sensor:axis={axis},order={order},a=1e-5,b=2e-5")
        plain, seen = (simulate(bench.machine, bench.rows(), e, seed=None).to_numpy() for e in ([], [placed]))
        x, y, z = plain.T
        azimuth, height = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
        angle = azimuth if axis == 1 else height
        error = 1e-5 * np.sin(order * angle) + 2e-5 * np.cos(order * angle)
        azimuth, height = (azimuth + error, height) if axis == 1 else (azimuth, height + error)
        r = np.linalg.norm(plain, axis=1)
        cone = r * np.cos(height)
        turned = np.column_stack([cone * np.cos(azimuth), cone * np.sin(azimuth), r * np.sin(height)])
        np.testing.assert_allclose(seen, turned, atol=2e-6)  # of second order: 2 m * (3e-5)^2


# -- places, drivers, settings -------------------------------------------------------------------------


def test_sensors_are_numbered_where_there_are_several(tmp_path: Path) -> None:
    text = TEXTS["arm"].replace("NAME", "arm")
    head, _, _ = text.partition("sensor:")
    both = "sensor:\n  - {type: position, sigma: {xyz: 0.01}}\n  - {type: ballbar, centre: [0, 0, 0], ball: [0, 0, 9]"
    machine = machine_from(tmp_path, f"{head}{both}, sigma: {{distance: 0.001}}}}\n", "m")
    places = {
        slug: effects.get(slug, "test")().places(machine) for slug in ("sensor-scale", "air-refraction")
    }
    assert places == {
        "sensor-scale": [("sensor1",), ("sensor2",)],
        "air-refraction": [("sensor1",)],
    }
    assert effects.get("latency", "test")().places(machine) == [("sensor1", "sensor2")]
    bar = PlacedEffect.at(effects.get("sensor-scale", "test")(), machine, ("sensor3",))
    with pytest.raises(InputError, match=r"found 'sensor3' on arm, expected one of sensor1, sensor2"):
        symbolic_model(machine, [bar])


def test_weather_that_was_logged_decides_the_settings(benches: Mapping[str, Bench]) -> None:
    bench, effect = benches["arm"], effects.get("air-refraction", "test")()
    both = effect.settings(bench.machine, ("sensor",), bench.rows())
    warm = effect.settings(bench.machine, ("sensor",), bench.rows("pressure"))
    none = effect.settings(bench.machine, ("sensor",), bench.rows("pressure", "temperature"))
    assert [tuple(s.values()) for s in both] == [(1.0, 1.0), (1.0, 0.0), (0.0, 1.0)]
    assert [tuple(s.values()) for s in warm] == [(1.0, 0.0)]
    assert [effect.drivers(bench.machine, ("sensor",), s) for s in (*warm, *none)] == [
        ("temperature.air",),
        ("temperature.air", "pressure"),
    ]


def test_joints_that_stand_still_do_not_hide_a_latency(benches: Mapping[str, Bench]) -> None:
    bench, effect = benches["arm"], effects.get("latency", "test")()
    (all_move,) = effect.settings(bench.machine, ("sensor",), bench.rows())
    (some,) = effect.settings(bench.machine, ("sensor",), bench.rows("velocity.q2", "velocity.q6"))
    (none,) = effect.settings(bench.machine, ("sensor",), bench.rows("velocity"))
    assert (all_move, none) == ({}, {})
    assert some == {"still.q2": 1.0, "still.q6": 1.0}
    drivers = effect.drivers(bench.machine, ("sensor",), some)
    assert drivers == ("velocity.q1", "velocity.q3", "velocity.q4", "velocity.q5")


# -- diagnosis -----------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_a_diagnosis_names_a_target_off_its_place(benches: Mapping[str, Bench]) -> None:
    bench = benches["telescope"]
    found = diagnose(bench.machine, bench.recording("target-offset@P3:x=0.02,y=-0.015,z=0.01"))
    assert [(f.effect, f.place) for f in found.findings] == [("target-offset", ("P3",))]
    (finding,) = found.findings
    for name, value in (("x", 0.02), ("y", -0.015), ("z", 0.01)):
        quantity = finding.parameters[name]
        assert abs(quantity.value - value) < 4 * quantity.std


Array = NDArray[np.float64]


def _values(machine: Machine, recording: Recording, placed: PlacedEffect) -> Array:
    """(n, k) columns that are predicted with the coefficients of the effect as they stand."""
    predictor = Predictor(machine, recording, (placed,))
    p = predictor.model.p_home
    x, good = predictor.assemble(p)
    assert good.all()
    return predictor.columns(p, x)[1]


@pytest.mark.parametrize("name", TEXTS)
def test_a_signature_is_the_change_of_the_reading(benches: Mapping[str, Bench], name: str) -> None:
    bench = benches[name]
    placed = [bench.placed(text).with_values([0.0] * 9) for text in CASES[name]]
    placed = [replace(e, amplitudes=(0.0,) * len(e.coefficients)) for e in placed]
    recording = bench.recording(seed=None)
    start = np.array([p.nominal for p in bench.machine.parameters])
    fit = estimate(bench.machine, recording, start=start)
    fit = replace(fit, p=start)  # nothing to be found: exactly the drawing
    signatures = Signatures(bench.machine, recording, placed)
    sigma = np.array([c.sigma for s in bench.machine.sensors for c in s.channels])
    ((_, _, found),) = list(signatures.rows(fit))
    column = 0
    for effect in placed:
        for k, c in enumerate(effect.coefficients):
            h = np.eye(len(effect.coefficients))[k] * 1e-3 * c.scale
            plus, minus = (_values(bench.machine, recording, effect.with_values(s * h)) for s in (1, -1))
            slope = (plus - minus) / (2e-3 * sigma)
            top = float(np.max(abs(slope)))
            assert top > 0
            # differences of lengths of 1 m known to 1e-13 of themselves, moved by 1e-3 of a scale
            np.testing.assert_allclose(
                found[:, :, column], slope, atol=1e-5 * top + 1e-6, err_msg=str(effect)
            )
            column += 1
