"""Tables in the conventions of data sheets: against their own products in numpy, through fits, files and generated C."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from support.plain_kinematics import frame
from support.simulated import machine_from
from truepose.codegen.c import generate
from truepose.errors import InputError
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.recording.load import load_recording
from truepose.models.file.machine_file import read_machine
from truepose.models.load import build_machine, load_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
Row = dict[str, Any]
LENGTHS = st.floats(-500.0, 500.0)
ANGLES = st.floats(-180.0, 180.0)
ROWS = st.lists(
    st.builds(
        lambda kind, a, alpha, d, theta: {"kind": kind, "a": a, "alpha": alpha, "d": d, "theta": theta},
        st.sampled_from(["revolute", "prismatic", "fixed"]),
        LENGTHS,
        ANGLES,
        LENGTHS,
        ANGLES,
    ),
    min_size=1,
    max_size=7,
).filter(lambda rows: any(row["kind"] != "fixed" for row in rows))
ARM: list[Row] = [
    {"kind": "revolute", "a": 20.0, "alpha": 90.0, "d": 300.0, "theta": 0.0},
    {"kind": "revolute", "a": 400.0, "alpha": 0.0, "d": 10.0, "theta": -90.0},
    {"kind": "prismatic", "a": 30.0, "alpha": -90.0, "d": 50.0, "theta": 15.0},
    {"kind": "revolute", "a": 25.0, "alpha": 40.0, "d": 90.0, "theta": 30.0},
]
FRAMES = "frames: {tool: {in: flange, xyz: [10, 20, 100]}}\n"


def machine_of(folder: Path, rows: Sequence[Row], convention: str, more: str = "") -> Machine:
    named = [{"name": f"q{k}", **row} for k, row in enumerate(rows, start=1)]
    mechanism = {"type": "serial", "convention": convention, "joints": named}
    text = yaml.safe_dump({"schema": "truepose/machine/1", "name": "arm", "mechanism": mechanism})
    return machine_from(folder, f"{text}sensor: {{type: pose, sigma: {{xyz: 0.02, rot: 0.01}}}}\n{more}")


def product(rows: Sequence[Row], q: Sequence[float], convention: str) -> Array:
    """Base to flange (4, 4), mm; readings in deg and mm."""
    out = np.eye(4)
    for row, value in zip(rows, q, strict=True):
        turn, slide = (value if row["kind"] == kind else 0.0 for kind in ("revolute", "prismatic"))
        own = frame([0, 0, row["d"] + slide], np.radians([0, 0, row["theta"] + turn]))
        link = frame([row["a"], 0, 0], np.radians([row["alpha"], 0, 0]))
        out = out @ (own @ link if convention == "standard" else link @ own)
    return out


def flange(machine: Machine, q: Sequence[float], rows: Sequence[Row]) -> Array:
    model = symbolic_model(machine)
    pairs = [(v, row["kind"]) for v, row in zip(q, rows, strict=True) if row["kind"] != "fixed"]
    internal = [v if kind == "prismatic" else np.radians(v) for v, kind in pairs]
    return np.array(ca.Function("pose", [model.q, model.p], [model.pose])(internal, model.p_home))


@settings(max_examples=40, deadline=None)
@given(rows=ROWS, seed=st.integers(0, 2**32 - 1), convention=st.sampled_from(["standard", "modified"]))
def test_a_table_is_the_product_that_its_convention_states(
    tmp_path_factory: pytest.TempPathFactory, rows: list[Row], seed: int, convention: str
) -> None:
    """To rounding: entries of a few metres in double precision. Rows of kind fixed stand still."""
    machine = machine_of(tmp_path_factory.mktemp("table"), rows, convention)
    q = np.random.default_rng(seed).uniform(-170, 170, len(rows)).tolist()
    np.testing.assert_allclose(flange(machine, q, rows), product(rows, q, convention), atol=1e-8)


def test_parameters_keep_the_names_of_the_programs_own_convention(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, ARM, "standard", "tolerances: {length: 0.2, angle: 0.1, q2.d: 0.7}\n")
    names = {p.name for p in machine.mechanism.parameters}
    assert names == {
        f"q{k}.{field}" for k in range(1, 5) for field in ("beta", "alpha", "d", "theta", "r")
    } | {
        "flange.alpha",
        "flange.d",
    }
    assert machine.geometry["q2.d"].nominal == 20.0  # a of the row before
    assert machine.geometry["q2.d"].tolerance == 0.7
    assert machine.geometry["flange.d"].nominal == 25.0
    assert machine.mechanism.flange == "flange"


def test_a_table_that_ends_on_its_last_axis_has_no_flange_of_its_own(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, [*ARM[:3], {**ARM[3], "a": 0.0, "alpha": 0.0}], "standard")
    assert machine.mechanism.flange == "link4"
    assert machine.mechanism.bodies == ("base", "link1", "link2", "link3", "link4")


def rows_of(folder: Path, q: Array, poses: Array, rng: np.random.Generator) -> Path:
    from scipy.spatial.transform import Rotation

    noise = Rotation.from_rotvec(np.radians(0.01) * rng.standard_normal((len(q), 3)))
    rot = (Rotation.from_matrix(poses[:, :3, :3]) * noise).as_rotvec(degrees=True)
    at = poses[:, :3, 3] + 0.02 * rng.standard_normal((len(q), 3))
    names = ["q1", "q2", "q3", "q4", "x", "y", "z", "rx", "ry", "rz"]
    path = folder / "rows.csv"
    pd.DataFrame(np.column_stack([q, at, rot]), columns=names).to_csv(path, index=False)
    return path


def test_masses_stand_in_the_frames_of_the_table(tmp_path: Path) -> None:
    """A centre in frame K of a standard table weighs where that frame is, also in the calibrated file."""
    masses = (
        "masses: {fore: {kg: 4, com: [-150, 20, 30], in: link2}, hand: {kg: 1, com: [5, 6, 7], in: link4}}\n"
    )
    machine = machine_of(tmp_path, ARM, "standard", f"gravity: [0, 0, -9.81]\n{masses}")
    q = [10.0, -20.0, 30.0, 40.0]
    fore, hand = machine.masses
    own = product(
        [*ARM[:1], {**ARM[1], "a": 0.0, "alpha": 0.0}], q[:2], "standard"
    )  # the body's frame, on its axis
    expected = product(ARM[:2], q[:2], "standard") @ [-150, 20, 30, 1]
    np.testing.assert_allclose(own @ [*fore.com, 1], expected, atol=1e-9)
    assert fore.body == "link2"
    own = product([*ARM[:3], {**ARM[3], "a": 0.0, "alpha": 0.0}], q, "standard")
    np.testing.assert_allclose(own @ [*hand.com, 1], product(ARM, q, "standard") @ [5, 6, 7, 1], atol=1e-9)


def test_masses_of_a_written_file_weigh_where_they_did(tmp_path: Path) -> None:
    more = "gravity: [0, 0, -9.81]\nmasses: {fore: {kg: 4, com: [-150, 20, 30], in: link2}}\n"
    machine = machine_of(
        tmp_path, ARM, "standard", f"tolerances: {{length: 0.3, angle: 0.1}}\n{FRAMES}{more}"
    )
    rng = np.random.default_rng(1)
    q = rng.uniform(-60, 60, (30, 4))
    tool = frame([10, 20, 100])
    poses = np.array([product(ARM, row, "standard") @ tool for row in q])
    recording = load_recording(machine, [rows_of(tmp_path, q, poses, rng)])
    write_calibrated(tmp_path / "calibrated.yaml", estimate(machine, recording), recording)
    read = load_machine(tmp_path / "calibrated.yaml")
    np.testing.assert_allclose(
        flange(read, q[0], ARM), flange(machine, q[0], ARM), atol=0.05
    )  # 0.02 mm in 30 rows
    assert read.gravity == machine.gravity
    assert [(m.name, m.kg, m.body) for m in read.masses] == [("fore", 4.0, "link2")]
    np.testing.assert_allclose(read.masses[0].com, machine.masses[0].com, atol=1e-12)


def test_a_field_of_another_convention_is_explained(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"joints\[0\]\.a: unknown field; here `d` is the length.*convention: standard"
    ):
        machine_of(tmp_path, ARM, "khalil")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"convention": "craig"},
            "mechanism.convention: found 'craig', expected one of khalil, modified, standard",
        ),
        ({"joints": [{"name": "q1", "kind": "revolute", "r": 3.0}]}, r"joints\[0\]\.r: unknown field"),
        ({"joints": [{"name": "q1", "kind": "revolute", "range": [3, 1]}]}, "low < high"),
        ({"joints": []}, "at least one joint"),
        ({"joints": [{"name": "flange", "kind": "revolute", "a": 1.0}]}, "a joint called 'flange'"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path: Path, change: Mapping[str, Any], message: str) -> None:
    mechanism = {
        "type": "serial",
        "convention": "standard",
        "joints": [{"name": "q1", "kind": "revolute"}],
        **change,
    }
    path = tmp_path / "arm.yaml"
    path.write_text(yaml.safe_dump({"schema": "truepose/machine/1", "name": "arm", "mechanism": mechanism}))
    with pytest.raises(InputError, match=message):
        build_machine(read_machine(path))


def moved(axis: int, mm: float) -> Array:
    out = np.eye(4)
    out[axis, 3] = mm
    return out


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_a_fit_recovers_an_arm_and_writes_a_file_that_stands_alone(tmp_path: Path, convention: str) -> None:
    """Zeros that are off by a few tolerances; the written file predicts what was measured, in Khalil's form."""
    machine = machine_of(tmp_path, ARM, convention, f"tolerances: {{length: 0.3, angle: 0.1}}\n{FRAMES}")
    rng = np.random.default_rng(4)
    q = rng.uniform([-150, -80, -60, -150], [150, 80, 60, 150], (40, 4))
    off = np.array([0.12, -0.2, 0.5, 0.15])
    tool = moved(0, 10) @ moved(1, 20) @ moved(2, 100)
    poses = np.array([product(ARM, row + off, convention) @ tool for row in q])
    recording = load_recording(machine, [rows_of(tmp_path, q, poses, rng)])
    fit = estimate(machine, recording)
    assert 0.75 < fit.chi2_per_dof < 1.25  # 2.7 sigma of 240 - 22 degrees of freedom
    write_calibrated(tmp_path / "calibrated.yaml", fit, recording)
    calibrated = load_machine(tmp_path / "calibrated.yaml")
    assert "convention" not in calibrated.file.mechanism if calibrated.file else False
    for row in rng.uniform([-150, -80, -60, -150], [150, 80, 60, 150], (5, 4)):
        got, truth = flange(calibrated, row, ARM), product(ARM, row + off, convention) @ tool
        assert (
            np.linalg.norm(got[:3, 3] - truth[:3, 3]) < 0.05
        )  # of 0.02 mm in 40 rows; the zeros are worth 1.5 mm


def test_generated_c_holds_the_table(tmp_path: Path) -> None:
    """Generated for a table and for the same machine in Khalil's form: the same bytes."""
    machine = machine_of(tmp_path, ARM, "standard", FRAMES)
    assert machine.file is not None
    own = {**machine.file.raw, "mechanism": machine.mechanism.expanded}
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "arm.yaml").write_text(yaml.safe_dump(own), encoding="utf-8")
    generate(machine, tmp_path / "a")
    generate(load_machine(tmp_path / "own" / "arm.yaml"), tmp_path / "b")
    files = [path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file()]
    assert Path("arm_kin.c") in files
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
