"""Any recorded column may drive any part: measured torques, thermometers elsewhere, and what a user tries.

Readings come from ``support.plain_arm``, an arm in numpy apart from the library.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from typer.testing import CliRunner

import truepose
from support import plain_arm as arm
from support.plain_arm import soft_arm
from support.simulated import machine_from
from truepose.cli import app
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.prior import UNNAMED_SHARE
from truepose.identification.recording.load import try_columns
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.untestable import missing_inputs
from truepose.models.file.driver import Driver

SEED = 2
"""Of an arm without masses whose q2 gives way."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("torques")
    document, table, _, _ = soft_arm(SEED)
    (folder / "arm.yaml").write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    table.to_csv(folder / "rows.csv", index=False)
    return folder


@pytest.fixture(scope="module")
def found(folder: Path) -> Diagnosis:
    machine = truepose.load_machine(folder / "arm.yaml")
    diagnosis = truepose.diagnose(machine, truepose.load_recording(machine, [folder / "rows.csv"]))
    truepose.write_calibrated(folder / "improved.yaml", diagnosis.after, diagnosis.recording)
    return diagnosis


def test_a_measured_torque_finds_a_compliance_although_nobody_weighed_anything(found: Diagnosis) -> None:
    _, _, compliances, sign = soft_arm(SEED)
    ((joint, c),) = compliances.items()
    (finding,) = found.findings
    assert (finding.effect, finding.place, finding.levels.kind) == ("joint-compliance", (joint,), "load")
    assert finding.settings == ({"torque": sign},)
    # a line in the measured torque without a name is the same function: their prior odds and the sign tell them apart
    assert finding.probability > 1.0 - UNNAMED_SHARE and finding.levels.driver > 0.99
    value = finding.parameters["c"]
    assert value.unit == "rad/(N*m)" and value.value == pytest.approx(c, abs=4 * value.std)
    against = "what the drive holds against the load"
    assert f"torque.{joint}" in finding.explanation and (against in finding.explanation) is (sign < 0)
    # what could be tested is no reason to weigh the arm
    assert all("joint-compliance" not in m.effects for m in missing_inputs(found.nominal, found.recording))


@pytest.mark.nightly
def test_the_other_sign_of_the_column_is_the_same_compliance(folder: Path, found: Diagnosis) -> None:
    machine = truepose.load_machine(folder / "arm.yaml")
    table = pd.read_csv(folder / "rows.csv")
    for joint in arm.JOINTS:
        table[f"torque.{joint}"] *= -1.0
    other = truepose.diagnose(machine, truepose.load_recording(machine, table))
    (one,), (two,) = found.findings, other.findings
    assert (one.place, one.settings[0]["torque"]) == (two.place, -two.settings[0]["torque"])
    assert two.parameters["c"].value == pytest.approx(one.parameters["c"].value, rel=1e-3)


