"""Where a recording is from: digests of its files and the day that their comments state."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.examples import examples
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.origin import digest_of, recorded_on
from truepose.models.machine.machine import Machine

LAWS = settings(max_examples=examples(120), deadline=None)


@given(data=st.binary(max_size=300))
@LAWS
def test_a_digest_is_that_of_the_bytes(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "digested"
    path.write_bytes(data)
    assert digest_of(path) == digest_of(str(path)) == hashlib.sha256(data).hexdigest()
    recorded_on(path)  # whatever it holds


def test_what_is_no_file_has_no_digest_and_no_day(tmp_path: Path) -> None:
    for nothing in (tmp_path, tmp_path / "none.csv", "a table in memory"):
        assert digest_of(nothing) == recorded_on(nothing) == ""


ROWS = "q1 [deg],q2 [deg],x,y,z\n1,2,3,4,5\n"


@pytest.mark.parametrize(
    ("text", "day"),
    [
        (f"# measured 2026-03-14 in hall 3\n{ROWS}", "2026-03-14"),
        (f"# measured 2026-03-14T10:20:00Z\n{ROWS}", "2026-03-14"),
        (f"\ufeff# measured 2026-03-14\n{ROWS}", "2026-03-14"),
        (f"\n\n  ! 1999-12-31, then 2026-03-14\n{ROWS}", "1999-12-31"),
        (f"% run20260314\n% 2026-03-14\n{ROWS}", "2026-03-14"),
        ("// 2026-03-14\nTarget X Y Z\nP1 1.0 2.0 3.0\n", "2026-03-14"),
        ("Survey of hall 3\n! 2026-03-14\nP1 1.0 2.0 3.0\n", "2026-03-14"),
        (ROWS, ""),
        (f"{ROWS}# 2026-03-14\n", ""),  # below the data: it may be of anything
        ("day,q1,q2\n2026-03-14,1,2\n", ""),  # a cell, no comment
        (";day;q1;q2\n;2026-03-14;1;2\n", ""),
        (f"measured 2026-03-14\n{ROWS}", ""),
        (f"# part 12026-03-14, 2026-03-141, 2026-13-14, 2026-02-30, 1826-03-14\n{ROWS}", ""),
        (f"# 2026-02-30 2026-03-14\n{ROWS}", "2026-03-14"),
        ("#\n" * 60 + f"# 2026-03-14\n{ROWS}", ""),  # far down
    ],
)
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_a_day_is_that_of_the_comments_above_the_data(tmp_path: Path, text: str, day: str, ends: str) -> None:
    path = tmp_path / "rows.csv"
    path.write_bytes(text.replace("\n", ends).encode())
    assert recorded_on(path) == day


def test_a_day_is_read_in_other_encodings_and_in_no_binary_file(tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    for encoding in ("utf-16", "utf-8-sig", "latin-1"):
        path.write_bytes(f"# gemessen in Jülich, 2026-03-14\n{ROWS}".encode(encoding))
        assert recorded_on(path) == "2026-03-14"
    path.write_bytes(b"PAR1\x00\n# 2026-03-14\n")
    assert recorded_on(path) == ""


def test_a_recording_knows_its_files_digests_and_days(machine: Machine, tmp_path: Path) -> None:
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for path, head in zip(paths, ("# 2026-03-14\n", ""), strict=True):
        path.write_text(head + ROWS)
    recording = load_recording(machine, paths)
    assert recording.digests == tuple(hashlib.sha256(p.read_bytes()).hexdigest() for p in paths)
    assert recording.dates == ("2026-03-14", "")
