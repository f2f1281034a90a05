"""What stands above a file's rows: its day, that rows are shuffled; and the digest of the whole."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from truepose.identification.recording.text import digest_of, recorded_on, says_shuffled

ROW = "1.0, 2.0\n"
DATED = {
    "a comment": ("# recorded 2026-03-14 in the hall\n" + ROW, "2026-03-14"),
    "the first of two": ("# 2026-03-14 to 2026-03-15\n# 2025-01-01\n" + ROW, "2026-03-14"),
    "indented": ("   ! 2026-03-14\n" + ROW, "2026-03-14"),
    "two strokes": ("// 1999-12-31\n" + ROW, "1999-12-31"),
    "behind the header": ("q1, q2\n# 2026-03-14\n" + ROW, "2026-03-14"),
    "behind one number": ("7\n# 2026-03-14\n" + ROW, "2026-03-14"),
    "no such day": ("# 2026-02-30, at last 2026-03-01\n" + ROW, "2026-03-01"),
    "part of a number": ("# serial 12026-03-14 2026-03-145\n" + ROW, ""),
    "another century": ("# 1826-03-14\n" + ROW, ""),
    "below the rows": (ROW + "# 2026-03-14\n", ""),
    "below rows with exponents": ("-1e-3;.5\n# 2026-03-14\n", ""),
    "no comment": ("measured 2026-03-14\n" + ROW, ""),
    "nothing": ("", ""),
}


@pytest.mark.parametrize("case", DATED)
def test_the_day_stands_in_the_comments_above_the_rows(case: str) -> None:
    text, day = DATED[case]
    assert recorded_on(text) == day


@pytest.mark.parametrize(
    ("text", "shuffled"),
    [
        ("# order: shuffled\n", True),
        ("% ORDER =Shuffled, seed 3\n", True),
        ("* rows in no order: shuffled\n", True),
        ("# disorder: shuffled\n", False),
        ("# order: shuffledness\n", False),
        ("# order shuffled\n", False),
        ("order: shuffled\n", False),
        (ROW + "# order: shuffled\n", False),
    ],
)
def test_shuffled_rows_are_said_in_a_comment(text: str, shuffled: bool) -> None:
    assert says_shuffled(text + ROW) is shuffled


def test_a_digest_is_of_all_bytes(tmp_path: Path) -> None:
    path = tmp_path / "file.csv"
    path.write_bytes(b"q1\r\n1\r\n")
    assert digest_of(path) == hashlib.sha256(b"q1\r\n1\r\n").hexdigest()
    assert digest_of(tmp_path / "none") == digest_of(tmp_path) == ""
