"""The pair that the gate writes: what was mended in it, what stays, and what goes with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import truepose
from support.checked_arm import Document, checked, document, recorded, written
from support.command import invoke
from support.machine_texts import machine_from
from truepose.identification.leaves.check.kinds.units import file_lengths
from truepose.identification.leaves.check.pair import Pair, Sheet
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.leaves.check.run import check_files
from truepose.identification.recording.load import tables
from truepose.models.file.yaml_document import document_text
from truepose.models.machine.machine import Machine
from truepose.models.machine.urdf_lengths import rescaled


@pytest.fixture(scope="module")
def right() -> pd.DataFrame:
    return recorded()


URDF = """<robot name="r"><link name="l0"/><link name="l1"/><link name="l2"/><link name="l3"/>
<joint name="j1" type="revolute"><parent link="l0"/><child link="l1"/><origin xyz="0 0 0.3"/><axis xyz="0 0 1"/></joint>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.1 0 0.1" rpy="1.5708 0 0"/>
<axis xyz="0 0 1"/></joint>
<joint name="j3" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/></joint>
</robot>"""


DESCRIBED = """\
# the arm in the corner
schema: truepose/machine/1
name: arm
tolerances: {length: 0.1, angle: 0.05}  # drawing
mechanism: {type: urdf, file: parts/arm.urdf, base_link: l0, tip_link: l3}
frames:
  base: {in: world, xyz: [100, 50, 0], rpy: [0, 0, 30], tolerance: {xyz: .inf, rpy: .inf}}
  tool: {in: flange, xyz: [250, 0, 40], tolerance: {xyz: 0.5, rpy: 0}}
sensor: {type: position, sigma: {xyz: 0.02}}
"""


def test_a_mended_pair_is_not_written_over_its_source(right: pd.DataFrame, tmp_path: Path) -> None:
    machine, recording = written(tmp_path, document(), right)
    with pytest.raises(truepose.InputError, match="another directory"):
        Pair.read(machine, [recording]).write(tmp_path)


def described(folder: Path) -> pd.DataFrame:
    """Write an arm and its URDF in a folder; return rows of it."""
    (folder / "parts").mkdir(parents=True)
    (folder / "parts" / "arm.urdf").write_text(URDF, encoding="utf-8")
    machine = machine_from(folder, DESCRIBED, "m")
    q = np.random.default_rng(5).uniform(-1.5, 1.5, (30, 3))
    return seen(machine, pd.DataFrame(q, columns=["j1 [rad]", "j2 [rad]", "j3 [rad]"]), 2)


def seen(machine: Machine, poses: pd.DataFrame, seed: int = 1) -> pd.DataFrame:
    return pd.concat([poses, truepose.simulate(machine, poses, seed=seed).reset_index(drop=True)], axis=1)


@pytest.mark.nightly
def test_a_robot_description_goes_with_the_mended_machine_file(tmp_path: Path) -> None:
    """The machine file keeps its comments, and its URDF stands beside it, so that the mended pair is whole."""
    rows = described(tmp_path / "given")
    rows.assign(**{"j2 [rad]": -rows["j2 [rad]"]}).to_csv(tmp_path / "r.csv", index=False)
    mended = tmp_path / "mended" / "m.yaml"
    stopped = invoke("check", tmp_path / "given" / "m.yaml", tmp_path / "r.csv", "--fix", mended.parent)
    assert stopped.exit_code == 2 and stopped.stdout.count("mended/") == 3, stopped.output
    assert check_files(mended, [tmp_path / "mended" / "r.csv"])[0].verdict == "ok"
    assert mended.read_text(encoding="utf-8") == DESCRIBED.replace("parts/arm.urdf", "arm.urdf")


@pytest.mark.nightly
def test_a_urdf_in_millimetres_is_mended(tmp_path: Path) -> None:
    described(tmp_path).to_csv(tmp_path / "r.csv", index=False)
    (tmp_path / "parts" / "arm.urdf").write_text(rescaled(URDF, 1000.0), encoding="utf-8")
    found = check_files(tmp_path / "m.yaml", [tmp_path / "r.csv"])[0]
    assert [(f.kind, f.verdict) for f in found.found] == [("unit-length", "wrong")]
    assert found.found[0].says == "the URDF's lengths in mm"
    found.mended(Pair.read(tmp_path / "m.yaml", [tmp_path / "r.csv"])).write(tmp_path / "mended")
    assert check_files(tmp_path / "mended/m.yaml", [tmp_path / "mended/r.csv"])[0].verdict == "ok"


@pytest.mark.nightly
def test_lengths_of_a_urdf_alone_are_rescaled() -> None:
    text = """<joint name="a" type="prismatic"><origin rpy="0 0 1" xyz="1 -2.5 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="4" effort="5"/></joint>
