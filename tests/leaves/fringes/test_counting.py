"""Fringe counting: errors over speed, noise, contrast and turning points, its invariances, flags and tables.

Series come from ``support.fringe_signal``, which adds the light beam by beam. Lengths mm, errors nm.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from support import MACHINES
from support import fringe_signal as signals
from support.command import input_error, run
from support.examples import by_day
from support.fringe_journeys import cut, journeys
from support.fringe_journeys import journey as series
from support.fringe_signal import FIBRE
from support.machine_texts import machine_from
from truepose.cli import app
from truepose.errors import InputError
from truepose.identification.leaves.fringes.excursions import Fault
from truepose.identification.leaves.fringes.lengths import read_samples
from truepose.identification.leaves.fringes.move import Move, read_move
from truepose.identification.load import load_recording
from truepose.identification.prediction.predict import predict
from truepose.models.load import load_machine
from truepose.models.units import UnitSystem

NM = 1e6
EQUAL = (0.3, 0.3)
TOLD = 5.0


def read(run: Any, reflectivities: tuple[float, float] = FIBRE) -> Move:
    return read_move(run.t, run.signal, run.wavelength, reflectivities)


@pytest.mark.parametrize(
    ("samples", "noise"),
    by_day(itertools.product((200.0, 30.0, 8.0), (0.002, 0.01)), (30.0, 0.002), (8.0, 0.01)),
)
def test_error_is_below_5_nm_and_agrees_with_its_sigma(samples: float, noise: float) -> None:
    flagged = {False: 0, True: 0}
    for seed, (mirrors, turning) in enumerate(itertools.product((FIBRE, EQUAL), (False, True))):
        run = series(10 * seed, samples, turning, noise=noise, reflectivities=mirrors)
        move = read(run, mirrors)
        flagged[turning] += bool(move.faults)
        if move.faults:
            continue
        error = NM * abs(move.change - run.change)
        assert move.signed
        assert error < TOLD
        # rms of error / sigma is 0.7 in the study; six leave room for the levels, not for miscounts
        assert error < 6.0 * NM * move.sigma
        assert NM * move.sigma < TOLD
    # a turning point near the end of a fringe may not tell itself from a passage; a plain move always can be read
    assert flagged[False] == 0
    assert flagged[True] <= 1


@pytest.mark.parametrize("turning", [False, True])
def test_unit_and_origin_of_the_signal_and_of_time_do_not_matter(turning: bool) -> None:
    run = series(3, turning=turning)
    plain = read(run)
    for gain, offset, pace in ((1e3, 7.0, 1.0), (1e-6, -0.2, 1.0), (1.0, 0.0, 1e3)):
        other = read_move(pace * run.t + 5.0, gain * run.signal + offset, run.wavelength, FIBRE)
        # sums in another order: nothing but rounding, magnified where fits stop
        assert NM * other.change == pytest.approx(NM * plain.change, abs=0.02)
        assert other.faults == plain.faults


def test_time_reversed_gives_the_opposite_change() -> None:
    run = series(5)
    forth = read(run)
    back = read_move(run.t, run.signal[::-1].copy(), run.wavelength[::-1].copy(), FIBRE)
    # both come from the same samples; what differs is where groups of them begin
    assert back.change == pytest.approx(-forth.change, abs=2.0 * forth.sigma)
    assert forth.signed and back.signed


@pytest.mark.parametrize("seed", range(4))
def test_scans_give_the_sign_and_their_absence_gives_none(seed: int) -> None:
    scanned, plain = series(seed), series(seed, scan=0.0)
    move = read(scanned)
    assert move.signed
    assert np.sign(move.change) == np.sign(scanned.change)
    unsigned = read(plain)
    assert not unsigned.signed
    assert unsigned.change > 0.0
    # without scans the side of a fringe's end may stay open: then sigma says so
    assert NM * abs(unsigned.change - abs(plain.change)) < max(TOLD, 4.0 * NM * unsigned.sigma)


@pytest.mark.parametrize(
    ("light", "fault"),
    [
        (lambda: series(1, samples=3.0), Fault.FAST),
        (lambda: series(1, noise=0.3), Fault.WEAK),
        (lambda: lost(1), Fault.GAP),
    ],
)
def test_what_cannot_be_counted_is_flagged(light: Callable[[], Any], fault: Fault) -> None:
    assert fault in read(light()).faults


def lost(seed: int, shift: bool = False) -> signals.Run:
    """A move some of whose samples are missing."""
    return cut(journeys(30.0, signals.Detector(), False), shift)(np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(4))
def test_fringes_lost_in_a_jump_are_never_taken_for_a_reading(seed: int) -> None:
    assert {Fault.JUMP, Fault.COUNT} & set(read(lost(seed, shift=True)).faults)


def test_a_move_of_less_than_a_fringe_needs_levels_from_elsewhere() -> None:
    rng = np.random.default_rng(2)
    t = np.arange(0.0, 1.5, 1e-4)
    path = signals.displacement(t, 0.5, [(1e-4, 0.0, 0.5)])
    bare = signals.run(t, path, signals.Detector(), rng)
    assert Fault.LEVELS in read(bare).faults
    scanned = signals.run(t, path, signals.Detector(), rng, scan=2e-5)
    move = read(scanned)
    assert not move.faults
    assert NM * move.change == pytest.approx(100.0, abs=TOLD)


def samples_table(rows: int = 64) -> pd.DataFrame:
    return pd.DataFrame({"pose": np.ones(rows, dtype=int), "t": np.arange(rows) * 1e-3, "I": np.zeros(rows)})


@pytest.mark.parametrize(
    ("column", "row", "value", "said"),
    [
        ("I", 11, "", "row 11 (line 12), column 'I'"),
        ("I", 11, "dark", "row 11 (line 12), column 'I'"),
        ("t", 21, 0.0, "row 21 (line 22), column 't': found 0 s after 0.019 s in pose 1"),
        ("wavelength", 64, 0.0, "row 64 (line 65), column 'wavelength'"),
        ("sign", 64, 2, "row 64 (line 65), column 'sign'"),
        ("sign", 64, -1, "row 64 (line 65), column 'sign': found -1 after 1, expected one sign"),
        ("pose", 60, 2, "row 60 (line 61), column 'I': found 1 samples in the series"),
    ],
)
def test_samples_that_are_none_are_named(
    tmp_path: Path, column: str, row: int, value: str | float, said: str
) -> None:
    table = samples_table().assign(wavelength=1.56e-3, sign=1).astype(object)
    table.loc[row - 1, column] = value
    path = tmp_path / "light.csv"
    table.to_csv(path, index=False)
    with pytest.raises(InputError) as caught:
        read_samples(path, UnitSystem())
    assert str(caught.value).startswith(f"{path}: ") and said in str(caught.value)
    samples_table().drop(columns="I").to_csv(path, index=False)
    with input_error("missing column 'I'"):
        read_samples(path, UnitSystem())


def test_parquet_and_units_read_as_csv_does(tmp_path: Path) -> None:
    table = samples_table().assign(wavelength=1.56e-3)
    table.to_csv(tmp_path / "light.csv", index=False)
    other = table.assign(t=1e3 * table["t"], wavelength=1560.0)
    other = other.rename(columns={"t": "t [ms]", "wavelength": "wavelength [nm]", "I": "I [uA]"})
    other.to_parquet(tmp_path / "light.parquet")
    one, two = (
        read_samples(tmp_path / f"light.{kind}", UnitSystem()).series[1][0] for kind in ("csv", "parquet")
    )
    assert two.wavelength is not None and one.wavelength is not None
    np.testing.assert_allclose(two.t, one.t, rtol=1e-14)
    np.testing.assert_allclose(two.wavelength, one.wavelength, rtol=1e-14)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A stage with a cavity, its moves with true dL (true.csv) and with light alone (rows.csv, light.csv)."""
    folder = tmp_path_factory.mktemp("lab")
    text = (MACHINES / "distance.yaml").read_text()
    kind = "type: irradiance\n  wavelength: 0.00156\n  reflectivities: [0.04, 0.9]"
    text = text.replace("type: distance", kind)
    (folder / "machine.yaml").write_text(text)
    built = text.replace("rx: 90.7", "rx: 91.5").replace("z: 0.2", "z: 0.3").replace("rx: 88", "rx: 88.8")
    (folder / "built.yaml").write_text(
        built.replace("mirror: {in: flange, z: 0.2", "mirror: {in: flange, z: 0.3")
    )
    rng = np.random.default_rng(0)
    n = 8
    rows = pd.DataFrame({"pose": np.arange(n), "from": np.maximum(np.arange(n) - 1, 0)})
    for name, reach in (("x", 0.03), ("y", 0.03), ("t", 1.0)):
        rows[name] = rng.uniform(-reach, reach, n)
    rows.to_csv(folder / "rows.csv", index=False)
    machine = load_machine(folder / "built.yaml")
    change = predict(machine, load_recording(machine, [folder / "rows.csv"], need_observations=False))["dL"]
    rows.assign(dL=change).to_csv(folder / "true.csv", index=False)
    frames = []
    for pose in range(1, n):
        t = np.arange(0.0, 1.2, 1e-4)
        path = signals.displacement(t, 0.2, [(float(change[pose]), 0.0, 0.8)])
        run = signals.run(t, path, signals.Detector(), rng, 0.9, 2e-5, 0.2)
        frames.append(
            pd.DataFrame({"pose": pose, "t": run.t, "I [uA]": run.signal, "wavelength": run.wavelength})
        )
    pd.concat(frames).to_csv(folder / "light.csv", index=False)
    return folder


