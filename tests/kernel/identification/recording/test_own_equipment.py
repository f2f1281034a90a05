"""Recordings with a tool, a payload and a date of their own, as the machine file says: against machines that have them.

Readings come from an arm in plain numpy (``support.pushed_arm``).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import truepose
from support.command import input_error
from support.machine_texts import machine_from
from support.pushed_arm import RANGES, SENSOR, TOOL, G, held, placed, sensor_turn, text
from truepose.api import calibrate
from truepose.arrays import Array
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.load import load_checked
from truepose.identification.prediction.predict import predict
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

JOINTS = [f"q{k}" for k in range(1, 7)]
SOFT = np.array([0.0, 3e-6, 4e-6, 0.0, 0.0, 0.0])  # rad/(N m)
DOWN = [0.0, 0.0, -G]
PAYLOAD = "  payload: {kg: 2, com: [0, 10, 40], in: tool}\n"
OFF = {
    "q2.d": 0.1,
    "q3.r": -0.1,
    "q4.theta": 3e-4,
    "q3.theta": -2e-4,
    "tool.x": 3.0,
    "tool.y": -2.0,
    "tool.z": 1.0,
}


def machine_of(folder: Path, more: str = "", **written: Any) -> Machine:
    return machine_from(folder, text(force="", more=more, **written), "arm")


def joints(n: int, seed: int) -> Array:
    low, high = np.radians(RANGES).T
    return np.random.default_rng(seed).uniform(low, high, (n, 6))


def table(q: Array, read: Array | None = None) -> dict[str, Array]:
    out = dict(zip(JOINTS, np.degrees(q).T, strict=True))
    return out if read is None else out | dict(zip("xyz", read.T, strict=True))


def measured(q: Array, longer: float, seed: int) -> dict[str, Array]:
    """Readings of an arm that is off the drawing, with a tip so much longer than its tool."""
    off = OFF | {"tool.z": OFF["tool.z"] + longer}
    read = np.array([placed(row, off).tool.real for row in q])
    return table(q, read + 0.02 * np.random.default_rng(seed).standard_normal(read.shape))


def files(folder: Path, **tables: dict[str, Array]) -> list[Path]:
    out = []
    for name, rows in tables.items():
        out.append(folder / f"{name}.csv")
        pd.DataFrame(rows).to_csv(out[-1], index=False)
    return out


def compliant(machine: Machine) -> list[PlacedEffect]:
    effect = effects.get("joint-compliance", "test")()
    each = zip(JOINTS, SOFT, strict=True)
    return [PlacedEffect.at(effect, machine, (name,), {}, {"c": c}) for name, c in each if c]


# -- one model holds all tools and payloads ------------------------------------------------------------


@pytest.mark.parametrize(
    ("own", "alone"),
    [
        ("{in: tool, xyz: [0, 0, 50]}", "{in: flange, xyz: [0, 30, 210], tolerance: {xyz: 1, rpy: 1}}"),
        (
            "{xyz: [40, 0, 90], rpy: [10, -20, 150]}",
            "{in: flange, xyz: [40, 0, 90], rpy: [10, -20, 150], tolerance: {xyz: 1, rpy: 1}}",
        ),
    ],
    ids=["longer", "another"],
)
def test_rows_of_a_recording_have_its_own_tool(tmp_path: Path, own: str, alone: str) -> None:
    q = joints(5, 1)
    one, other = files(tmp_path, monday=table(q), tuesday=table(q))
    tolerance = ", tolerance: {xyz: 1, rpy: 1}"
    machine = machine_of(
        tmp_path, f"recordings: {{long: {{files: tues*.csv, tool: {own}}}}}\n", tool=tolerance
    )
    usual = machine_of(tmp_path, tool=tolerance)
    stated = text(force="", tool=tolerance).replace(f"{{in: flange, xyz: {TOOL.tolist()}{tolerance}}}", alone)
    changed = machine_from(tmp_path, stated, "alone")

    def seen(machine: Machine, *paths: Path) -> tuple[Array, Array]:
        predictor = Predictor(machine, load_recording(machine, list(paths), need_observations=False))
        _, values, slopes, _ = predictor.columns(predictor.model.p_home, np.zeros((5 * len(paths), 0)))
        return values, slopes

    values, slopes = seen(machine, one, other)
    for rows, expected in ((slice(0, 5), seen(usual, one)), (slice(5, 10), seen(changed, other))):
        np.testing.assert_allclose(values[rows], expected[0], atol=1e-9)
        geometry = [k for k, p in enumerate(machine.parameters) if not p.name.startswith("tool.")]
        np.testing.assert_allclose(slopes[rows][..., geometry], expected[1][..., geometry], atol=1e-8)
    if "in: tool" in own:  # what is unknown of the tool is so of the longer one
        at = [k for k, p in enumerate(machine.parameters) if p.name in ("tool.x", "tool.y", "tool.z")]
        np.testing.assert_allclose(slopes[5:][..., at], seen(changed, other)[1][..., at], atol=1e-8)
        turn = [k for k, p in enumerate(machine.parameters) if p.name == "tool.rx"]
        np.testing.assert_allclose(np.linalg.norm(slopes[5:][..., turn], axis=1), 50.0)  # mm/rad, its lever


def test_rows_of_a_recording_carry_its_own_payload(tmp_path: Path) -> None:
    q = joints(5, 2)
    one, other = files(tmp_path, monday=table(q), tuesday=table(q))
    entry = "recordings: {heavy: {files: tuesday.csv, payload: {kg: 6, com: [0, -20, 90]}}}\n"
    weights = str(DOWN)
    machine = machine_of(tmp_path, PAYLOAD + entry, gravity=weights)
    usual = machine_of(tmp_path, PAYLOAD, gravity=weights)
    heavy = machine_of(tmp_path, "  payload: {kg: 6, com: [0, -20, 90], in: tool}\n", gravity=weights)

    def poses(machine: Machine, *paths: Path) -> Array:
        recording = load_recording(machine, list(paths), need_observations=False)
        predictor = Predictor(machine, recording, compliant(machine))
        return predictor.poses(predictor.model.p_home)[0]

    both = poses(machine, one, other)
    np.testing.assert_allclose(both[:5], poses(usual, one), atol=1e-10)
    np.testing.assert_allclose(both[5:], poses(heavy, other), atol=1e-10)
    assert np.abs(both[5:] - poses(usual, other)).max() > 0.01


def test_a_payload_column_is_that_of_the_other_files(tmp_path: Path) -> None:
    q = joints(3, 2)
    columns = table(q) | {"payload": np.array([1.0, 2.0, 3.0])}
    paths = files(tmp_path, monday=columns, tuesday=table(q), friday=table(q))
    entry = "recordings: {heavy: {files: tuesday.csv, payload: {kg: 6}}}\n"
    machine = machine_of(tmp_path, PAYLOAD + entry, gravity=str(DOWN))
    recording = load_recording(machine, paths, need_observations=False)
    carried = recording.driver("payload")
    assert carried is not None
    np.testing.assert_allclose(carried, [1, 2, 3, 2, 2, 2, 2, 2, 2])  # tuesday's does not count


# -- what fits make of them ----------------------------------------------------------------------------

UNKNOWN: dict[str, Any] = {
    "base": "{tolerance: {xyz: .inf, rpy: .inf}}",
    "tool": ", tolerance: {xyz: 10}",
    "tolerance": 0.1,
}
LONG = "recordings: {long: {files: tuesday.csv, tool: {in: tool, xyz: [0, 0, 50]}}}\n"


def test_two_tools_are_one_calibration(tmp_path: Path) -> None:
    paths = files(tmp_path, monday=measured(joints(40, 1), 0.0, 5), tuesday=measured(joints(40, 2), 50.0, 6))
    machine = machine_of(tmp_path, LONG, **UNKNOWN)
    recording = load_recording(machine, paths)
    assert load_checked(tmp_path / "arm.yaml", paths)[0].verdict == "ok"
    found = calibrate(machine, recording)
    assert found.judgement.calibrated and 0.7 < found.fit.chi2_per_dof < 1.4
    values = dict(zip(found.fit.prior.names, zip(found.fit.p, found.fit.std, strict=True), strict=True))
    for axis, drawn in zip("xyz", TOOL, strict=True):
        value, std = values[f"tool.{axis}"]
        # q6.r (known to 0.1 mm) trades with tool.z: the fit says so
        assert abs(value - drawn - OFF[f"tool.{axis}"]) < 4 * std and std < 0.15
    write_calibrated(tmp_path / "calibrated.yaml", found.fit, recording)
    again = load_machine(tmp_path / "calibrated.yaml")
    rows = load_recording(again, paths[1])
    prediction = predict(again, rows)
    read = np.column_stack([rows.observations[axis] for axis in "xyz"])
    assert np.sqrt(np.mean((prediction.values[:, 0:6:2] - read) ** 2)) < 0.03
    assert not calibrate(machine_of(tmp_path, **UNKNOWN), recording.files).judgement.calibrated


@pytest.mark.nightly
def test_a_diagnosis_with_two_tools_finds_nothing_amiss(tmp_path: Path) -> None:
    paths = files(tmp_path, monday=measured(joints(30, 3), 0.0, 7), tuesday=measured(joints(30, 4), 50.0, 8))
    machine = machine_of(tmp_path, LONG, **UNKNOWN)
    diagnosis = truepose.diagnose(machine, load_recording(machine, paths))
    assert not diagnosis.findings


@pytest.mark.nightly
def test_an_unknown_payload_of_one_recording_is_weighed(tmp_path: Path) -> None:
    """The arm's compliances are known, and tell what it carried on Tuesday: 7 kg, stated as 5 +- 3."""
    q, rng = joints(60, 9), np.random.default_rng(4)
    turn, lever = sensor_turn(), TOOL + np.array([0.0, 0.0, 80.0]) - SENSOR
    rows = []
    for kg in (2.0, 7.0):
        read = []
        for row in q:
            flange = placed(row).turns[5].real
            # in the axes of a sensor, as the simulator has it
            push = (flange @ turn).T @ (kg * np.array(DOWN))
            moment = np.cross(turn.T @ lever / 1000, push)
            read.append(placed(held(row, SOFT, np.array([*push, *moment]), np.array(DOWN))).tool.real)
        rows.append(table(q, np.array(read) + 0.02 * rng.standard_normal((60, 3))))
    paths = files(tmp_path, monday=rows[0], tuesday=rows[1])
    more = "  payload: {kg: 2, com: [0, 0, 80], in: tool}\n" + (
        "recordings: {heavy: {files: tuesday.csv, payload: {kg: 5, com: [0, 0, 80], tolerance: {kg: 3}}}}\n"
        "effects:\n"
        "  - {effect: joint-compliance, place: [q2], parameters: {c: {value: 3e-6, unit: rad/(N*m), std: 1e-9}}}\n"
        "  - {effect: joint-compliance, place: [q3], parameters: {c: {value: 4e-6, unit: rad/(N*m), std: 1e-9}}}\n"
    )
    machine = machine_of(tmp_path, more, gravity=str(DOWN))
    found = calibrate(machine, load_recording(machine, paths))
    values = dict(zip(found.fit.prior.names, zip(found.fit.p, found.fit.std, strict=True), strict=True))
    kg, std = values["heavy.payload.kg"]
    assert abs(kg - 7.0) < 3 * std and std < 0.5
    write_calibrated(tmp_path / "weighed.yaml", found.fit, load_recording(machine, paths))
    assert load_machine(tmp_path / "weighed.yaml").own_payloads[0].kg == pytest.approx(float(kg))


