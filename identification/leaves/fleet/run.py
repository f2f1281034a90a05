"""A whole fleet: what is left to do is done side by side, then the table, the page and the prior are made.

Where things are, in the folder of results:

    machines/NAME/    what calibrate and diagnose write of a machine, and record.json, which is written last
    records.jsonl     records of the last run that has ended, for what changed since
    fleet.csv, fleet.json, fleet.html, prior.yaml

A machine is done again when its key changes: the contents of its files, the options and the version of truepose.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path

from truepose.errors import InputError
from truepose.files import atomic_directory, atomic_write_text, reason, write_table
from truepose.identification.learned_prior import read_prior
from truepose.identification.leaves.fleet.evidence import KEPT
from truepose.identification.leaves.fleet.folder import Member, members
from truepose.identification.leaves.fleet.learn import learned, write_prior
from truepose.identification.leaves.fleet.odd import oddness
from truepose.identification.leaves.fleet.page import fleet_document
from truepose.identification.leaves.fleet.pooled import Pooled
from truepose.identification.leaves.fleet.record import (
    RECORDS,
    SCHEMA,
    Record,
    compare,
    read_records,
    write_records,
)
from truepose.identification.leaves.fleet.statistics import statistics
from truepose.identification.leaves.fleet.table import Fleet, counts, fleet_json, fleet_table
from truepose.identification.leaves.fleet.work import Options, Task, work_on
from truepose.identification.report.json_text import json_text
from truepose.pool import Pool, numbered
from truepose.shown.html import page
from truepose.version import VERSION

MACHINES = "machines"
TABLE, DOCUMENT, PAGE, PRIOR = FILES = ("fleet.csv", "fleet.json", "fleet.html", "prior.yaml")
DEAD = "its process died twice, the second time with no other machine beside it"
Progress = Callable[[int, int, str], None]


def run_fleet(
    machines: Path, results: Path, pool: Pool, options: Options, *, progress: Progress = lambda *_: None
) -> Fleet:
    """Do what is left to do, and write down what the fleet says.

    ``progress`` hears how many machines are done, of how many, and the latest. Raises InputError where there is no machine
    and where results cannot be written.
    """
    machines, results = machines.resolve(), results.resolve()
    if machines == results:
        raise InputError(f"{results}: expected another folder for the results than that of the machines")
    if options.prior is not None:
        read_prior(options.prior)  # what is wrong with it is no machine's fault
    try:
        records = _work(machines, results, pool, options, progress)
        progress(1, 1, "what they say together")
        return end_run(machines, results, records, is_brief=options.brief)
    except OSError as exc:
        raise InputError(f"{results}: cannot write the results: {reason(exc)}") from exc


def settings_of(options: Options) -> str:
    """Return what all results depend on beside a machine's own files."""
    files = [*options.plugins, *([options.prior] if options.prior else [])]
    digests = [hashlib.sha256(path.read_bytes()).hexdigest() for path in files]
    told = [SCHEMA, KEPT, VERSION, options.anyway, options.shuffled, options.brief, options.prior is not None]
    return json.dumps([*told, digests])


def _work(
    machines: Path, results: Path, pool: Pool, options: Options, progress: Progress
) -> Mapping[str, Record]:
    """Bring every machine up to date; return their records in the order of names."""
    found, settings = members(machines, results), settings_of(options)
    tasks, records = list[Task](), dict[str, Record]()
    for count, member in enumerate(found):
        progress(count, len(found), f"looking for changes, {member.name}")
        readable, key = _key(member, machines, settings)
        tasks.append(Task(readable, machines, results / MACHINES / member.name, key, options))
        if kept := tasks[-1].kept():
            records[member.name] = kept
    todo = [task for task in tasks if task.member.name not in records]
    progress(0, max(len(todo), 1), f"{len(todo)} of {len(found)} to work with")
    for finished, (k, record) in enumerate(numbered(work_on, todo, pool), start=1):
        name = todo[k].member.name
        records[name] = record or todo[k].record("broken", DEAD)
        progress(finished, len(todo), name)
    return {member.name: records[member.name] for member in found}


def _key(member: Member, machines: Path, settings: str) -> tuple[Member, str]:
    """Return a machine with its key; one whose files cannot be read is one that says so."""
    try:
        return member, member.key(machines, settings)
    except OSError as exc:
        why = f"cannot read {Path(str(exc.filename)).name}: {exc.strerror}"
        unread = Member(member.name, why=why)
        return unread, unread.key(machines, settings)


def end_run(machines: Path, results: Path, records: Mapping[str, Record], *, is_brief: bool) -> Fleet:
    """Write down what all records say together."""
    before = read_records(results / RECORDS)
    pooled = Pooled.of([record.evidence for record in records.values() if counts(record)])
    table = fleet_table(list(records.values()), oddness(pooled))
    changes = compare(before, records) if before else None
    fleet = Fleet(machines.name, table, statistics(pooled), changes, is_brief)
    with atomic_directory(results) as partial:
        write_table(partial / TABLE, table)
        atomic_write_text(partial / DOCUMENT, json_text(fleet_json(fleet)))
        atomic_write_text(partial / PAGE, page(fleet_document(fleet)))
        write_prior(partial / PRIOR, learned(pooled))
        write_records(partial / RECORDS, records.values())
    return fleet