<joint name="b" type="revolute"><origin xyz='1e-3 0 0'/><limit lower="-3" upper="4"/></joint>"""
    grown = text.replace("1 -2.5 0", "10 -25 0").replace("1e-3 0 0", "0.01 0 0")
    assert rescaled(text, 10.0) == grown.replace('"-3" upper="4" effort', '"-30" upper="40" effort')


def platform(inch: float) -> Document:
    """Six struts on vertical rails, lengths in parts of ``inch``."""
    legs = []
    for k in range(6):
        below, above = (np.radians(60 * (k // 2) * 2 + side * (-1) ** k) for side in (12.0, 48.0))
        a, b = 390 * np.array([np.cos(below), np.sin(below)]), 250 * np.array([np.cos(above), np.sin(above)])
        leg = {"name": f"leg{k + 1}", "joint": f"rho{k + 1}", "u": [0.0, 0.0, 1.0], "length": 500.0 / inch}
        legs.append(leg | {"a": [*(a / inch).tolist(), 0.0], "b": [*(b / inch).tolist(), 0.0]})
    home = float(np.sqrt(500.0**2 - np.sum((a - b) ** 2)))
    return {
        "schema": "truepose/machine/1",
        "name": "platform",
        "mechanism": {"type": "6-pus", "legs": legs, "home": [0.0, 0.0, home / inch, 0.0, 0.0, 0.0]},
        "frames": {
            "base": {"in": "world", "xyz": [200 / inch, 0, 0], "tolerance": {"xyz": 5 / inch, "rpy": 1}}
        },
        "sensor": {"type": "pose", "sigma": {"xyz": 0.02 / inch, "rot": 0.005}},
        "tolerances": {"length": 0.1 / inch, "angle": 0.05},
    }


def strutted(folder: Path, right: Document) -> pd.DataFrame:
    """Return rows of a platform as it is."""
    q = np.random.default_rng(8).uniform(-70, 70, (30, 6)) + np.linspace(-90, 90, 30)[:, None]
    poses = pd.DataFrame(q, columns=[f"rho{k}" for k in range(1, 7)])
    return seen(machine_from(folder, document_text(right), "right"), poses)


@pytest.mark.nightly
def test_a_platform_drawn_in_inches(tmp_path: Path) -> None:
    """Its loops close from a home that is in inches, too, with strokes longer than the machine then seems to be."""
    found = checked(tmp_path, platform(25.4), strutted(tmp_path, platform(1.0)))
    assert (found.verdict, found.found[0].says) == ("wrong", "the machine file's lengths in inch")
    found.mended(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"])).write(tmp_path / "mended")
    assert check_files(tmp_path / "mended/arm.yaml", [tmp_path / "mended/r.csv"])[0].verdict == "ok"


def test_a_sheet_keeps_what_is_not_changed(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("q1,x [um],note\n1.50,2,fine\n-3,4.25,\n", encoding="utf-8")
    sheet = Sheet.of(tables([tmp_path / "r.csv"])[0])
    assert sheet.text() == "q1,x [um],note\n1.50,2,fine\n-3,4.25,\n"
    assert sheet.in_unit(["x"], "m").text().startswith("q1,x [m],note")
    assert sheet.with_numbers({"q1": -sheet.numbers("q1")}).text().splitlines()[1] == "-1.5,2,fine"


@pytest.mark.nightly
def test_ranges_and_pitches_are_lengths_of_the_mechanism_too(tmp_path: Path) -> None:
    """A mechanism in inches in a file in millimetres: all its lengths are mended, those of its slides as well."""

    def stated(inch: float) -> Document:
        machine = platform(1.0) | {"mechanism": platform(inch)["mechanism"]}
        for leg in machine["mechanism"]["legs"]:
            leg |= {"range": [-200.0 / inch, 200.0 / inch], "screw_pitch": 5.0 / inch}
        return machine

    found = checked(tmp_path, stated(25.4), strutted(tmp_path, stated(1.0)))
    assert found.found[0].says == "the mechanism's lengths in inch"
    mended = found.mended(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"]))
    assert mended.get(("mechanism", "legs", 2, "range")) == pytest.approx([-200.0, 200.0])
    assert mended.get(("mechanism", "legs", 2, "screw_pitch")) == pytest.approx(5.0)


def struts(machine: Document) -> Document:
    """The same platform on legs of changing length, which are read in turns of their motors."""
    legs = [
        {key: leg[key] for key in ("name", "joint", "a", "b")} | {"offset": 480.0, "gain": 5.0}
        for leg in machine["mechanism"]["legs"]
    ]
    mechanism = {"type": "6-ups", "legs": legs, "home": machine["mechanism"]["home"]}
    return machine | {"mechanism": mechanism, "units": {"length": "mm", "angle": "deg", "joint": "turn"}}


@pytest.mark.parametrize(
    "machine", [document(), platform(1.0), struts(platform(1.0))], ids=lambda m: m["mechanism"]["type"]
)
def test_a_file_in_another_unit_is_the_same_machine_at_another_scale(
    machine: Document, tmp_path: Path
) -> None:
    """Every length grows, those of a turn too, and tools stand as many times as far away."""
    loaded = machine_from(tmp_path, document_text(machine), "m")
    q = np.random.default_rng(3).uniform(-8, 8, (6, 6))
    rows = seen(loaded, pd.DataFrame(q, columns=[a.reading for a in loaded.mechanism.actuators]))
    rig = Rig(loaded, truepose.load_recording(loaded, rows))
    slip = next(s for s in file_lengths(rig, rig.scene) if s.says == "the machine file's lengths in inch")
    there = slip.change(rig.scene)
    long = [25.4 if a.reading_unit == "mm" else 1.0 for a in loaded.mechanism.actuators]
    ends = []
    for scene in (rig.scene, there.with_joints(there.rows.q * long)):
        here = rig.predictor.over(scene.rows)
        x, good = rig.assembled(here, scene.p, scene)
        assert good.all()
        ends.append(here.poses(scene.p, x)[0])
    np.testing.assert_allclose(ends[1][:, :3, 3], 25.4 * ends[0][:, :3, 3], rtol=1e-7, atol=1e-6)
    np.testing.assert_allclose(ends[1][:, :3, :3], ends[0][:, :3, :3], atol=1e-8)