# -- dates ---------------------------------------------------------------------------------------------


def test_dated_files_share_a_clock(tmp_path: Path) -> None:
    q = joints(2, 1)
    timed = table(q) | {"time": np.array([0.0, 60.0])}
    paths = files(tmp_path, monday=timed, tuesday=timed, noon=table(q))
    dated = (
        "recordings:\n  a: {files: monday.csv, date: 2026-03-02}\n  b: {files: [tuesday.csv], date: 2026-03-03 08:00}\n"
        "  c: {files: noon*, date: 2026-03-02T12:00}\n"
    )
    machine = machine_of(tmp_path, dated)
    recording = load_recording(machine, paths, need_observations=False)
    assert recording.time is not None
    np.testing.assert_allclose(recording.time, [0, 60, 115200, 115260, 43200, 43200])
    with input_error(r"other.csv: found no date of it in `recordings`, expected one beside"):
        load_recording(machine, [paths[0], *files(tmp_path, other=timed)], need_observations=False)


@pytest.mark.nightly
def test_a_base_that_drifts_from_day_to_day_has_a_rate(tmp_path: Path) -> None:
    """0.02 mm a day along x and 0.03 mm along z, over a fortnight; without dates it moves from session to session."""
    days, paths, dated = (0, 1, 2, 5, 9, 14), [], "recordings:\n"
    for k, day in enumerate(days):
        rows = measured(joints(15, 100 + k), 0.0, 100 + k)
        rows |= {"x": rows["x"] - 0.02 * day, "z": rows["z"] + 0.03 * day}
        paths += files(tmp_path, **{f"day{k}": rows})
        dated += f"  day{k}: {{files: day{k}.csv, date: 2026-03-{day + 1:02d}}}\n"
    machine = machine_of(tmp_path, dated, **UNKNOWN)
    (finding,) = truepose.diagnose(machine, load_recording(machine, paths)).findings
    assert (finding.effect, finding.place, finding.levels.kind) == ("mount-drift", ("base",), "time")
    for axis, rate in (("x", -0.02 / 24), ("y", 0.0), ("z", 0.03 / 24)):
        found = finding.parameters[axis]
        assert found.unit == "mm/h" and abs(found.value - rate) < 3 * found.std
    plain = machine_of(tmp_path, **UNKNOWN)
    (other,) = truepose.diagnose(plain, load_recording(plain, paths)).findings
    assert other.effect == "frame-shift"


