"""A fit written as a machine file reads back as the same machine, whatever its kind, units and effects."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support import MACHINES
from support.exact_fits import fit_at
from support.exact_fits import read as read_exactly
from support.graph_machines import machine_of, spread
from support.moving_machines import record
from support.simulated import drawn_table, observed, poses_of
from truepose.errors import ReadBackError
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.write_machine import calibrated_document, write_calibrated
from truepose.identification.prediction.covariance import Covariance
from truepose.identification.recording.recording import Recording
from truepose.models.effect_text import parse_effect
from truepose.models.file.machine_file import machine_text
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.machine.seen import ranges_of_file

KINDS = ("serial", "pus", "ups", "distance")
EFFECTS = {
    "serial": ("joint-compliance@q2:c=3e-6", "encoder-eccentricity@q3:a=2e-4[rad],b=1e-4[rad]"),
    "pus": ("actuator-scale@rho4:s=8e-4", "thermal-expansion@base:alpha=2e-5[1/K],lag=300"),
    "ups": ("frame-shift@base:z=0.1[mm],session=1",),
    "distance": ("actuator-scale@x:s=5e-4",),
}


def rows(machine: Machine, n: int = 30) -> Recording:
    """Random poses with every driver, in two sessions, as a recording without readings."""
    rng = np.random.default_rng(6)
    table = drawn_table(
        machine,
        n,
        5,
        time=100.0 * np.arange(n),
        session=np.arange(n) // (n // 2) + 1,
        **{"temperature.air": rng.uniform(15, 25, n), "payload": rng.uniform(0, 5, n)},
    )
    return poses_of(machine, table)


def fitted(kind: str) -> tuple[Machine, Recording, Estimate]:
    machine = load_machine(MACHINES / f"{kind}.yaml")
    effects = tuple(parse_effect(text, machine) for text in EFFECTS[kind])
    recording = observed(machine, rows(machine), effects, seed=2)
    return machine, recording, estimate(machine, recording, effects)


@pytest.mark.parametrize("kind", KINDS)
def test_reads_back_as_the_same_machine(kind: str, tmp_path: Path) -> None:
    machine, recording, fit = fitted(kind)
    write_calibrated(tmp_path / "calibrated.yaml", fit, recording)
    again = load_machine(tmp_path / "calibrated.yaml")
    assert [p.name for p in again.parameters] == [p.name for p in machine.parameters]
    values = np.array([p.nominal for p in again.parameters])
    np.testing.assert_allclose(values, fit.p[: len(values)], rtol=1e-12, atol=1e-15)
    assert [p.tolerance for p in again.parameters] == pytest.approx([p.tolerance for p in machine.parameters])
    assert [e.label for e in again.effects] == [e.label for e in fit.effects]
    seen, payload = ranges_of_file(again).get("payload"), recording.drivers["payload"]
    assert seen == ((payload.min(), payload.max()) if any(e.needs_load for e in fit.effects) else None)
    amplitudes = [a for e in again.effects for a in e.amplitudes]
    np.testing.assert_allclose(amplitudes, fit.p[len(values) :], rtol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_keeps_the_drawing_the_sessions_and_the_covariance(kind: str, tmp_path: Path) -> None:
    machine, recording, fit = fitted(kind)
    write_calibrated(tmp_path / "calibrated.yaml", fit, recording)
    file = load_machine(tmp_path / "calibrated.yaml").file
    assert file is not None and file.covariance is not None
    assert file.nominal == {p.name: p.nominal for p in machine.parameters if p.free}
    assert file.sessions == (1, 2)
    covariance = Covariance.read(file.covariance, "test")
    assert covariance.names == tuple(fit.prior.names[k] for k in fit.prior.free)
    finite = ~np.any(np.abs(covariance.unknown) > 1e-9, axis=0) if len(covariance.unknown) else slice(None)
    std = np.sqrt(np.sum(covariance.factor**2, axis=1))
    np.testing.assert_allclose(std[finite], fit.std[fit.prior.free][finite], rtol=1e-6)


def test_a_second_calibration_keeps_the_first_drawing(tmp_path: Path) -> None:
    machine, recording, fit = fitted("serial")
    write_calibrated(tmp_path / "first.yaml", fit, recording)
    again = load_machine(tmp_path / "first.yaml")
    document = calibrated_document(estimate(again, recording, again.effects), recording)
    assert document["nominal"] == {p.name: p.nominal for p in machine.parameters if p.free}


def test_the_users_document_is_not_touched_and_its_fields_stay() -> None:
    machine, recording, fit = fitted("pus")
    assert machine.file is not None
    before = copy.deepcopy(machine.file.raw)
    document = calibrated_document(fit, recording)
    assert machine.file.raw == before
    added = {"effects", "covariance", "nominal", "sessions"}
    assert set(document) - added == set(before)
    assert document["tolerances"] == before["tolerances"]


def test_a_tool_that_a_shorthand_implies_is_written_out(tmp_path: Path) -> None:
    """Each of its six constants in its place, whatever a fit found of it."""
    machine = machine_of("hybrid")
    poses = record(machine, spread("hybrid", 6))
    size = len(machine.parameters)
    away = 1e-3 * np.random.default_rng(3).normal(size=size) * np.array([p.free for p in machine.parameters])
    fit = fit_at(machine, read_exactly(machine, poses, []), [], away)
    write_calibrated(tmp_path / "calibrated.yaml", fit, poses)
    again = load_machine(tmp_path / "calibrated.yaml")
    assert [p.name for p in again.parameters] == [p.name for p in machine.parameters]
    np.testing.assert_allclose([p.nominal for p in again.parameters], fit.p[:size], rtol=1e-9, atol=1e-12)
    tolerances = [p.tolerance for p in machine.parameters]
    np.testing.assert_allclose([p.tolerance for p in again.parameters], tolerances, rtol=1e-9, atol=1e-15)


def _series(document: dict[str, Any]) -> None:
    document["effects"][1] |= {"order": 20000}  # out of range


def _changed(*where: str | int, by: float = 1e-6) -> Callable[[dict[str, Any]], None]:
    """Return a change of one number of a document."""

    def change(document: dict[str, Any]) -> None:
        here: Any = document
        for key in where[:-1]:
            here = here[key]
        here[where[-1]] += by

    return change


FAULTS: dict[str, Callable[[dict[str, Any]], None]] = {
    "expected": _series,
    "q2.d": _changed("mechanism", "joints", 1, "d"),
    "joint-compliance@q2": _changed("effects", 0, "parameters", "c", "value", by=1e-12),
    "effects": lambda document: document["effects"].pop(),
    "+-": _changed("tolerances", "length"),
    "covariance": lambda document: document["covariance"]["names"].reverse(),
    "poses": _changed("masses", "link2", "kg", by=1.0),
    "cannot be read": lambda document: document["mechanism"]["joints"].pop(),
}


@pytest.mark.parametrize("told", FAULTS)
def test_a_text_that_holds_another_machine_is_not_published(
    told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is written, and what stood there stays, when the text cannot be read or reads as something else."""
    _, recording, fit = fitted("serial")

    def faulty(document: dict[str, Any], comment: str = "") -> str:
        FAULTS[told](document)
        return machine_text(document, comment)

    (tmp_path / "calibrated.yaml").write_text("as it was")
    monkeypatch.setattr("truepose.identification.fit.write_machine.machine_text", faulty)
    with pytest.raises(ReadBackError, match=f"^calibrated.yaml: what was to be written .*{re.escape(told)}"):
        write_calibrated(tmp_path / "calibrated.yaml", fit, recording)
    assert (tmp_path / "calibrated.yaml").read_text() == "as it was"
    assert [path.name for path in tmp_path.iterdir() if path.suffix != ".csv"] == ["calibrated.yaml"]
