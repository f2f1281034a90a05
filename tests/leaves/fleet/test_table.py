"""Records come back as they were, and the table, the page's lists and the counts say what they hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.fleets import mixed_machines
from truepose.identification.leaves.fleet.odd import oddness
from truepose.identification.leaves.fleet.page import fleet_document
from truepose.identification.leaves.fleet.pooled import Pooled
from truepose.identification.leaves.fleet.record import Record, read_records, write_records
from truepose.identification.leaves.fleet.statistics import statistics
from truepose.identification.leaves.fleet.table import SHOWN, Fleet, fleet_table
from truepose.shown.document import Table

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
TEXT = st.text(st.characters(codec="utf-8"))
RECORDS = st.builds(
    Record,
    name=TEXT,
    key=TEXT,
    status=st.sampled_from(["done", "failed"]),
    why=TEXT,
    figures=st.dictionaries(TEXT, st.one_of(st.none(), NUMBERS, st.booleans())),
    parameters=st.dictionaries(TEXT, st.tuples(NUMBERS, NUMBERS)),
)


@given(st.lists(RECORDS, unique_by=lambda record: record.name), st.integers(1))
def test_records_come_back_and_what_was_cut_off_is_none(
    tmp_path_factory: pytest.TempPathFactory, records: list[Record], cut: int
) -> None:
    file = tmp_path_factory.mktemp("records") / "records.jsonl"
    write_records(file, records)
    assert list(read_records(file).values()) == records
    text = file.read_bytes()
    last = len(records[-1].model_dump_json().encode()) if records else 0
    if last:  # in the middle of its last line
        file.write_bytes(text[: -2 - cut % (last - 1)])
        assert read_records(file) == {}


def test_what_another_program_wrote_is_no_record(tmp_path: Path) -> None:
    file = tmp_path / "record.json"
    assert read_records(file) == {}
    for text in (
        "",
        "[]",
        "1",
        "{}",
        '{"schema_":"truepose/fleet-record/9","name":"a","key":"","status":"done"}',
    ):
        file.write_text(text, encoding="utf-8")
        assert read_records(file) == {}


def fleet(number: int, status: str = "done") -> Fleet:
    """Machines of which two in ten are no calibration, or could not be worked with."""
    records = []
    for k, evidence in enumerate(mixed_machines(np.random.default_rng(6), number)):
        own = {0: "refused", 1: "failed"}.get(k % 10, status)
        more = (
            {"figures": {"verdict": evidence["verdict"]}, "evidence": evidence}
            if own in ("done", "refused")
            else {}
        )
        records.append(Record(name=f"m{k:04d}", key="k", status=own, **more))
    pooled = Pooled.of([record.evidence for record in records if record.status == "done"])
    return Fleet("line", fleet_table(records, oddness(pooled)), statistics(pooled), None)


def test_oddness_is_told_of_calibrations_alone_the_oddest_first() -> None:
    found = fleet(60)
    table = found.table
    assert table["name"].tolist() == [f"m{k:04d}" for k in range(60)]
    assert table["oddness"].notna().tolist() == table["status"].eq("done").tolist()
    assert found.count("status") == {"done": 48, "failed": 6, "refused": 6} and found.diagnosed == 54
    assert sum(found.count("verdict").values()) == 54
    assert len(found.odd) > 1 and found.odd["odd"].all() and found.odd["oddness"].is_monotonic_decreasing
    assert found.undone["name"].tolist() == [f"m{k:04d}" for k in range(1, 60, 10)]


def test_the_page_counts_all_and_shows_some() -> None:
    document = fleet_document(fleet(SHOWN + 60, "broken"))
    assert ("machines", str(SHOWN + 60)) in document.facts
    (table,) = document.sections()[-1].blocks
    assert isinstance(table, Table) and len(table.rows) == SHOWN
    assert f"Shown are {SHOWN} of {SHOWN + 60}." in table.caption
