"""``truepose import``: small files of each format, joined with joints by name or by order, refused where neither holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support.command import input_error, refused, run
from support.skips import NOTHING_BESIDE, SHARED
from support.workbook import write_workbook
from truepose.identification.leaves.readers.importing import read_foreign
from truepose.identification.leaves.readers.tpoint import read_tpoint
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.table import read_table
from truepose.models.load import load_machine

XYZ = [[1234.5678, -12.5, 800.0], [1300.25, 40.125, 790.5], [1400.0, 99.0, -3.25]]
JOINTS = "name,q1,q2\nP1,0,10\nP2,20,30\nP3,-5.5,60\n"
FILES = {
    "spatialanalyzer, commas": """// SpatialAnalyzer 2023.1
// Working Frame: A::WORLD
// Units: Millimeters
A::Main::P1, 1234.5678, -12.5, 800.0
A::Main::P2, 1300.25, 40.125, 790.5
A::Main::P3, 1400.0, 99.0, -3.25
""",
    "spatialanalyzer, spaces and inches": """// Units: Inches
A Main P1  48.6050315  -0.4921259843  31.496062992
A Main P2  51.19094488 1.579724409    31.122047244
A Main P3  55.118110236 3.897637795   -0.1279527559
""",
    "spatialanalyzer, whole numbers as names": """// SA
A Main 1 1234.5678 -12.5 800.0
A Main 2 1300.25 40.125 790.5
A Main 3 1400.0 99.0 -3.25
""",
    "leica, list with scatter": """! Leica Axyz point list, units: mm
Station1/P1 1234.5678 -12.5 800.0 0.011 0.012 0.010 2024-05-02 10:11:12
Station1/P2 1300.25 40.125 790.5 0.011 0.013 0.010 2024-05-02 10:12:12
Station1/P3 1400.0 99.0 -3.25 0.011 0.012 0.011 2024-05-02 10:13:12
""",
    "leica, headings and metres": """Leica Tracker Pilot
PointId;X [m];Y [m];Z [m];Rms
P1;1,2345678;-0,0125;0,8;0,01
P2;1,30025;0,040125;0,7905;0,01
P3;1,4;0,099;-0,00325;0,01
""",
    "faro, labels": """FARO CAM2 Measure, Units: mm
P1 X 1234.5678 Y -12.5 Z 800.0
P2 X 1300.25 Y 40.125 Z 790.5
P3 X 1400.0 Y 99.0 Z -3.25
""",
    "faro, headings": """# FARO tracker
