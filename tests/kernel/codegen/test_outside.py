"""What lies outside of what the calibration saw: Python and the compiled C count alike, and notes say where. mm, rad."""

from __future__ import annotations

import ctypes
import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

import truepose
from support.command import invoke
from support.generated_c import Built, built_of, compile_library, needs_compiler
from support.searched_arm import SCALE, Case
from truepose.arrays import Array
from truepose.codegen.c import generate
from truepose.codegen.printer import Real
from truepose.errors import InputError
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predict import notes_outside, predict
from truepose.identification.recording.load import load_recording
from truepose.models.effect_text import parse_effect
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.seen import SeenRanges, values_of

SEEN = {
    "q1": [-1.0, 0.5],
    "q2": [0.25, 2.0],
    "q3": [-150.0, 10.0],
    "temperature.link1": [19.0, 26.0],
    "payload": [1.0, 4.0],
}
"""Of q2 its own motion."""
OF_THE_AIR = {"temperature.air": [25.0, 26.0]}
TEXT = """schema: truepose/machine/1
name: rail
gravity: [0, 0, -9.80665]
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-170, 170]}
    - {name: q2, kind: revolute, d: 325, range: [-170, 170], coupled: {q1: 0.5}}
    - {name: q3, kind: prismatic, alpha: 0.1, d: 275, range: [-300, 300]}
masses: {payload: {kg: 2, com: [0, 0, 50], in: tool}}
frames: {tool: {in: flange, xyz: [10, 0, 120]}}
drivers: [temperature.link1, temperature.air, payload]
sensor: {type: position, sigma: {xyz: 0.01}}
effects:
  - {effect: thermal-expansion, place: [link1], parameters: {alpha: {value: 1.2e-5, unit: 1/K}}}
  - {effect: joint-compliance, place: [q1], parameters: {c: {value: 1.0e-8, unit: rad/(N*m)}}}
  - {effect: air-refraction, place: [sensor], pressure: 0, parameters: {share: {value: 1.0, unit: "1"}}}
"""
BORDER = 1e-4
"""Halves of a range: nearer its ends single precision may count otherwise."""
places = st.lists(
    st.floats(-3.0, 3.0).filter(lambda t: abs(abs(t) - 1.0) > BORDER), min_size=len(SEEN), max_size=len(SEEN)
)


