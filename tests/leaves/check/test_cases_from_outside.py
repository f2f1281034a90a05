"""Diagnoses of small recordings made by others, with what is right (truths of numpy, not of this project)."""

from __future__ import annotations

from pathlib import Path

import pytest

from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.leaves.check.run import check
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine


def diagnosed(shared: Path, folder: str, machine: str, recording: str) -> Diagnosis:
    """Diagnose a recording of the shared cases."""
    where = shared / "cases" / folder
    loaded = load_machine(where / f"{machine}.yaml")
    return diagnose(loaded, load_recording(loaded, [where / f"{recording}.csv"]))


def known(found: Diagnosis) -> set[tuple[str, str]]:
    """Return parts with the kind of driver that is known there."""
    return {(part, f.levels.kind) for f in found.findings for part in f.place if f.levels.driver >= 0.9}


def test_a_mill_without_a_fault_keeps_its_scale(shared: Path) -> None:
    found = diagnosed(shared, "mill-sockets", "mill", "no-fault")
    assert found.verdict == "adequate" and found.findings == ()
    assert any("common scale" in one.why for one in found.missing)
    assert all(e.effect.slug != "actuator-scale" for e in found.after.effects)


def test_a_screw_that_grows_is_heat_and_no_scale(shared: Path) -> None:
    found = diagnosed(shared, "mill-sockets", "mill", "heated")
    assert known(found) == {("X", "temperature")}
    (alpha,) = (q for f in found.findings for q in f.parameters.values())
    assert abs(alpha.value - 11.5e-6) < 3.0 * alpha.std < 6e-6  # 1/K, as it was put in


@pytest.mark.parametrize(("case", "part", "kind"), [("s_", "q1", "position"), ("", "q1", "arrival")])
def test_wrapped_readings_have_the_findings_of_signed_ones(
    shared: Path, case: str, part: str, kind: str
) -> None:
    wrapped, signed = (
        diagnosed(shared, "wrapped-readings", "nolim", f"{case}{name}") for name in ("wrapped", "signed")
    )
    assert known(wrapped) == known(signed) == {(part, kind)}
    pairs = zip(wrapped.findings, signed.findings, strict=True)
    assert all(a.effect == b.effect and abs(a.probability - b.probability) < 0.1 for a, b in pairs)


def test_masses_in_grams_and_whole_degrees_are_reported(shared: Path) -> None:
    mistakes, arm = shared / "cases" / "recorded-mistakes", shared / "cases" / "fanuc-arm"
    for machine, recording, kind in (
        (mistakes / "grams.yaml", arm / "rec_dh.csv", "mass-unit"),
        (mistakes / "pos.yaml", mistakes / "18_J3_whole_degrees.csv", "resolution"),
    ):
        loaded = load_machine(machine)
        assert kind in {f.kind for f in check(loaded, recording).found}
