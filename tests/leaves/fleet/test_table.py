"""Which machines a folder holds; their records, tables and pages; what changed between two runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from support.command import input_error
from support.fleets import mixed_machines
from truepose.identification.leaves.fleet.changes import Change, compare, sigma_limit
from truepose.identification.leaves.fleet.folder import Member, members
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


def put(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name, encoding="utf-8")


def found(folder: Path) -> dict[str, Member]:
    return {member.name: member for member in members(folder, folder / "results")}


def told(folder: Path, member: Member) -> list[str]:
    return [str(file.relative_to(folder)) for file in member.files]


def test_three_layouts_side_by_side(tmp_path: Path) -> None:
    put(tmp_path, "a/own.yaml", "a/day2.csv", "a/day1.parquet", "a/readme.md", "a/.hidden.csv")
    put(tmp_path, "b/machine.yaml", "b/other.yaml", "b/recordings/1.csv", "b/notes.csv")
    put(tmp_path, "machine.yaml", "c/1.csv", "d.csv", "results/machines/a/fit.json", "notes.md", ".git/x.csv")
    fleet = found(tmp_path)
    assert list(fleet) == ["a", "b", "c", "d"] and not any(member.why for member in fleet.values())
    assert told(tmp_path, fleet["a"]) == ["a/own.yaml", "a/day1.parquet", "a/day2.csv"]
    assert told(tmp_path, fleet["b"]) == ["b/machine.yaml", "b/recordings/1.csv"]
    assert told(tmp_path, fleet["c"]) == ["machine.yaml", "c/1.csv"]
    assert told(tmp_path, fleet["d"]) == ["machine.yaml", "d.csv"]


@pytest.mark.parametrize(
    ("files", "why"),
    [
        (["m/x.yaml", "m/y.yaml", "m/1.csv"], r"found the machine files x.yaml, y.yaml, expected one"),
        (["m/1.csv"], "found no machine file, expected machine.yaml here"),
        (["m/machine.yaml", "m/readme.md"], "found no recording here, expected at least one"),
        (["m/machine.yaml", "m/1.csv", "m/recordings/readme.md"], "found no recording in recordings"),
        (["machine.yaml", "m.csv", "m.parquet"], "found several folders or recordings of this name"),
        (["machine.yaml", "m.csv", "m/1.csv"], "found several folders or recordings of this name"),
    ],
)
def test_what_does_not_fit_says_why(files: list[str], why: str, tmp_path: Path) -> None:
    put(tmp_path, *files)
    (member,) = members(tmp_path, tmp_path / "results")
    assert member.name == "m" and member.why.startswith(why)


def test_no_machine_at_all(tmp_path: Path) -> None:
    with input_error(r"found no machine, expected a folder for each"):
        members(tmp_path, tmp_path / "results")
    put(tmp_path, "recording.csv")
    with input_error(r"expected a folder of machines, found a file"):
        members(tmp_path / "recording.csv", tmp_path)


def test_a_name_that_no_file_can_hold_is_spelt_out(tmp_path: Path) -> None:
    (tmp_path / "arm\udcff").mkdir()
    (member,) = members(tmp_path, tmp_path / "results")
    assert member.name == "arm\\udcff"
    assert member.key(tmp_path, "")


CHANGES: list[Callable[[Path], object]] = [
    lambda folder: (folder / "m/1.csv").write_text("other"),
    lambda folder: (folder / "m/1.csv").rename(folder / "m/2.csv"),
    lambda folder: (folder / "m/machine.yaml").write_text(
        "mechanism: {type: urdf, file: 'arm.urdf'} # other"
    ),
    lambda folder: (folder / "m/arm.urdf").write_text("other"),
    lambda folder: put(folder, "m/0.csv"),
]


@pytest.mark.parametrize("change", CHANGES)
def test_a_key_follows_every_file(change: Callable[[Path], object], tmp_path: Path) -> None:
    put(tmp_path, "m/1.csv", "m/arm.urdf", "m/readme.md")
    (tmp_path / "m/machine.yaml").write_text("mechanism: {type: urdf, file: 'arm.urdf'}")

    def key(settings: str = "") -> str:
        (member,) = members(tmp_path, tmp_path / "results")
        return member.key(tmp_path, settings)

    before = key()
    put(tmp_path, "m/readme.md", "m/report.html")
    assert key() == before != key("other options")
    change(tmp_path)
    assert key() != before


def test_a_key_does_not_follow_the_place(tmp_path: Path) -> None:
    keys = []
    for place in ("here", "there"):
        put(tmp_path / place, "m/machine.yaml", "m/1.csv")
        (member,) = members(tmp_path / place, tmp_path)
        keys.append(member.key(tmp_path / place, ""))
    assert keys[0] == keys[1]