def calibrated(lab: Path, rows: str, *options: object) -> dict[str, Any]:
    output = lab / f"out_{rows}"
    # few rows: how they are read matters
    run("calibrate", lab / "machine.yaml", lab / rows, "-o", output, "--anyway", *options)
    fit: dict[str, Any] = json.loads((output / "fit.json").read_text())
    return fit


@pytest.mark.nightly
def test_light_calibrates_as_true_changes_of_length_do(lab: Path) -> None:
    known = calibrated(lab, "true.csv")
    counted = calibrated(lab, "rows.csv", "--irradiance", lab / "light.csv")
    assert counted["rows"] == known["rows"]
    moved, apart = 0.0, 0.0
    for name, one in counted["parameters"].items():
        other = known["parameters"][name]
        # counts are good to 1 nm, the sensor's sigma is 10 nm: a tenth of sigma, and as much to spare
        assert abs(one["value"] - other["value"]) <= 0.3 * other["std"] + 1e-12
        moved = max(moved, abs(other["value"] - other["nominal"]) / other["tolerance"])
        apart = max(apart, abs(one["value"] - other["value"]) / other["tolerance"])
    # what both found is far more than what they differ by: the readings moved the constants by many sigma
    assert apart < 0.1 * moved


def test_counted_changes_are_the_true_ones(lab: Path) -> None:
    machine = load_machine(lab / "machine.yaml")
    found = load_recording(machine, [lab / "rows.csv"], irradiance=[lab / "light.csv"])
    known = load_recording(machine, [lab / "true.csv"])
    assert found.from_row is not None and known.from_row is not None
    np.testing.assert_array_equal(found.from_row, known.from_row)  # nothing left out
    np.testing.assert_allclose(NM * found.observations["dL"], NM * known.observations["dL"], atol=TOLD)
    assert not any("nominal machine" in note for note in found.notes)


