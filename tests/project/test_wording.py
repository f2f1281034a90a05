"""Lists, names and texts of strangers in messages: whole where they are short, cut where they are not."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truepose import files
from truepose.errors import InputError, TrueposeError
from truepose.identification.leaves.programs.dialects import text_of
from truepose.identification.leaves.readers.importing import read_foreign
from truepose.identification.recording.table import read_table
from truepose.models.builders.urdf_file import read_urdf
from truepose.models.file.yaml_document import read_document
from truepose.wording import close_matches, cut, joined, meant, shortened


@pytest.mark.parametrize(
    ("parts", "told"), [([], ""), (["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c")]
)
def test_a_list_reads_as_a_sentence(parts: list[str], told: str) -> None:
    assert joined(parts) == told
    assert joined(parts, "or") == told.replace(" and ", " or ")


@pytest.mark.parametrize(
    ("most", "told"), [(1, "a and 2 more"), (2, "a, b and 1 more"), (3, "a, b, c"), (4, "a, b, c")]
)
def test_a_long_list_tells_how_many_follow(most: int, told: str) -> None:
    assert shortened(["a", "b", "c"], most) == told


def test_a_slip_of_a_key_is_recognised() -> None:
    """As far as names are near; what is too long for a name is compared with none."""
    names = ["shoulder", "elbow", "wrist"]
    assert meant("elbwo", names) == "did you mean 'elbow'?"
    assert meant("payload", names) == ""
    assert meant("axis1", ["axis2", "axis3", "axis4", "axis5"]).count(" or ") == 2
    longest = "n" * 60
    assert meant(longest, [longest + "m"]) == f"did you mean {longest + 'm'!r}?"
    assert meant(longest + "n", [longest]) == ""
    assert meant(longest, ["n" * 120]) != "" and meant(longest, ["n" * 121]) == ""


def test_where_nothing_is_near_all_names_are_told() -> None:
    assert close_matches("payload", []) == ""
    assert close_matches("payload", ["b", "a", "b"]) == "known: a, b"
    many = [f"x{k:02d}" for k in range(31)]
    assert close_matches("payload", many).endswith("x29 and 1 more")
    assert close_matches("payload", many[:30]).endswith("x28, x29")


@pytest.mark.parametrize(("letters", "more"), [(5, False), (6, True)])
def test_a_text_is_cut_where_it_is_longer_than_its_room(letters: int, more: bool) -> None:
    text = "abcdefgh"[:letters]
    assert cut(text, 5) == text[:5] + "..." * more


def test_what_no_line_holds_is_left_out_before_a_text_is_cut() -> None:
    """A text of blanks and controls alone is short, but not that of a file as long as four lines."""
    assert cut("a\n\t\x07b   c", 5) == "a b c"
    assert cut(" " * 20, 5) == ""
    assert cut("ab" + " " * 19, 5) == "ab..."


def test_every_file_that_is_read_has_one_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file.bin"
    path.write_bytes(b"x" * 20)
    monkeypatch.setattr(files, "FILE_BYTES", 20)
    assert files.read_input(path) == b"x" * 20
    monkeypatch.setattr(files, "FILE_BYTES", 19)
    for read in (read_table, read_foreign, read_document, text_of, read_urdf):
        with pytest.raises(
            InputError, match=r"file\.bin: cannot read the file: found 0\.00 GB, expected at most"
        ):
            read(path)


def test_what_is_no_file_is_not_waited_for(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        files.read_input(tmp_path / "none")
    with pytest.raises(InputError, match="expected a file, found a device or a pipe"):
        files.read_input(Path("/dev/null"))


def test_of_a_long_text_no_more_than_its_beginning_is_looked_at() -> None:
    """Four times what is shown; a file may be a million blanks before a word."""
    assert cut(" " * 39 + "word", 10) == "w..."
    assert cut(" " * 40 + "word", 10) == "..."
    assert cut(" " * 36 + "word", 10) == "word"


LONGEST, BETWEEN = 1500, " [...] "


@given(st.text(max_size=40), st.integers(1, 400))
def test_a_message_can_be_shown(text: str, times: int) -> None:
    said = str(TrueposeError(text * times))
    assert len(said) <= LONGEST + len(BETWEEN)
    assert all(c.isprintable() or c == "\n" for c in said)


@given(st.text(st.characters(categories=["L", "N", "P"], include_characters=" \n"), max_size=LONGEST))
def test_one_that_can_be_shown_is_said_as_it_is(text: str) -> None:
    assert str(TrueposeError(text)) == text


def test_a_long_one_keeps_its_beginning_and_its_end() -> None:
    text = "".join(chr(ord("a") + k % 26) for k in range(LONGEST + 1))
    assert str(TrueposeError(text)) == text[: LONGEST // 2] + BETWEEN + text[-LONGEST // 2 :]
    assert str(TrueposeError("\x1b[31m")) == "\\x1b[31m"
