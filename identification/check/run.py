"""The check itself: files in, findings out; and the gate that every fit goes through first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from truepose.errors import InputError
from truepose.identification.check.bare import bare, no_tolerances, out_of_range
from truepose.identification.check.judging import shown
from truepose.identification.check.pair import Pair
from truepose.identification.check.result import Check, Found
from truepose.identification.check.rig import Rig
from truepose.identification.check.search import search
from truepose.identification.check.sensorless import without_sensor
from truepose.identification.check.sigma import sigmas
from truepose.identification.check.unread import unnamed_table
from truepose.identification.load import load_recording
from truepose.identification.recording.load import Sources, as_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.untestable import missing_inputs
from truepose.models.load import load_machine
from truepose.models.machine import Machine

_ORDER = {"wrong": 0, "suspect": 1, "ok": 2}


def check_files(
    machine: Path, recordings: Sequence[Path], *, irradiance: Sequence[Path] = (), shuffled: bool = False
) -> tuple[Check, Machine | None, Recording | None]:
    """What may be wrong between a machine file and its recordings; the machine and the rows as they were loaded.

    Raises InputError for what cannot be read, and for a joint out of its range where no slip explains it. There are no
    rows where the machine file has no sensor, and no machine where its table names no convention.
    """
    try:
        loaded = load_machine(machine)
    except InputError:
        table = unnamed_table(Pair.read(machine, recordings), recordings)
        if table is None:
            raise
        return table, None, None
    if not loaded.sensors:
        return without_sensor(Pair.read(machine, recordings)), loaded, None
    rows = load_recording(unbounded(loaded), recordings, irradiance=irradiance, shuffled=shuffled)
    return check(loaded, rows), loaded, rows


def check(machine: Machine, source: Recording | Sources) -> Check:
    """What may be wrong between a machine and a recording of it: a path, a DataFrame, a dict, several, or one that is loaded.

    Raises InputError for what cannot be read, and for a machine without a sensor.
    """
    if not machine.sensors:
        raise InputError(f"{machine.name}: found no sensor, expected one: nothing says what the readings are")
    rows = as_recording(unbounded(machine), source)
    result = check_loaded(machine, rows)
    beyond = () if result.verdict == "wrong" else tuple(out_of_range(machine, rows))
    return replace(result, found=(*beyond, *result.found))


def unbounded(machine: Machine) -> Machine:
    """The machine without the ranges of its joints: a reading outside of them may be in another unit."""
    actuators = tuple(replace(a, range=None) for a in machine.mechanism.actuators)
    return replace(machine, mechanism=replace(machine.mechanism, actuators=actuators))


def check_loaded(machine: Machine, recording: Recording) -> Check:
    """What may be wrong between a machine and a recording of it, both as they were loaded."""
    if recording.validation.all():
        raise InputError(
            f"{', '.join(recording.files)}: found rows of role 'validation' only, expected rows to fit"
        )
    found: list[Found] = list(bare(machine, recording))
    if any(f.verdict == "wrong" for f in found):
        return Check(tuple(found), len(recording), None)
    rig = Rig(machine, recording)
    result = search(rig)
    if any(f.kind == "joint-never-moves" for f in result.found):
        found = [f for f in found if f.kind != "joint-never-moves"]
    found += result.found
    found += no_tolerances(rig, result.stand)
    if not any(f.verdict == "wrong" for f in found):
        found += sigmas(rig, result.stand, result.price)
    left, _, unit = shown(result.stand, result.stand)
    ordered = sorted(found, key=lambda f: _ORDER[f.verdict])
    missing = missing_inputs(machine, recording)
    return Check(tuple(ordered), len(recording), left, unit, missing)


__all__ = ["check", "check_files", "check_loaded", "unbounded"]
