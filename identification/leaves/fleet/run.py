"""A whole fleet: what is left to do is done side by side, then the table, the page and the prior are made.

Where things are, in the folder of results:

    machines/NAME/    what calibrate and diagnose write of a machine, and record.json, which is written last
    journal.jsonl     records of a run that has not ended
    fleet.parquet     records of the last run that has, and their sums
    fleet.csv, fleet.json, fleet.html, prior.yaml

A machine is done again when its key changes: the contents of its files, the options and the version of truepose.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from truepose.errors import InputError
from truepose.files import reason
from truepose.identification.learned_prior import read_prior
from truepose.identification.leaves.fleet.columns import KEPT
from truepose.identification.leaves.fleet.ending import Folders, ended
from truepose.identification.leaves.fleet.folder import Member, members
from truepose.identification.leaves.fleet.record import SCHEMA
from truepose.identification.leaves.fleet.result import Fleet
from truepose.identification.leaves.fleet.work import Options, Task, done
from truepose.pool import Pool, numbered
from truepose.version import VERSION

MACHINES = "machines"
DEAD = "its process died twice, the second time with no other machine beside it"
Progress = Callable[[int, int, str], None]


def run_fleet(
    folders: Folders, pool: Pool, options: Options, *, progress: Progress = lambda *_: None
) -> Fleet:
    """Do what is left to do, and write down what the fleet says.

    ``progress`` hears how many machines are done, of how many, and the latest. Raises InputError where there is no machine
    and where results cannot be written.
    """
    found = members(folders.machines, folders.results)
    if options.prior is not None:
        read_prior(options.prior)  # what is wrong with it is no machine's fault
    try:
        keys = _work(found, folders, pool, options, progress)
        progress(1, 1, "what they say together")
        fleet = ended(keys, folders, brief=options.brief)
        folders.journal.path.unlink(missing_ok=True)
    except OSError as exc:
        raise InputError(f"{folders.results}: cannot write the results: {reason(exc)}") from exc
    return fleet


def settings_of(options: Options) -> str:
    """What all results depend on beside a machine's own files."""
    files = [*options.plugins, *([options.prior] if options.prior else [])]
    digests = [hashlib.sha256(path.read_bytes()).hexdigest() for path in files]
    told = [SCHEMA, KEPT, VERSION, options.anyway, options.shuffled, options.brief, options.prior is not None]
    return json.dumps([*told, digests])


def _work(
    found: Sequence[Member], folders: Folders, pool: Pool, options: Options, progress: Progress
) -> Mapping[str, str]:
    """Bring every machine up to date; their keys, by name."""
    settings, journal = settings_of(options), folders.journal
    there = folders.store.keys() | journal.keys()
    keys, todo = dict[str, str](), list[Task]()
    for count, member in enumerate(found):
        progress(count, len(found), f"looking for changes, {member.name}")
        task = _task(member, folders, settings, options)
        keys[member.name] = task.key
        if there.get(member.name) != task.key:
            todo.append(task)
    progress(0, max(len(todo), 1), f"{len(todo)} of {len(found)} to work with")
    with journal.open() as stream:
        for finished, (k, record) in enumerate(numbered(done, todo, pool), start=1):
            journal.note(stream, record or todo[k].record("broken", DEAD))
            progress(finished, len(todo), todo[k].member.name)
    return keys


def _task(member: Member, folders: Folders, settings: str, options: Options) -> Task:
    """A machine with its key; one whose files cannot be read is one that says so."""
    task = partial(
        Task, folder=folders.machines, output=folders.results / MACHINES / member.name, options=options
    )
    try:
        return task(member, key=member.key(folders.machines, settings))
    except OSError as exc:
        unread = Member(member.name, why=f"cannot read {Path(str(exc.filename)).name}: {exc.strerror}")
        return task(unread, key=unread.key(folders.machines, settings))


__all__ = ["Folders", "Progress", "run_fleet", "settings_of"]
