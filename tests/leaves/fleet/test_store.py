"""Records are kept as they are; what is cut off is no record; sums of what changed are the sums of all."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truepose.errors import InputError
from truepose.identification.leaves.fleet.record import STATUSES, Record
from truepose.identification.leaves.fleet.store import GROUP, JOURNAL, STORE, SUMS, Journal, Line, Store
from truepose.identification.leaves.fleet.summary import Summary

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
RECORDS = st.builds(
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


def line(record: Record, source: Path) -> Line:
    return Line(record.name, record.key, record.final, record.text(), source)


@given(RECORDS)
def test_a_record_comes_back_from_its_line(record: Record) -> None:
    assert Record.of_text(record.text()) == record
    assert "\n" not in record.text()


@given(RECORDS, st.integers(1))
def test_a_line_that_was_cut_off_is_no_record(record: Record, cut: int) -> None:
    text = record.text()
    assert Record.of_text(text[: cut % len(text)]) is None


@pytest.mark.parametrize("text", ["", "[]", "1", "{}", '{"schema":"truepose/fleet-record/2"}'])
def test_what_another_program_wrote_is_no_record(text: str) -> None:
    assert Record.of_text(text) is None


def test_a_journal_goes_on_after_a_line_that_was_cut_off(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "results" / JOURNAL)
    with journal.open() as stream:
        journal.note(stream, plain(2))
        stream.write(plain(3).text()[:40])  # killed
    with journal.open() as stream:
        journal.note(stream, plain(1))
        journal.note(stream, replace(plain(2), key="later"))
        journal.note(stream, Record("m9", "k", "broken"))
    assert journal.keys() == {"m00001": "k", "m00002": "later"}
    everything = {f"m{number:05d}": "k" for number in range(5)}
    assert list(journal.lines(everything)) == [
        line(plain(1), journal.path)
    ]  # of the second there is another key
    assert Journal(tmp_path / "none").keys() == {}


def test_a_store_gives_back_what_was_written(tmp_path: Path) -> None:
    store, records = Store(tmp_path), [plain(number) for number in range(GROUP + 3)]
    assert not store.exists and store.keys() == {} and list(store.records()) == []
    store.write(line(record, tmp_path) for record in records)
    assert list(store.records()) == records
    assert list(store.lines()) == [line(record, store.path) for record in records]
    assert store.keys() == {record.name: "k" for record in records}
    before = (tmp_path / STORE).read_bytes()
    store.write(list(store.lines()))
    assert (tmp_path / STORE).read_bytes() == before
    assert store.summary() is None
    store.write_summary(Summary.empty())
    assert store.summary() == Summary.empty()
    store.write(line(record, tmp_path) for record in records[1:])
    assert store.summary() is None  # these are the sums of other records


def test_files_of_others_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / STORE).write_bytes(b"PAR1 something")
    (tmp_path / SUMS).write_text(json.dumps({"schema": "truepose/fleet-summary/9"}), encoding="utf-8")
    with pytest.raises(InputError, match=r"found no table of truepose fleet .* delete it to begin anew"):
        Store(tmp_path).keys()
    assert Store(tmp_path).summary() is None
