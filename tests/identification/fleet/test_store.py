"""Records are kept as they are; what is cut off is no record."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truepose.identification.leaves.fleet.record import JOURNAL, RECORDS, STATUSES, Record, Records

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
ANY = st.builds(
    Record,
    name=st.text(st.characters(codec="utf-8")),
    key=st.text(st.characters(codec="utf-8")),
    status=st.sampled_from(STATUSES),
    why=st.text(st.characters(codec="utf-8")),
    figures=st.dictionaries(
        st.text(st.characters(codec="utf-8")), st.one_of(st.none(), NUMBERS, st.booleans())
    ),
    parameters=st.dictionaries(st.text(st.characters(codec="utf-8")), st.tuples(NUMBERS, NUMBERS)),
)


def plain(number: int, key: str = "k") -> Record:
    return Record(f"m{number:05d}", key, "failed", f"why {number}")


@given(ANY)
def test_a_record_comes_back_from_its_line(record: Record) -> None:
    assert Record.of_text(record.text()) == record
    assert "\n" not in record.text()


@given(ANY, st.integers(1))
def test_a_line_that_was_cut_off_is_no_record(record: Record, cut: int) -> None:
    text = record.text()
    assert Record.of_text(text[: cut % len(text)]) is None


@pytest.mark.parametrize("text", ["", "[]", "1", "{}", '{"schema":"truepose/fleet-record/2"}'])
def test_what_another_program_wrote_is_no_record(text: str) -> None:
    assert Record.of_text(text) is None


def test_a_journal_goes_on_after_a_line_that_was_cut_off(tmp_path: Path) -> None:
    journal = Records(tmp_path / "results" / JOURNAL)
    with journal.open() as stream:
        journal.note(stream, plain(2))
        stream.write(plain(3).text()[:40])  # killed
    with journal.open() as stream:
        journal.note(stream, plain(1))
        journal.note(stream, replace(plain(2), key="later"))
        journal.note(stream, Record("m9", "k", "broken"))
    assert journal.keys() == {"m00001": "k", "m00002": "later"}
    everything = {f"m{number:05d}": "k" for number in range(5)}
    assert list(journal.read(everything)) == [plain(1)]  # of the second there is another key
    assert Records(tmp_path / "none").keys() == {}


def test_records_come_back_as_they_were_written(tmp_path: Path) -> None:
    kept, records = Records(tmp_path / RECORDS), [plain(number) for number in range(300)]
    assert not kept.exists and kept.keys() == {} and list(kept.read()) == []
    kept.write(records)
    assert kept.exists and list(kept.read()) == records
    assert kept.keys() == {record.name: "k" for record in records}
    before = kept.path.read_bytes()
    kept.write(list(kept.read()))
    assert kept.path.read_bytes() == before


def test_what_another_version_or_program_left_is_passed_over(tmp_path: Path) -> None:
    kept = Records(tmp_path / RECORDS)
    kept.write([plain(1), plain(2)])
    text = kept.path.read_text(encoding="utf-8")
    kept.path.write_text(text.replace("fleet-record/1", "fleet-record/0", 1) + "PAR1\n", encoding="utf-8")
    assert kept.keys() == {"m00002": "k"} and list(kept.read()) == [plain(2)]
