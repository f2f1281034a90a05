"""What a joint's column holds: counts, and the motion of other joints; the machine stands where its own motions put it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.encoded_machines import COUPLED, as_recorded, document, encoded, in_counts, own_readings
from support.generated_c import COMPILER, WARNINGS, needs_compiler
from support.skips import NOTHING_BESIDE, SHARED
from truepose.api import calibrate, predict
from truepose.codegen.c import generate
from truepose.errors import InputError
from truepose.identification.compensation.compensate import compensate
from truepose.identification.compensation.path_table import commands, path_rows
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.leaves.planning.plan import plan
from truepose.identification.leaves.planning.showing import plan_table
from truepose.identification.load import load_recording
from truepose.identification.recording.table import read_table
from truepose.models.leaves.export.write import export
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.units import convert, counts_unit

EVERY = sorted(COUPLED)
PHYSICS = [
    {"effect": "joint-compliance", "place": ["q3"], "parameters": {"c": {"value": 1e-4, "unit": "rad/(N*m)"}}},
    {"effect": "transmission-error", "place": ["q3"], "order": 40.0, "parameters": {"a": {"value": 1e-3, "unit": "rad"}}},
    {"effect": "backlash", "place": ["q3"], "parameters": {"b": {"value": 1e-3, "unit": "rad"}}},
    {"effect": "actuator-scale", "place": ["q3"], "parameters": {"s": {"value": 1e-2, "unit": "1"}}},
    {"effect": "early-reading", "place": ["q3"], "parameters": {"e": {"value": 1e-3, "unit": "1"}}},
]  # fmt: skip


def coupled(folder: Path, name: str, **more: Any) -> Machine:
    """Return the machine with `COUPLED` joints."""
    return encoded(folder, name, {joint: {"coupled": k} for joint, k in COUPLED[name].items()}, **more)


def labelled(machine: Machine, columns: dict[str, Any]) -> dict[str, Any]:
    """Return columns with rows to count changes from, where a sensor asks for them."""
    if not any(sensor.differs_from_row for sensor in machine.sensors):
        return columns
    rows = list(range(len(next(iter(columns.values())))))
    return {"pose": rows, "from": rows, **columns}


def read(machine: Machine, columns: dict[str, Any]) -> pd.DataFrame:
    """Return the tool's pose, row by row."""
    found = predict(machine, load_recording(machine, labelled(machine, columns), need_observations=False))
    return found[[name for name in found if str(name).startswith("pose.")]]


@pytest.mark.parametrize("name", EVERY)
def test_a_coupled_joint_stands_where_its_own_motion_puts_it(tmp_path: Path, name: str) -> None:
    plain, other = encoded(tmp_path, name, {}), coupled(tmp_path, name)
    own = own_readings(plain, 12, seed=3)
    expected, found = read(plain, own), read(other, as_recorded(plain, own, name))
    assert np.isfinite(expected.to_numpy()).all()
    np.testing.assert_allclose(found, expected, atol=1e-7)


def test_effects_and_loads_are_those_of_the_own_motion(tmp_path: Path) -> None:
    plain, other = (
        encoded(tmp_path, "serial", {}, effects=PHYSICS),
        coupled(tmp_path, "serial", effects=PHYSICS),
    )
    own = own_readings(plain, 40, seed=5)
    np.testing.assert_allclose(read(other, as_recorded(plain, own, "serial")), read(plain, own), atol=1e-7)


def test_an_eccentric_encoder_turns_with_what_it_reads(tmp_path: Path) -> None:
    """Recorded q3 = own q3 + q2: the disc's error is one of the sum."""
    size = {"a": {"value": 0.01, "unit": "rad"}}
    disc = [{"effect": "encoder-eccentricity", "place": ["q3"], "parameters": size}]
    keys = {"q3": {"coupled": {"q2": 1}}}
    bent, straight = (encoded(tmp_path, "serial", keys, effects=e) for e in (disc, []))
    for q2, q3 in ((50.0, 0.0), (-50.0, 0.0), (20.0, 90.0)):
        own = q3 - q2 + np.degrees(0.01 * np.sin(np.radians(q3)))
        row = {"q1": [0.0], "q2": [q2]}
        np.testing.assert_allclose(
            read(bent, {**row, "q3": [q3]}), read(straight, {**row, "q3": [own + q2]}), atol=1e-9
        )


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize(("header", "counts"), [("", 8192.5), (" [tick]", 8192.5), (" [Counts]", -8192.5)])
def test_counts_are_a_unit(tmp_path: Path, name: str, header: str, counts: float) -> None:
    """An encoder that counts backwards has a negative number of them."""
    plain = encoded(tmp_path, name, {})
    counted = encoded(tmp_path, name, {joint: {"counts": counts} for joint in plain.mechanism.readings})
    own = own_readings(plain, 6, seed=4)
    columns = in_counts(plain, {joint: np.array(values) for joint, values in own.items()}, counts)
    columns = {f"{joint}{header}": values for joint, values in columns.items()}
    wanted = load_recording(plain, labelled(plain, own), need_observations=False)
    found = load_recording(counted, labelled(counted, columns), need_observations=False)
    np.testing.assert_allclose(found.q, wanted.q, rtol=1e-12, atol=1e-12)
    again = load_recording(counted, found.to_frame(), need_observations=False)
    np.testing.assert_allclose(again.q, wanted.q, rtol=1e-12, atol=1e-12)