# -- what is wrong is told -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("entry", "found"),
    [
        ("{tool: {xyz: [0, 0, 1]}}", ": expected either `files` or `sessions`, found 'neither'"),
        ("{sessions: 2, date: 2026-03-01}", ": expected `files` beside `date`"),
        ("{files: a, date: soon}", ".date: expected a date such as 2026-03-14"),
        ("{files: a, tool: {in: tool, rpy: [0, 0, 9]}}", ".tool: expected xyz alone with `in: tool`"),
        ("{files: a, tool: {in: link3}}", ".tool.in: expected 'flange' or 'tool'"),
        ("{files: a, payload: {kg: 1, in: link9}}", ".payload.in: found 'link9', expected a body"),
        ("{files: a, payload: {kg: -1}}", ".payload.kg"),
        ("{file: a}", ".file: unknown field; did you mean 'files'?"),
    ],
)
def test_a_wrong_entry_is_refused(tmp_path: Path, entry: str, found: str) -> None:
    with input_error(says=f"recordings.long{found}"):
        machine_of(tmp_path, f"recordings: {{long: {entry}}}\n")


def test_two_entries_for_one_row_are_refused_and_one_for_none_is_noted(tmp_path: Path) -> None:
    (path,) = files(tmp_path, tuesday=table(joints(2, 1)))
    tool = "tool: {in: tool, xyz: [0, 0, 5]}"
    machine = machine_of(
        tmp_path, f"recordings: {{a: {{files: tue*, {tool}}}, b: {{sessions: 1, {tool}}}}}\n"
    )
    with input_error(r"row 1: found its tool in recordings.a and recordings.b, expected one"):
        load_recording(machine, [path], need_observations=False)
    machine = machine_of(tmp_path, f"recordings: {{a: {{files: [wed*, thu*], {tool}}}}}\n")
    notes = load_recording(machine, [path], need_observations=False).notes
    assert f"recordings.a: none of {path} is called wed* or thu*" in notes
