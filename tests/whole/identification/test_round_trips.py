"""Whatever truepose writes, it reads: settings of every candidate, and machines that hold them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.effect_machines import TEXTS, Machines, read_machines
from support.exact_fits import fit_at, posed, read
from support.examples import by_day
from support.results import machine, recording
from support.round_trips import check_round_trip
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.write_machine import calibrated_text, effect_entry
from truepose.identification.prediction.predict import simulate
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import catalogue
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.transmission_error import TransmissionError
from truepose.models.file.effect_entry import read_effects
from truepose.models.file.yaml_document import document_text, parse_document
from truepose.models.load import place_effect
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import HARMONIC

ROWS = 40


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Machines:
    return read_machines(tmp_path_factory.getbasetemp() / "round_trips")


def varied(machine: Machine) -> Recording:
    """Random poses in two sessions, in which all that effects read varies; the clock counts nanoseconds since 1970."""
    rng = np.random.default_rng(5)
    n = np.arange(ROWS)
    told: dict[str, Any] = {"pose": n, "time": 1.8e18 + 1e12 * n, "session": n // (ROWS // 2)}
    if any(sensor.differs_from_row for sensor in machine.sensors):
        told["from"] = np.maximum(n - 1, 0)
    for name in ("temperature.air", "temperature.base", "pressure", "humidity", "payload"):
        told[name] = rng.uniform(5, 25, ROWS)
    for actuator in machine.mechanism.actuators:
        low, high = actuator.range or (-1.0, 1.0)
        unit = actuator.reading_unit
        told[f"{actuator.reading} [{unit}]"] = rng.uniform(low, high, ROWS)
        told[f"velocity.{actuator.reading}"] = rng.normal(0.0, 1.0, ROWS)
    return load_recording(machine, told, need_observations=False)


def reread(machine: Machine, effects: tuple[PlacedEffect, ...]) -> tuple[PlacedEffect, ...]:
    """Write effects as the entries of a machine file and read the text."""
    std = {name: 0.0 for effect in effects for name in effect.parameter_names}
    text = document_text({"effects": [effect_entry(effect, std) for effect in effects]})
    entries = read_effects(parse_document(text, "again.yaml")["effects"], Path("again.yaml"))
    return tuple(place_effect(machine, entry, entry.where) for entry in entries)


def said(effects: tuple[PlacedEffect, ...]) -> list[dict[str, Any]]:
    """All fields of effects, their classes by name: each reading makes objects of its own."""
    return [{**vars(effect), "effect": effect.effect.slug, "label": effect.label} for effect in effects]


@pytest.mark.parametrize("name", TEXTS)
def test_every_candidate_is_read_as_it_was_written(name: str, machines: Machines) -> None:
    machine, rng = machines[name], np.random.default_rng(1)
    found = catalogue(machine, varied(machine)).candidates
    assert len(found) > 10
    sized = tuple(c.with_values([k.scale * rng.normal() for k in c.coefficients]) for c in found)
    assert said(reread(machine, sized)) == said(sized)


@pytest.mark.parametrize(("first", "last"), [(1.0, 60.0), (61.0, 90.0), (121.0, HARMONIC.high)])
def test_a_series_is_read_as_it_was_written(first: float, last: float, machines: Machines) -> None:
    made = PlacedEffect.at(TransmissionError(), machines["arm"], ("q1",), {"first": first, "orders": last})
    assert said(reread(machines["arm"], (made,))) == said((made,))


def test_a_fit_with_a_series_above_the_catalogue_s_is_read_and_generated(
    machines: Machines, tmp_path: Path
) -> None:
    machine = machines["arm"]
    waves = PlacedEffect.at(TransmissionError(), machine, ("q1",), {"first": 61.0, "orders": 90.0})
    waves = waves.with_values([c.scale for c in waves.coefficients])
    poses = varied(machine)
    told = simulate(machine, poses, [waves], seed=2)
    rows = poses.to_frame().reset_index(drop=True).assign(**{str(name): told[name] for name in told})
    check_round_trip(estimate(machine, load_recording(machine, rows), [waves]), tmp_path)


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["nanopositioner", "polisher"])
def test_a_diagnosed_demo_is_the_machine_of_its_file(name: str, tmp_path: Path) -> None:
    """Distances from row to row, and loops; the telescope's is in ``tests/whole/shown/test_fitted.py``."""
    check_round_trip(diagnose(machine(name), recording(name)), tmp_path)


@pytest.mark.parametrize(
    "name", by_day(sorted(TEXTS.keys() - {"cavity"}), *TEXTS.keys() - {"planar", "hybrid"})
)  # its readings are changes, and these poses no order
def test_a_file_is_the_model_that_was_fitted(name: str, machines: Machines, tmp_path: Path) -> None:
    """With every effect of the catalogue, and constants far from the drawing: formulas hold none of the file's values."""
    machine, rng, kept = machines[name], np.random.default_rng(3), dict[str, int]()
    terms = list[PlacedEffect]()
    for candidate in catalogue(machine, posed(machine)).candidates:
        slug, amplitudes = candidate.effect.slug, [0.2 * c.scale for c in candidate.coefficients]
        kept[slug] = kept.get(slug, 0) + 1
        if kept[slug] <= 2 and len(amplitudes) <= 24:
            terms.append(candidate.with_values(amplitudes))
    sigma = np.array([p.tolerance if p.tolerance < np.inf else 0.0 for p in machine.parameters])
    away = np.concatenate(
        [sigma * rng.normal(size=len(sigma)), np.zeros(sum(len(t.coefficients) for t in terms))]
    )
    recording = read(machine, posed(machine), terms)
    fit = fit_at(machine, recording, terms, away)
    text, again = calibrated_text(tmp_path / "calibrated.yaml", fit, recording)  # which compares predictions
    assert said(again.effects) == said(fit.fitted_effects())
    assert text == calibrated_text(tmp_path / "calibrated.yaml", fit, recording)[0]