@given(
    counts=st.floats(1e-3, 1e9) | st.floats(-1e9, -1e-3),
    turns=st.floats(1e-9, 10.0)
    | st.floats(-10.0, -1e-9)
    | st.just(0.0),  # products of smaller ones are rounded to few digits
    unit=st.sampled_from(["rad", "turn", "mm"]),
)
def test_a_turn_or_a_millimetre_has_so_many_counts(counts: float, turns: float, unit: str) -> None:
    found = convert(counts * turns, counts_unit(counts, unit), "mm" if unit == "mm" else "turn")
    np.testing.assert_allclose(found, turns, rtol=1e-12)


def test_counts_that_nobody_stated_are_refused(tmp_path: Path) -> None:
    machine = encoded(tmp_path, "pair", {})
    with pytest.raises(
        InputError, match=r"'J3': found the unit 'ticks', an encoder's counts, expected `counts: N`"
    ):
        load_recording(machine, {"J2": [0.0], "J3 [ticks]": [4.0]}, need_observations=False)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"J3": {"coupled": {"J4": 1}}}, "joint 'J3': coupled: found 'J4', expected another joint"),
        ({"J3": {"coupled": {"J3": 1}}}, "joint 'J3': coupled: found 'J3', expected another joint"),
        ({"J3": {"coupled": {"J2": 1}}, "J2": {"coupled": {"J3": 1}}}, "J2, J3 coupled to each other"),
        ({"J3": {"coupled": {"J2": "one"}}}, r"coupled.J2: expected a finite number \(1\), found 'one'"),
        ({"J3": {"counts": 0}}, r"counts: expected a finite number that is not 0 \(1\), found 0"),
        ({"J3": {"wrap": -360}}, r"wrap: expected a finite number > 0 \(1\), found -360"),
        ({"J3": {"wrap": "1 m"}}, "joint 'J3': wrap: found '1 m', expected a unit such as rad"),
        ({"J4": {"wrap": 360}}, "encoders: found 'J4', expected a joint that is read"),
    ],
)
def test_what_no_encoder_reads_is_refused(tmp_path: Path, keys: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        encoded(tmp_path, "pair", keys)


def test_a_joint_that_nobody_reads_has_no_encoder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="counts beside `actuated: true`"):
        encoded(tmp_path, "planar", {"b1": {"counts": 100}})


@pytest.mark.parametrize("format", ["urdf", "mjcf"])
def test_no_description_of_links_holds_a_coupling(tmp_path: Path, format: str) -> None:
    machine = coupled(tmp_path, "pair")
    with pytest.raises(
        InputError, match="joint 'J3': found readings coupled to J2, expected the joint's own motion"
    ):
        export(machine, tmp_path / "out", format)


@needs_compiler
@pytest.mark.parametrize("name", ["serial", "hybrid", "ups", "pus"])
def test_c_takes_recorded_readings(tmp_path: Path, name: str) -> None:
    """Its example solves the poses of its readings, and knows which these are."""
    import subprocess

    machine = coupled(tmp_path, name)
    generate(machine, tmp_path / "c", "double")
    model = symbolic_model(machine, machine.effects)
    rows = pd.read_csv(tmp_path / "c" / "test_vectors.csv", header=None, skiprows=1).to_numpy(dtype=float)
    readings = rows[:, : len(model.readings)]
    units = {a.reading: a.reading_unit for a in machine.mechanism.actuators}
    columns = {f"{n} [{units[n]}]": readings[:, k] for k, n in enumerate(model.readings)}
    found = read(machine, columns)[["pose.x", "pose.y", "pose.z"]].to_numpy()
    written = rows[:, len(model.readings) :].reshape(len(rows), 3, 4)[:, :, 3]
    apart = np.linalg.norm(found[:, None] - found[None], axis=2)
    np.testing.assert_allclose(apart, np.linalg.norm(written[:, None] - written[None], axis=2), atol=1e-4)
    assert COMPILER is not None
    sources = sorted(str(path) for path in (tmp_path / "c").glob("*.c"))
    subprocess.run([COMPILER, *WARNINGS, *sources, "-lm", "-o", str(tmp_path / "example")], check=True)
    subprocess.run([tmp_path / "example"], check=True, capture_output=True)


