"""Check files, and each pair of files before it is fitted: files in, findings out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from truepose.errors import InputError
from truepose.identification.fit.set_ups import without_set_ups
from truepose.identification.leaves.check import weighing
from truepose.identification.leaves.check.bare import bare, coarse_joints, no_tolerances, out_of_range
from truepose.identification.leaves.check.findings import findings
from truepose.identification.leaves.check.gravity import reversed_gravity
from truepose.identification.leaves.check.load_side import encoders
from truepose.identification.leaves.check.no_convention import unnamed_table
from truepose.identification.leaves.check.pair import Pair
from truepose.identification.leaves.check.result import Check, Found
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.leaves.check.search import Search, search
from truepose.identification.leaves.check.standing_rows import left_of, length_of, standing_out
from truepose.identification.leaves.check.stated_sigma import sigmas
from truepose.identification.load import load_recording
from truepose.identification.recording.joint_readings import leaves_range_open
from truepose.identification.recording.load import Sources, as_recording, tables, try_columns
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.untestable import missing_inputs
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine, MachineLike, as_machine
from truepose.models.machine.sensor import TOOL_IN_WORLD


def without_sensor(pair: Pair) -> Check:
    """What to say of a file without ``sensor``."""
    says = "no sensor is stated: nothing says what the readings are"
    fix = "add a block 'sensor' to the machine file: type, sigma and what its type needs"
    rows = len(pair.sheets[0].cells) if pair.sheets else 0
    return Check((Found("no-sensor", ("sensor",), says, fix, "wrong"),), rows, None)


_ORDER = {"wrong": 0, "suspect": 1, "ok": 2}


def check_files(
    machine: Path,
    recordings: Sequence[Path],
    *,
    irradiance: Sequence[Path] = (),
    tried: Sequence[str] | None = None,
    shuffled: bool = False,
) -> tuple[Check, Machine | None, Recording | None]:
    """What may be wrong between a machine file and its recordings; the machine and the rows as they were loaded, with columns
    that are ``tried`` as drivers (see ``try_columns``).

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
    files = tables(list(recordings), loaded.mechanism.readings)
    if tried is not None:
        loaded = try_columns(loaded, files, tried)
    rows = _within_or_beyond(
        loaded, lambda machine: load_recording(machine, files, irradiance=irradiance, shuffled=shuffled)
    )
    return check(loaded, rows), loaded, rows


def _within_or_beyond(machine: Machine, load: Callable[[Machine], Recording]) -> Recording:
    """Return the rows within the joints' ranges, where readings that wrap are unfolded; if they are beyond, as they are."""
    try:
        return load(machine)
    except InputError:
        return load(unbounded(machine))


def check(machine: MachineLike, source: Recording | Sources) -> Check:
    """What may be wrong between a machine and a recording of it: a path, a DataFrame, a dict, several, or one that is loaded.

    Raises InputError for what cannot be read, and for a machine without a sensor.
    """
    machine = as_machine(machine)
    if not machine.sensors:
        raise InputError(f"{machine.name}: found no sensor, expected one: nothing says what the readings are")
    rows = _within_or_beyond(machine, lambda machine: as_recording(machine, source))
    result = check_loaded(machine, rows)
    beyond = () if result.verdict == "wrong" else tuple(out_of_range(machine, rows))
    return replace(result, found=(*beyond, *result.found))


def unbounded(machine: Machine) -> Machine:
    """Return the machine without the ranges of its joints, because a reading outside of them may be in another unit.

    A joint keeps a range that readings which wrap are unfolded by.
    """
    anywhere = (-math.inf, math.inf)
    actuators = tuple(
        a
        if a.wrap and a.range and leaves_range_open(a.reading_range, a.wrap)
        else replace(a, range=a.range and anywhere, reads=a.reads and anywhere)
        for a in machine.mechanism.actuators
    )
    return replace(machine, mechanism=replace(machine.mechanism, actuators=actuators))


def check_loaded(machine: Machine, recording: Recording) -> Check:
    """What may be wrong between a machine and a recording of it, both as they were loaded."""
    if recording.validation.all():
        raise InputError(
            f"{', '.join(recording.files)}: found rows of role 'validation' only, expected rows to fit"
        )
    found: list[Found] = [*bare(machine, recording), *encoders(machine, recording)]
    if any(f.verdict == "wrong" for f in found):
        return Check(tuple(found), len(recording), None)
    seeing = (s for s in machine.sensors if s.view == TOOL_IN_WORLD and not s.joints)
    machine = replace(machine, sensors=tuple(seeing))
    if not machine.sensors:  # slips are told by how base and tool fit
        return Check(tuple(found), len(recording), None)
    rig, result, said = _searched(machine, recording)
    if any(f.kind == "joint-never-moves" for f in said):
        found = [f for f in found if f.kind != "joint-never-moves"]
    best = result.best
    remaining = left_of(rig, best)
    found += [*said, *no_tolerances(rig, best.stand), *coarse_joints(rig, best.stand)]
    if not any(f.verdict == "wrong" for f in found):
        # constants that outnumber what was read fit noise, too
        known = best.stand.residual.size >= 2 * len(best.settled.away)
        found += sigmas(rig, best.stand, best.settled.price if known else best.stand.misfit)
        found += reversed_gravity(rig, best, remaining.rms)
    if not any(f.kind in ("sessions-mixed", "too-few-rows") for f in found):
        found += standing_out(rig, remaining)
    length = length_of(rig, remaining)
    left, unit = (best.stand.misfit, "sigma") if length is None else (length, "mm")
    ordered = sorted(found, key=lambda f: _ORDER[f.verdict])
    missing = missing_inputs(machine, recording)
    return Check(
        tuple(ordered), len(recording), left, unit, missing, len(remaining.sizes), result.advised is not None
    )


def _searched(machine: Machine, recording: Recording) -> tuple[Rig, Search, list[Found]]:
    """What a search over slips finds; of a machine whose frames are set up anew, in the session that looks worst."""
    parts = [recording]
    if machine.set_up:
        machine = machine.with_effects(without_set_ups(machine.effects))
        each = [recording.subset(recording.session == number) for number in recording.sessions]
        parts = [part for part in each if not part.validation.all()]
    found = [_said(Rig(machine, part)) for part in parts]

    def looks(one: tuple[Rig, Search, list[Found]]) -> tuple[int, float]:
        return min((_ORDER[f.verdict] for f in one[2]), default=len(_ORDER)), -one[1].best.stand.misfit

    return min(found, key=looks)


def _said(rig: Rig) -> tuple[Rig, Search, list[Found]]:
    result = search(rig, weighing.weigh(rig, weighing.Hypothesis((), rig.scene), weighing.NOWHERE_ELSE))
    return rig, result, findings(rig, result)