def unscanned(lab: Path, folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The first rows with their true changes (written as rows.csv without), and their light between the scans."""
    rows = pd.read_csv(lab / "true.csv").iloc[:4]
    rows.drop(columns="dL").to_csv(folder / "rows.csv", index=False)
    light = pd.read_csv(lab / "light.csv").drop(columns="wavelength")
    moving = light["t"].between(0.2 - 5e-5, 1.4 - 5e-5) & light["pose"].isin(rows["pose"])
    return rows, light[moving]


def test_without_scans_a_note_says_whose_the_sign_is(lab: Path, tmp_path: Path) -> None:
    rows, light = unscanned(lab, tmp_path)
    light.to_csv(tmp_path / "light.csv", index=False)
    # a machine known well enough that it tells the sign
    text = (lab / "built.yaml").read_text()
    for loose in ("beam.xyz: 2", "beam.angle: 2", "mirror.z: 1", "mirror.angle: 2"):
        text = text.replace(loose, loose[:-1] + "0.02")
    tight = text.replace("{length: 0.05, angle: 0.1}", "{length: 0.002, angle: 0.005}")
    assert tight != text
    machine = machine_from(tmp_path, tight, "machine")
    found = load_recording(machine, [tmp_path / "rows.csv"], irradiance=[tmp_path / "light.csv"])
    assert any("is that of the nominal machine" in note for note in found.notes), found.notes
    assert found.from_row is not None
    kept = np.flatnonzero(found.from_row == rows["from"])
    assert len(kept) > 1
    # three sigma of the sensor, 30 nm, is the coarsest that is let in; three times that for its error
    apart = found.observations["dL"][kept] - rows["dL"].to_numpy()[kept]
    assert NM * np.abs(apart).max() < 90.0


def test_signs_in_the_table_replace_scans(lab: Path, tmp_path: Path) -> None:
    rows, light = unscanned(lab, tmp_path)
    signs = np.sign(rows["dL"].to_numpy()).astype(int)
    light.assign(sign=signs[light["pose"]]).to_csv(tmp_path / "light.csv", index=False)
    machine = load_machine(lab / "machine.yaml")
    found = load_recording(machine, [tmp_path / "rows.csv"], irradiance=[tmp_path / "light.csv"])
    assert not any("nominal machine" in note for note in found.notes)
    kept = found.observations["dL"] != 0.0
    assert kept.sum() > 1
    apart = found.observations["dL"][kept] - rows["dL"].to_numpy()[kept]
    assert NM * np.abs(apart).max() < 90.0


def test_light_without_a_cavity_and_a_cavity_without_light_are_refused(lab: Path) -> None:
    machine = load_machine(lab / "machine.yaml")
    with input_error(r"rows\.csv: missing column 'dL'.*--irradiance"):
        load_recording(machine, [lab / "rows.csv"])
    with input_error("found 2 tables, expected 1"):
        load_recording(machine, [lab / "rows.csv"], irradiance=[lab / "light.csv"] * 2)
    plain = load_machine(MACHINES / "distance.yaml")
    with input_error("expected one of type irradiance"):
        load_recording(plain, [lab / "true.csv"], irradiance=[lab / "light.csv"])


def test_diagnose_takes_light_too(lab: Path) -> None:
    arguments = ["diagnose", MACHINES / "distance.yaml", lab / "true.csv", "-o", lab / "diagnosis"]
    result = CliRunner().invoke(app, [str(one) for one in (*arguments, "--irradiance", lab / "light.csv")])
    assert result.exit_code == 2
    assert "expected one of type irradiance" in result.stderr


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_there_and_back_is_no_change(seed: int) -> None:
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 2.2, 1e-4)
    far = 0.01 * (1.0 + rng.random())
    path = signals.displacement(t, 0.3, [(far, 0.0, 0.8), (-far, 0.5, 0.8)])
    run = signals.run(t, path, signals.Detector(), rng, 0.9, 2e-5)
    move = read(run)
    assert not move.faults
    assert move.count.turns == 1
    assert NM * abs(move.change) < TOLD


def test_brighter_light_on_a_background_is_read_as_well() -> None:
    run = series(4, gain=300.0, background=2.0)
    assert NM * read(run).change == pytest.approx(NM * run.change, abs=TOLD)


def test_too_few_samples_a_fringe_are_flagged() -> None:
    assert Fault.FAST in read(series(1, samples=3.0)).faults


def test_missing_samples_are_flagged() -> None:
    broken = cut(journeys(30.0, signals.Detector(), False), False)
    assert Fault.GAP in read(broken(np.random.default_rng(1))).faults


def test_noise_that_hides_fringes_is_flagged() -> None:
    assert Fault.WEAK in read(series(1, noise=0.3)).faults