def test_commands_are_recorded_readings(tmp_path: Path) -> None:
    """The coupled machine is commanded to where the plain one goes."""
    bent = [{"effect": "actuator-scale", "place": ["q3"], "parameters": {"s": {"value": 1e-3, "unit": "1"}}}]
    plain, other = encoded(tmp_path, "serial", {}, effects=bent), coupled(tmp_path, "serial", effects=bent)
    own = {"q1": [0.0, 10.0], "q2": [20.0, -40.0], "q3": [70.0, 95.0]}
    recorded = as_recorded(plain, own, "serial")
    expected, found = (
        compensate(machine, load_recording(machine, rows, need_observations=False)).command
        for machine, rows in ((plain, own), (other, recorded))
    )
    columns = {name: np.degrees(v) if name != "q1" else v for name, v in zip(own, expected.T, strict=True)}
    wanted = as_recorded(plain, {name: v.tolist() for name, v in columns.items()}, "serial")
    for k, name in enumerate(own):
        np.testing.assert_allclose(np.degrees(found[:, k]) if k else found[:, k], wanted[name], atol=1e-6)


def test_a_calibrated_file_keeps_what_the_columns_hold(tmp_path: Path) -> None:
    keys = {"J3": {"coupled": {"J2": 1}, "counts": 8192, "wrap": 8192}}
    machine = encoded(tmp_path, "pair", keys)
    rng = np.random.default_rng(2)
    q2, own = rng.uniform(-60, 60, 40), rng.uniform(-60, 60, 40)
    plain = encoded(tmp_path, "pair", {})
    seen = predict(plain, load_recording(plain, {"J2": q2, "J3": own}, need_observations=False))
    counts = ((own + q2) * 8192 / 360) % 8192
    rows = {"J2": q2, "J3": counts, **{axis: seen[axis] for axis in "xyz"}}
    fit = calibrate(machine, rows)
    write_calibrated(tmp_path / "calibrated.yaml", fit.fit, load_recording(machine, rows))
    again = load_machine(tmp_path / "calibrated.yaml")
    assert [(a.coupled, a.counted, a.wrap) for a in again.mechanism.actuators] == [
        (a.coupled, a.counted, a.wrap) for a in machine.mechanism.actuators
    ]
    assert document("pair")["mechanism"]["type"] == "urdf"
    left = predict(again, rows)[["x", "y", "z"]].to_numpy() - np.array([rows[axis] for axis in "xyz"]).T
    assert np.abs(left).max() < 1e-4


def test_the_horizon_of_a_fanuc_is_a_coupling(tmp_path: Path) -> None:
    """Recorded J3 = link angle + J2: the same own motions as where link angles were recorded."""
    folder = SHARED / "cases" / "fanuc-arm"
    if not folder.is_dir():
        pytest.skip(NOTHING_BESIDE)
    text = (folder / "armf.yaml").read_text(encoding="utf-8").partition("effects:")[0]
    horizon = text.replace("{name: J3,", "{name: J3, coupled: {J2: 1},").replace(
        "[-200, 200]}", "[-400, 400]}"
    )
    for name, own in (("link", text), ("horizon", horizon)):
        (tmp_path / f"{name}.yaml").write_text(own, encoding="utf-8")
    link, other = (load_machine(tmp_path / f"{name}.yaml") for name in ("link", "horizon"))
    one, two = load_recording(link, folder / "rec_dh.csv"), load_recording(other, folder / "rec_fanuc.csv")
    np.testing.assert_allclose(two.moved, one.moved, atol=1e-9)
    for name in ("step.J3", "approach.J3"):
        came, expected = two.driver(name), one.driver(name)
        assert came is not None and expected is not None
        np.testing.assert_allclose(came, expected, atol=1e-9)


@pytest.mark.parametrize("lowest", [0.0, -180.0])
def test_a_path_comes_back_as_it_was_logged(tmp_path: Path, lowest: float) -> None:
    """Commands are near the path's readings, modulo what they come modulo, in counts where the path has counts."""
    bent = [{"effect": "actuator-scale", "place": ["J3"], "parameters": {"s": {"value": 1e-3, "unit": "1"}}}]
    keys = {"J2": {"counts": 3600, "wrap": 3600}, "J3": {"wrap": 360}}
    plain, other = (encoded(tmp_path, "pair", k, effects=bent) for k in ({}, keys))
    q = np.column_stack([np.linspace(-20.0, 20.0, 9), np.linspace(-30.0, 40.0, 9)])
    folded = (q - lowest) % 360.0 + lowest
    given, found = {}, {}
    for name, machine, rows, scale in (("plain", plain, q, 1.0), ("other", other, folded, 10.0)):
        path = tmp_path / f"{name}.csv"
        given[name] = pd.DataFrame({"J2": scale * rows[:, 0], "J3": rows[:, 1]})
        given[name].to_csv(path, index=False)
        table, way = path_rows(machine, read_table(path))
        found[name] = commands(table, machine, compensate(machine, way))
    found["other"]["J2"] /= 10.0
    given["other"]["J2"] /= 10.0
    np.testing.assert_allclose(found["other"] - given["other"], found["plain"] - given["plain"], atol=1e-8)


def test_plans_are_in_counts(tmp_path: Path) -> None:
    machine = encoded(tmp_path, "pair", {"J3": {"counts": 4096, "coupled": {"J2": 1}}})
    planned = plan(machine, 12, seed=1, method="random")
    table = plan_table(planned)
    np.testing.assert_allclose(table["J3"] * 2 * np.pi / 4096, planned.q[:, 1], atol=2 * np.pi / 4096)