Name\tX\tY\tZ\tRMS
P1\t1234.5678\t-12.5\t800.0\t0.01
P2\t1300.25\t40.125\t790.5\t0.01
P3\t1400.0\t99.0\t-3.25\t0.01
""",
    "a table": "Point,X (mm),Y (mm),Z (mm)\nP1,1234.5678,-12.5,800.0\nP2,1300.25,40.125,790.5\nP3,1400.0,99.0,-3.25\n",
}


def _imported(folder: Path, text: str, *options: object, joints: str = JOINTS) -> pd.DataFrame:
    (folder / "points.txt").write_text(text, encoding="utf-8")
    (folder / "joints.csv").write_text(joints, encoding="utf-8")
    out = folder / "recording.csv"
    run("import", folder / "points.txt", "-o", out, "--joints", folder / "joints.csv", *options)
    table = read_table(out)
    return pd.DataFrame({name: table.numbers(name) for name in ("q1", "q2", "x", "y", "z")}) * [
        1, 1, *({"mm": 1.0, "m": 1e3, "inch": 25.4}[str(c.unit)] for c in table.columns if c.name in "xyz")
    ]  # fmt: skip


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("told", [True, False])
def test_points_of_every_format_stand_beside_their_joints(tmp_path: Path, name: str, told: bool) -> None:
    form = name.partition(",")[0]
    options = ["--format", "table" if form == "a table" else form] if told else []
    frame = _imported(tmp_path, FILES[name], *options, joints=_joints_for(name))
    np.testing.assert_allclose(frame[["x", "y", "z"]], XYZ, rtol=1e-8)
    np.testing.assert_array_equal(frame["q2"], [10, 30, 60])


def _joints_for(name: str) -> str:
    return JOINTS.replace("P", "") if "whole numbers" in name else JOINTS


FIRST = FILES["leica, list with scatter"]
REFUSED = {
    "fewer joints": (FIRST, "name,q1\nP1,0\nP2,1\n", "joints.csv: found 2 rows of joints, expected 3"),
    "another name": (FIRST, JOINTS.replace("P3", "P9"), "joints.csv: column 'name': found 'P9', no point of"),
    "a name twice": (FIRST, JOINTS.replace("P3", "P2"), "joints.csv: row 3 (line 4), column 'name': found 'P2' again"),
    "a point twice": (FIRST.replace("P3", "P2"), JOINTS, "points.txt: row 3 (line 4), column 'name': found 'Station1/P2'"),
    "x in both": (FIRST, JOINTS.replace("q2", "x"), "joints.csv: column 'x': found there and in"),
    "a broken line": (FIRST.replace("40.125", "n/a"), JOINTS, "points.txt: line 3: found"),
    "no point": ("! Leica\n", JOINTS, "points.txt: found no point"),
    "a unit that is none": (FIRST, JOINTS, "unit 'deg' is an angle, expected a length", "--unit", "deg"),
    "no format": (FIRST, JOINTS, "--format: found 'zeiss', expected auto, spatialanalyzer", "--format", "zeiss"),
    "no rename": (FIRST, JOINTS, "--rename: found 'q1', expected OLD=NEW", "--rename", "q1"),
    "a name that is taken": (FIRST, JOINTS, "--rename q1=q2: found a column 'q2' already", "--rename", "q1=q2"),
    "no such column": (FIRST, JOINTS, "--rename a=b: found no column 'a'", "--rename", "a=b"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_does_not_fit_is_refused(tmp_path: Path, case: str) -> None:
    text, joints, expected, *options = REFUSED[case]
    (tmp_path / "points.txt").write_text(text, encoding="utf-8")
    (tmp_path / "joints.csv").write_text(joints, encoding="utf-8")
    out = tmp_path / "recording.csv"
    files = (tmp_path / "points.txt", "-o", out, "--joints", tmp_path / "joints.csv")
    refused("import", *files, *options, said=expected)
    assert not out.exists()


def test_a_unit_that_nobody_states_is_told(tmp_path: Path) -> None:
    (tmp_path / "points.txt").write_text("P1 1.0 2.0 3.0\nP2 4.0 5.0 6.0\n", encoding="utf-8")
    found = read_foreign(tmp_path / "points.txt")
    assert found.notes == (
        f"{tmp_path / 'points.txt'}: states no unit: its lengths are taken as mm (--unit says otherwise)",
    )
    assert read_foreign(tmp_path / "points.txt", unit="m").unit("x", "mm", "mm") == "m"
    assert found.texts("name") == ("P1", "P2")


def test_turns_of_a_probe_are_left_out_with_a_note(tmp_path: Path) -> None:
    (tmp_path / "points.txt").write_text(
        "! Leica T-Probe\nId X[mm] Y[mm] Z[mm] Rx Ry Rz\nP1 1 2 3 10 20 30\n"
    )
    found = read_foreign(tmp_path / "points.txt")
    assert found.names == ("name", "x", "y", "z")
    assert "rx, ry, rz left out: the file does not say which rotation they mean" in found.notes[0]


def test_a_workbook_becomes_a_recording(tmp_path: Path) -> None:
    pytest.importorskip("python_calamine")
    write_workbook(tmp_path / "rows.xlsx", {"a": [["q1", "X"], [1.5, 2.0], [3.0, None]]})
    options = ("--rename", "q1=j1", "--unit", "um", "--json")
    run("import", tmp_path / "rows.xlsx", "-o", tmp_path / "r.csv", *options)
    assert (tmp_path / "r.csv").read_text().splitlines()[-3:] == ["j1,x [um]", "1.5,2.0", "3.0,"]


TPOINT = """A caption
:NODA
:{mount}
+40 30 00 2024 05 02 10.0 990.0 200.0 0.5 0.55 0.0065
! a star
12 00 00.0 +30 00 00.0 12 00 04.0 +30 01 00.0 13 00.0
12 00 00.0 -10 30 00.0 12 00 00.0 -10 30 00.0 06 00.0
END
"""


def test_a_mounts_stars_bring_a_machine_file(tmp_path: Path) -> None:
    (tmp_path / "stars.dat").write_text(TPOINT.format(mount="ALTAZ"))
    machine, recording = tmp_path / "mount.yaml", tmp_path / "stars.csv"
    run("import", tmp_path / "stars.dat", "-o", recording, "--machine", machine)
    found = load_recording(load_machine(machine), [recording])
    assert found.joints == ("az", "alt")
    assert set(found.observations) == {"star.az", "star.alt"}
    # the second star is read where it is
    assert np.degrees(found.q[1]) == pytest.approx(
        [np.degrees(found.observations[f"star.{n}"][1]) for n in ("az", "alt")]
    )


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("+40 30 00", "north", "stars.dat: line 4: found 'north 2024.*', expected a latitude first"),
        ("+30 00 00.0", "+30 61 00.0", "stars.dat: line 6: found '12 00 00.0.*', expected right ascension"),
        ("12 00 00.0 +30", "10001 00 00.0 +30", "expected right ascension"),
        ("13 00.0", "13", "expected right ascension"),
        (":NODA", ":GIMBAL", "option :GIMBAL: expected a mount"),
        ("12 00 00.0", "END", "found no star"),
    ],
)
def test_stars_that_cannot_be_read_are_refused(old: str, new: str, expected: str) -> None:
    with input_error(expected):
        read_tpoint(TPOINT.format(mount="EQUAT").replace(old, new), "stars.dat")


def stars_by_hand(path: Path) -> dict[str, np.ndarray]:
    """Encoders (deg) and directions (mm) of every star of a TPOINT file of an equatorial mount."""
    fields = [line.split() for line in path.read_text().splitlines() if line[:1] not in "!:"]
    rows = [line for line in fields if len(line) >= 14]

    def angle(first: int, hours: bool, parts: int = 3) -> np.ndarray:
        text = [row[first : first + parts] for row in rows]
        size = np.array([sum(abs(float(w)) / 60.0**k for k, w in enumerate(words)) for words in text])
        sign = np.array([-1.0 if words[0].startswith("-") else 1.0 for words in text])
        return np.asarray(np.radians(sign * size * (15.0 if hours else 1.0)))

    ra, dec, ra_read, dec_read = angle(0, True), angle(3, False), angle(6, True), angle(9, False)
    sidereal = angle(12, hours=True, parts=2)
    hour = sidereal - ra
    point = 1000.0 * np.array([np.cos(dec) * np.cos(hour), -np.cos(dec) * np.sin(hour), np.sin(dec)])
    turned = np.degrees(np.angle(np.exp(1j * (ra_read - sidereal))))
    return {"q1": turned, "q2": np.degrees(dec_read), **dict(zip("xyz", point, strict=True))}


def test_a_real_mounts_stars_are_those_of_a_plain_reader() -> None:
    path = SHARED / "data/telescope-mount/gem-28.dat"
    if not path.is_file():
        pytest.skip(NOTHING_BESIDE)
    found = read_foreign(path)
    assert found.n_rows == 454
    for name, expected in stars_by_hand(path).items():
        np.testing.assert_allclose(found.numbers(name), expected, atol=1e-9)


def test_stars_of_an_altazimuth_mount_are_turned_by_the_latitude() -> None:
    found = read_tpoint(TPOINT.format(mount="ALTAZ"), "stars.dat")
    # at hour angle -6 h a star of declination d stands at sin(alt) = sin(d) sin(latitude), tan(az) = cot(d) / cos(latitude)
    declination, latitude = np.radians(-10.5), np.radians(40.5)
    altitude = np.arcsin(np.sin(declination) * np.sin(latitude))
    azimuth = np.arctan2(np.cos(declination), np.sin(declination) * np.cos(latitude))
    np.testing.assert_allclose(found.numbers("q2")[1], np.degrees(altitude))
    np.testing.assert_allclose(found.numbers("q1")[1], -np.degrees(azimuth))
    point = np.array([found.numbers(axis)[1] for axis in "xyz"])
    q1, q2 = np.radians([found.numbers("q1")[1], found.numbers("q2")[1]])
    np.testing.assert_allclose(
        point, 1000 * np.array([np.cos(q2) * np.cos(q1), np.cos(q2) * np.sin(q1), np.sin(q2)])
    )


def test_stars_of_an_equatorial_mount(tmp_path: Path) -> None:
    found = read_tpoint(TPOINT.format(mount="EQUAT"), "stars.dat")
    # an hour past the meridian: 15 deg to the west; the encoders say 4 s, a minute of arc, less
    np.testing.assert_allclose(found.numbers("q1"), [-15 + 1 / 60, 90.0], atol=1e-9)
    np.testing.assert_allclose(found.numbers("q2"), [30 + 1 / 60, -10.5], atol=1e-9)
    points = np.column_stack([found.numbers(axis) for axis in "xyz"])
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1000.0)
    cosine, turn = np.cos(np.radians(30)), np.radians(-15)
    np.testing.assert_allclose(
        points[0], 1000 * np.array([cosine * np.cos(turn), cosine * np.sin(turn), 0.5])
    )
