"""What stands above a file's rows: its day, that rows are shuffled; and the digest of the whole."""

from __future__ import annotations

import codecs
import hashlib
from pathlib import Path

import pytest

from truepose.errors import InputError
from truepose.identification.recording.origin import digest_of, recorded_on, says_shuffled
from truepose.identification.recording.size import check_file, check_line, check_size
from truepose.models.file.limits import COLUMNS, LINE, ROWS

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
def test_the_day_stands_in_the_comments_above_the_rows(case: str, tmp_path: Path) -> None:
    text, day = DATED[case]
    path = tmp_path / "file.csv"
    path.write_text(text, encoding="utf-8")
    assert recorded_on(path) == day
    path.write_bytes(codecs.BOM_UTF16_LE + text.encode("utf-16-le"))
    assert recorded_on(path) == day
    path.write_bytes(b"\x00" + text.encode())  # no text
    assert recorded_on(path) == ""
    assert recorded_on(tmp_path) == recorded_on(tmp_path / "none") == ""


@pytest.mark.parametrize(("above", "found"), [(39, True), (40, False)])
def test_the_head_of_a_file_has_forty_lines(above: int, found: bool, tmp_path: Path) -> None:
    path = tmp_path / "file.csv"
    path.write_text("# a line\n" * above + "# 2026-03-14, order: shuffled\n", encoding="utf-8")
    assert (recorded_on(path) != "") is found and says_shuffled(path) is found


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
def test_shuffled_rows_are_said_in_a_comment(text: str, shuffled: bool, tmp_path: Path) -> None:
    path = tmp_path / "file.csv"
    path.write_text(text + ROW, encoding="utf-8")
    assert says_shuffled(path) is shuffled


def test_a_digest_is_of_all_bytes(tmp_path: Path) -> None:
    path = tmp_path / "file.csv"
    path.write_bytes(b"q1\r\n1\r\n")
    assert digest_of(path) == hashlib.sha256(b"q1\r\n1\r\n").hexdigest()
    assert digest_of("DataFrame") == digest_of(tmp_path) == ""


def test_a_table_is_as_large_as_allowed_and_not_larger(tmp_path: Path) -> None:
    check_size("file.csv", COLUMNS, ROWS)
    with pytest.raises(InputError, match=rf"found {COLUMNS + 1:,} columns, expected at most {COLUMNS:,}"):
        check_size("file.csv", COLUMNS + 1, 0)
    with pytest.raises(InputError, match=rf"found {ROWS + 1:,} rows, expected at most {ROWS:,}"):
        check_size("file.csv", 1, ROWS + 1)
    assert check_line("file.csv", "x" * LINE) == "x" * LINE
    with pytest.raises(InputError, match=rf"a line of more than {LINE:,} characters"):
        check_line("file.csv", "x" * (LINE + 1))
    check_file(tmp_path)
    check_file(tmp_path / "none")
    with pytest.raises(InputError, match=r"^/dev/null: expected a file, found a device or a pipe$"):
        check_file(Path("/dev/null"))


@pytest.mark.parametrize(("more", "refused"), [(0, False), (1, True)])
def test_a_file_that_takes_minutes_is_refused_by_its_size(more: int, refused: bool, tmp_path: Path) -> None:
    """No byte of it is written: a file with a hole."""
    from truepose.models.file.limits import RECORDING_BYTES

    path = tmp_path / "file.csv"
    with path.open("wb") as stream:
        stream.truncate(RECORDING_BYTES + more)
    if refused:
        gigabytes = f"{RECORDING_BYTES / 1e9:.1f} GB"
        with pytest.raises(InputError, match=f"found {gigabytes}, expected at most {gigabytes}"):
            check_file(path)
    else:
        check_file(path)