def test_the_improved_machine_reads_the_torque(folder: Path, found: Diagnosis) -> None:
    improved = truepose.load_machine(folder / "improved.yaml")
    (joint,) = found.findings[0].place
    recording = truepose.load_recording(improved, [folder / "rows.csv"])
    frame = truepose.predict(improved, recording)
    read = pd.read_csv(folder / "rows.csv")
    off = np.concatenate([frame[f"P1.{axis}"] - read[f"P1.{axis}"] for axis in "xyz"])
    assert np.sqrt(np.mean(off**2)) < 1.3 * arm.SIGMA
    truepose.generate(improved, folder / "c")
    header = (folder / "c" / "arm_kin.h").read_text(encoding="utf-8")
    assert f"arm_Z_torque_{joint} 0 /* N*m: torque.{joint} */" in header
    path = read[list(arm.JOINTS)].head(3)
    path.assign(**{f"torque.{joint}": 100.0}).to_csv(folder / "path.csv", index=False)
    done = CliRunner().invoke(
        app, ["compensate", str(folder / "improved.yaml"), str(folder / "path.csv"), "-o", str(folder / "o.csv")]
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    path.assign(**{f"torque.{joint}": 0.0}).to_csv(folder / "still.csv", index=False)
    still = [
        "compensate",
        str(folder / "improved.yaml"),
        str(folder / "still.csv"),
        "-o",
        str(folder / "s.csv"),
    ]
    assert CliRunner().invoke(app, still).exit_code == 0
    loaded, free = (pd.read_csv(folder / name, comment="#")[joint] for name in ("o.csv", "s.csv"))
    given = 100.0 * found.findings[0].settings[0]["torque"] * found.findings[0].parameters["c"].value
    np.testing.assert_allclose(np.radians(loaded - free), -given, rtol=0.02)


@pytest.mark.nightly
def test_a_column_of_a_joints_drive_is_the_same_under_any_name(folder: Path, found: Diagnosis) -> None:
    """The result still says whose it is; read again, it drives that joint alone."""
    document = yaml.safe_load((folder / "arm.yaml").read_text(encoding="utf-8"))
    document["drivers"] = [{"name": f"axis {j}", "unit": "N*m", "of": j} for j in arm.JOINTS]
    (folder / "of.yaml").write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    rows = pd.read_csv(folder / "rows.csv").rename(columns={f"torque.{j}": f"axis {j}" for j in arm.JOINTS})
    machine = truepose.load_machine(folder / "of.yaml")
    other = truepose.diagnose(machine, truepose.load_recording(machine, rows))
    assert [(f.effect, f.place) for f in other.findings] == [(f.effect, f.place) for f in found.findings]
    truepose.write_calibrated(folder / "of-improved.yaml", other.after, other.recording)
    improved = truepose.load_machine(folder / "of-improved.yaml")
    assert improved.drivers == machine.drivers == tuple(f"torque.{j}" for j in arm.JOINTS)
    assert not any(driver.everywhere for driver in improved.declared_drivers)
    again = truepose.predict(improved, truepose.load_recording(improved, rows))
    off = np.concatenate([again[f"P1.{axis}"] - rows[f"P1.{axis}"] for axis in "xyz"])
    assert np.sqrt(np.mean(off**2)) < 1.3 * arm.SIGMA


@pytest.mark.nightly
def test_torques_need_no_declaration(folder: Path, found: Diagnosis) -> None:
    """And what they found is declared where the file is written."""
    document = yaml.safe_load((folder / "arm.yaml").read_text(encoding="utf-8"))
    del document["drivers"]
    machine = machine_from(folder, yaml.safe_dump(document, sort_keys=False), "bare")
    bare = truepose.diagnose(machine, truepose.load_recording(machine, [folder / "rows.csv"]))
    assert [(f.effect, f.place) for f in bare.findings] == [(f.effect, f.place) for f in found.findings]
    truepose.write_calibrated(folder / "again.yaml", bare.after, bare.recording)
    (joint,) = bare.findings[0].place
    again = truepose.load_machine(folder / "again.yaml")
    assert f"torque.{joint}" in again.drivers
    declared = again.declared(f"torque.{joint}")
    assert declared is not None and not declared.everywhere


def tilting(folder: Path, **more: np.ndarray) -> Path:
    """An arm whose column tips by what an inclinometer reads; nobody declares the inclinometer."""
    rng = np.random.default_rng(5)
    true, rows = arm.constants(rng), []
    tilt = np.cumsum(rng.normal(size=70))
    for k in range(70):
        q = rng.uniform(arm.LOW, arm.HIGH)
        turned = np.radians(q) + np.array([0.0, 2e-4 * tilt[k], 0.0, 0.0, 0.0, 0.0])
        rows.append({**dict(zip(arm.JOINTS, q, strict=True)), **arm.readings(true, turned, rng)})
    (folder / "arm.yaml").write_text(yaml.safe_dump(arm.document(weighs=False)), encoding="utf-8")
    pd.DataFrame(rows).assign(**{"incline [mdeg]": 10 * tilt}, **more).to_csv(folder / "r.csv", index=False)
    return folder / "r.csv"


@pytest.mark.nightly
def test_a_column_that_is_tried_is_found_and_then_declared(tmp_path: Path) -> None:
    rows = tilting(tmp_path, noise=np.random.default_rng(1).normal(size=70))
    command = ["diagnose", str(tmp_path / "arm.yaml"), str(rows), "-o", str(tmp_path / "out")]
    done = CliRunner().invoke(app, [*command, "--try-columns", "all"])
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert "tried as drivers: incline and noise: each has 1/2 of the prior of a driver" in said
    written = yaml.safe_load((tmp_path / "out" / "improved.yaml").read_text(encoding="utf-8"))
    (entry,) = [e for e in written["effects"] if "from.incline" in e]
    assert entry["place"] == ["q2"]
    assert written["drivers"] == [{"name": "incline", "unit": "rad", "drives": "coupling"}]
    named = CliRunner().invoke(app, [*command, "--try-columns", "inclin"])
    assert named.exit_code == 2 and "did you mean 'incline'?" in named.output


def test_columns_that_are_tried_weigh_together_what_one_driver_weighs(tmp_path: Path) -> None:
    """However many: chance has as many chances, and each one's evidence is worth less by that."""
    rng = np.random.default_rng(2)
    rows = tilting(tmp_path, **{f"c{k}": rng.normal(size=70) for k in range(9)})
    machine = truepose.load_machine(tmp_path / "arm.yaml")

    def share(names: list[str]) -> tuple[float, float]:
        """Of what tried columns drive at q2, together; and of what q1 drives there."""
        trying = try_columns(machine, [rows], names)
        cat = catalogue(trying, truepose.load_recording(trying, [rows]))
        prior = np.exp(cat.log_prior)
        at = [k for k, c in enumerate(cat.candidates) if c.effect.slug == "empirical" and c.place == ("q2",)]
        read = {k: {Driver.of(name).name for name in cat.candidates[k].drivers} for k in at}
        other = [k for k in at if cat.candidates[k].settings and "from.q1" in cat.candidates[k].settings_map]
        return sum(prior[k] for k in at if read[k] & set(names)), sum(prior[k] for k in other)

    one, ten = share(["incline"]), share(["incline", *(f"c{k}" for k in range(9))])
    np.testing.assert_allclose(ten, one, rtol=1e-9)
