"""Records come back as they were, and the table, the page's lists and the counts say what they hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from support.fleets import mixed_machines
from truepose.identification.leaves.fleet.changes import Change, compare, sigma_limit
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


def record(
    name: str, rng: np.random.Generator | None = None, verdict: str = "adequate", key: str = "k"
) -> Record:
    shift = np.zeros(20) if rng is None else rng.standard_normal(20)
    parameters = {f"p{k}": (float(10.0 + 0.1 * shift[k]), 0.1) for k in range(20)}
    figures = {"verdict": verdict, "findings": ""}
    return Record(name=name, key=key, status="done", figures=figures, parameters=parameters)


def by_name(*records: Record) -> dict[str, Record]:
    return {one.name: one for one in records}


NAMES = st.sets(st.text("abc", min_size=1, max_size=3))


@given(NAMES, NAMES)
def test_machines_are_new_gone_or_as_they_were(before: set[str], after: set[str]) -> None:
    changes = compare(by_name(*map(record, before)), by_name(*map(record, after)))
    assert set(changes.new) == after - before and set(changes.gone) == before - after
    assert not changes.said and not changes.moved and changes.again == 0
    assert changes.any == (before != after)


def test_chance_moves_nothing() -> None:
    """Twice measured with the stated 1-sigma: in 200 runs of 500 parameters about 10 say that one has moved."""
    false = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        before, after = (
            by_name(*(record(f"m{k:02d}", rng, key=key) for k in range(25))) for key in ("a", "b")
        )
        changes = compare(before, after)
        assert changes.compared == 500 and changes.again == 25
        false += bool(changes.moved)
    assert false <= 20  # binomial of 200 and 0.05: more than 20 once in a thousand


def test_what_moved_is_told_with_its_size() -> None:
    before, after = record("m", key="a"), record("m", key="b")
    moved = after.model_copy(
        update={"parameters": {**after.parameters, "p3": (11.0, 0.1), "new": (0.0, 1.0)}}
    )
    changes = compare(by_name(before), by_name(moved))
    assert [(one.parameter, one.change) for one in changes.moved] == [("p3", 1.0)]
    assert changes.moved[0].sigma == pytest.approx(1.0 / (0.1 * np.sqrt(2.0)))
    assert changes.compared == 20


def test_the_limit_grows_with_the_number_compared() -> None:
    limits = [sigma_limit(count) for count in (0, 1, 10, 10**3, 10**6)]
    assert limits == sorted(limits) and limits[0] == 3.0
    assert 2 * 10**6 * norm.sf(limits[-1]) == pytest.approx(0.05)


def test_words_that_changed() -> None:
    before, after = record("m"), record("m", verdict="missing-physics", key="b")
    after.figures["findings"] = "backlash at q2"
    assert compare(by_name(before), by_name(after)).said == (
        Change("m", "verdict", "adequate", "missing-physics"),
        Change("m", "findings", "", "backlash at q2"),
    )
    failed = Record(name="m", key="c", status="failed", why="no such column")
    assert compare(by_name(after), by_name(failed)).said == (Change("m", "status", "done", "failed"),)