def machine_at(folder: Path, seen: object = SEEN | OF_THE_AIR, **changes: object) -> Machine:
    """The machine as a file that states these ranges; changes of its sections."""
    document = yaml.safe_load(TEXT) | changes
    document["covariance"] = {"names": [], "factor": [], **({} if seen is None else {"seen": seen})}
    (folder / "rail.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    return load_machine(folder / "rail.yaml")


@cache
def built(folder: Path, real: Real) -> Built:
    return built_of(machine_at(folder), folder / real, real)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("outside")


def counted(found: Built, q: Array, z: Array | None) -> int:
    """What the compiled function says."""
    given = [None if v is None else np.ascontiguousarray(v, dtype=found.dtype) for v in (z, q)]
    pointers = [None if v is None else v.ctypes.data_as(ctypes.c_void_p) for v in given]
    return int(getattr(found.library, f"{found.machine.name}_outside")(*pointers))


def sources_at(drivers: tuple[str, ...], shares: list[float]) -> tuple[Array, Array]:
    """Readings (nq,) and drivers (nz,) so many halves of their ranges off the middles; those of the air far off."""
    ends = np.array([*SEEN.values()])
    middle, half = ends.mean(axis=1), np.ptp(ends, axis=1) / 2
    values = dict(zip(SEEN, middle + half * np.array(shares), strict=True))
    q = np.array([values["q1"], values["q2"] + 0.5 * values["q1"], values["q3"]])
    return q, np.array([values.get(name, 99.0) for name in drivers])


@needs_compiler
@pytest.mark.parametrize("real", ["double", "float"])
@given(shares=places)
def test_python_and_c_count_what_lies_outside(folder: Path, real: Real, shares: list[float]) -> None:
    """A driver that sensors alone depend on does not count: the tool stands where it should."""
    found = built(folder, real)
    q, z = sources_at(found.model.drivers, shares)
    seen = SeenRanges.of(found.model)
    python = seen.outside(values_of(found.model, q[None], z[None])[:, seen.places])
    assert set(seen.names) == set(SEEN)
    assert counted(found, q, z) == np.sum(python) == np.sum(np.abs(shares) > 1.0)


@needs_compiler
def test_ends_are_inside_and_usual_drivers_and_nan_count(folder: Path) -> None:
    for real in ("double", "float"):
        found = built(folder, real)
        for shares in ([1.0] * len(SEEN), [-1.0] * len(SEEN)):
            assert counted(found, *sources_at(found.model.drivers, shares)) == 0
        inside, _ = sources_at(found.model.drivers, [0.0] * len(SEEN))
        assert counted(found, inside, None) == 0  # 20 degC and 2 kg
        assert counted(found, np.full(3, np.nan), None) == 3


@needs_compiler
@pytest.mark.parametrize("seen", [None, {}, {"payload": [1.0, 4.0], "q9": [0.0, 1.0]}])
def test_c_of_few_features_counts_what_is_known(tmp_path: Path, seen: dict[str, list[float]] | None) -> None:
    """The function is there in any case, with every warning an error; what the file does not state does not count."""
    machine = machine_at(tmp_path, seen)
    generate(machine, tmp_path / "c", features="warm")
    library = compile_library(tmp_path / "c", ["rail_kin.c"], "-O1")
    found = Built(machine, symbolic_model(machine, machine.effects), "double", tmp_path / "c", library)
    _, far = sources_at(found.model.drivers, [5.0] * len(SEEN))
    assert counted(found, np.full(3, 1e6), far) == (1 if seen else 0)


def test_ranges_that_are_none_are_refused_by_name(tmp_path: Path) -> None:
    machine = machine_at(tmp_path, {"q1": [2.0, 1.0]})
    with pytest.raises(InputError, match=r"rail\.yaml: covariance\.seen: .*2\.0 to 1\.0 is no range"):
        generate(machine, tmp_path / "c")
    assert not (tmp_path / "c").exists()


def path_of(rows: int = 12) -> pd.DataFrame:
    """Rows inside, of which the fifth, the eighth and the last lie outside: of q1 by its upper end, of the payload below."""
    rng = np.random.default_rng(3)
    q1, own, q3 = (rng.uniform(low, high, rows) for low, high in ([-0.9, 0.4], [0.3, 1.2], [-140, 0]))
    q1[[4, 11]] = 0.75, 1.0
    frame = pd.DataFrame({"q1 [rad]": q1, "q2 [rad]": own + 0.5 * q1, "q3 [mm]": q3})
    frame["temperature.link1"], frame["payload"] = 22.0, 2.0
    frame.loc[7, "payload"] = 0.5
    return frame


def in_other_units(frame: pd.DataFrame) -> pd.DataFrame:
    """The same rows in deg, m and g."""
    factors = {
        "q1 [rad]": ("q1 [deg]", 180 / np.pi),
        "q2 [rad]": ("q2 [deg]", 180 / np.pi),
        "q3 [mm]": ("q3 [m]", 1e-3),
    }
    factors["payload"] = ("payload [g]", 1e3)
    same = {name: (name, 1.0) for name in frame}
    return pd.DataFrame({new: frame[name] * f for name, (new, f) in (same | factors).items()})


def test_a_note_names_sources_rows_values_and_ranges(tmp_path: Path) -> None:
    machine, frame = machine_at(tmp_path), path_of()
    (note,) = truepose.compensate(machine, frame).notes
    assert note == (
        "3 of 12 rows lie outside of what the calibration saw, where effects are held or extrapolated: "
        "q1 up to 57.2958 deg (seen -57.2958 to 28.6479 deg) in 2, first at DataFrame: row 5; "
        "payload down to 0.5 kg (seen 1 to 4 kg) in 1, first at DataFrame: row 8"
    )
    assert truepose.compensate(machine, in_other_units(frame)).notes == (note,)
    in_mrad = machine_at(tmp_path, units={"length": "mm", "angle": "mrad"}, mechanism=_in_mrad())
    (other,) = truepose.compensate(in_mrad, frame).notes
    assert "q1 up to 1000 mrad (seen -1000 to 500 mrad) in 2, first at DataFrame: row 5" in other
    (one,) = truepose.compensate(machine, frame.iloc[:6]).notes
    assert one.startswith("1 of 6 rows lies outside")


def _in_mrad() -> object:
    mechanism = yaml.safe_load(TEXT)["mechanism"]
    for joint in mechanism["joints"][:2]:
        joint["range"] = [-2967.0, 2967.0]
    mechanism["joints"][2]["alpha"] = 1.745
    return mechanism


def test_commands_say_it_in_text_and_in_json(tmp_path: Path) -> None:
    machine_at(tmp_path)
    path_of().to_csv(tmp_path / "path.csv", index=False)
    files = [tmp_path / "rail.yaml", tmp_path / "path.csv", "-o", tmp_path / "out.csv"]
    for command, count in (["compensate", *files, "--anyway"], 3), (["predict", *files], 12):
        said = f"{count} of 12 rows lie outside"
        told = invoke(*command).stderr
        assert f"note: {said}" in told and f"first at {tmp_path / 'path.csv'}: row 5" in told
        assert ("temperature.air down to 20 degC" in told) == (
            count == 12
        )  # what is read of a tool, not where it stands
        (note,) = (text for text in json.loads(invoke(*command, "--json").stdout)["notes"] if said in text)
        assert note in told


@pytest.mark.parametrize("changes", [{"seen": None}, {"effects": []}, {"short": True}])
def test_nothing_is_said_where_nothing_is_known_or_all_is_inside(
    tmp_path: Path, changes: dict[str, object]
) -> None:
    """Nor of a machine without effects: it neither holds nor extrapolates any."""
    rows = 4 if changes.pop("short", False) else 12
    assert truepose.compensate(machine_at(tmp_path, **changes), path_of().iloc[:rows]).notes == ()


def test_joints_are_compared_by_their_own_motions(tmp_path: Path) -> None:
    """Readings of q2, which hold half of q1, leave the range: predictions are as sure as without ranges, without a note."""
    frame = pd.DataFrame({"q1 [rad]": [-0.9], "q2 [rad]": [0.3 - 0.45], "q3 [mm]": [0.0]})
    frame["temperature.link1"], frame["temperature.air"], frame["payload"] = 22.0, 25.5, 2.0
    machine = machine_at(tmp_path)
    rows = load_recording(machine, [frame], need_observations=False)
    assert notes_outside(machine, rows) == ()
    pd.testing.assert_frame_equal(predict(machine, rows), predict(machine_at(tmp_path, None), rows))


def test_a_fitted_file_has_seen_its_own_rows_and_no_more(tmp_path: Path) -> None:
    """What ``write_calibrated`` states is what the note goes by."""
    case = Case.of(tmp_path, SCALE)
    machine, recording = case.signatures.machine, case.signatures.recording
    fit = estimate(machine, recording, [parse_effect(SCALE, machine)])
    write_calibrated(tmp_path / "calibrated.yaml", fit, recording)
    written = load_machine(tmp_path / "calibrated.yaml")
    assert truepose.compensate(written, recording).notes == ()
    turned = replace(recording, q=recording.q + np.array([0.2, 0.0]))
    (note,) = truepose.compensate(written, turned).notes
    count = int(np.sum(turned.q[:, 0] > recording.q[:, 0].max() + 1e-6))
    assert note.startswith(f"{count} of {len(recording)} rows lie") and note.count("(seen") == 1
