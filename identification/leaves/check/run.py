"""The check itself: files in, findings out; and the gate that every fit goes through first."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from truepose.errors import InputError
from truepose.identification.fit.set_ups import without_set_ups
from truepose.identification.leaves.check import weighing
from truepose.identification.leaves.check.bare import (
    bare,
    coarse_joints,
    encoders,
    left_of,
    length_of,
    no_tolerances,
    out_of_range,
    reversed_gravity,
    sigmas,
    standing_out,
)
from truepose.identification.leaves.check.kinds.frames import frame_unknown
from truepose.identification.leaves.check.pair import Pair, Slip, Stand
from truepose.identification.leaves.check.result import Check, Found, Verdict
from truepose.identification.leaves.check.rig import Rig, motion
from truepose.identification.leaves.check.search import Search, search, still_columns
from truepose.identification.load import load_recording
from truepose.identification.recording.joint_readings import leaves_range_open
from truepose.identification.recording.load import Sources, as_recording, tables, try_columns
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.untestable import missing_inputs
from truepose.models.file.machine_file import checked_machine
from truepose.models.load import build_machine, load_machine
from truepose.models.machine.machine import Machine, MachineLike, as_machine
from truepose.models.machine.sensor import TOOL_IN_WORLD
from truepose.wording import joined

# -- What a search says: a mend where one is certain, questions where several lead, or that nothing tried explains the misfit

PUSHED = 8.0
"""Tolerances that physics which was left out pushes constants away by."""
_LEADS, _WORTH_A_WORD = 4, 0.01
_CAUSES = (
    "compare the table of constants, the order of joints and the rows with their source; where the machine moved while it was "
    "measured, the clocks of joints and sensor; physics that was left out is what `diagnose` looks for"
)


def findings(rig: Rig, search: Search) -> list[Found]:
    """Return what to say of a machine and its recording."""
    as_it_stands = search.as_it_stands
    if not as_it_stands.near and (still := still_columns(rig)):
        return [_never_changes(rig, as_it_stands.stand, still)]
    if search.advised is not None:
        return list(_advice(rig, search, search.advised))
    if as_it_stands.near:
        return []
    if search.mixed:
        return list(search.mixed)
    leads = [members[0] for members, share in search.leads if share >= _WORTH_A_WORD]
    gained = leads[0].score - as_it_stands.score if leads else 0.0
    if gained > np.log(weighing.CERTAIN / (1.0 - weighing.CERTAIN)):
        return [_question(rig, as_it_stands, leads)]
    return [] if _is_physics(rig, as_it_stands.stand) else [unexplained(rig, as_it_stands.stand)]


def _never_changes(rig: Rig, stand: Stand, still: tuple[str, ...]) -> Found:
    """Return a finding on columns that were not measured, it seems."""
    one = len(still) == 1
    return replace(
        unexplained(rig, stand),
        kind="reading-never-changes",
        where=still,
        says=f"{joined(still)} {'reads' if one else 'read'} the same in every row, and {_misses(rig, stand)}",
        fix=f"leave {joined(still)} empty where {'it was' if one else 'they were'} not measured",
    )


def _is_physics(rig: Rig, stand: Stand) -> bool:
    """Whether constants need not be further off than physics pushes them, where all is left that drawing and noise make.

    Joints out of their range are told by themselves.
    """
    if stand.bad:
        return False
    most = weighing.allowed(rig, stand)
    eased = weighing.settle(rig, stand, (), most)
    return eased.misfit <= most and eased.farthest <= PUSHED


def _advice(rig: Rig, search: Search, members: Sequence[weighing.Weighed]) -> Iterator[Found]:
    """Yield what the likeliest of a class says, each slip by itself; the others of the class fit as well."""
    best = members[0]
    before, after, unit = shown(search.as_it_stands.stand, best.stand)
    alike = dict.fromkeys(_words(rig, w) for w in members[1:] if w.near)
    others = tuple(words for words in alike if words != _words(rig, best))[:_LEADS]
    for slip in _slips(rig, best):
        yield Found(
            slip.kind, slip.where, slip.says, slip.fix, "wrong", before, after, unit, slip.mend, others
        )


def _question(rig: Rig, as_it_stands: weighing.Weighed, leads: Sequence[weighing.Weighed]) -> Found:
    """What leads and is not certain, or leaves more than drawing and noise: to be looked at, never to be mended unseen."""
    best = leads[0]
    before, after, unit = shown(as_it_stands.stand, best.stand)
    slips = best.hypothesis.slips or _slips(rig, best)[:1]
    more = "; more would be left than drawing and noise make, so that something else is wrong too"
    says = f"it may be: {_words(rig, best)}{'' if best.near else more}"
    fix = f"compare with the source: {'; '.join(slip.fix for slip in slips)}"
    verdict: Verdict = "wrong" if as_it_stands.stand.bad else "suspect"
    others = tuple(dict.fromkeys(_words(rig, w) for w in leads[1:]))[:_LEADS]
    first = slips[0]
    return Found(first.kind, first.where, says, fix, verdict, before, after, unit, instead=others)


def _slips(rig: Rig, weighed: weighing.Weighed) -> tuple[Slip, ...]:
    """Return the slips of a hypothesis, and the frames that stand elsewhere for it."""
    elsewhere = (frame_unknown(rig, frame, weighed.stand.p) for frame in weighed.free)
    return (*weighed.hypothesis.slips, *elsewhere)


def _words(rig: Rig, weighed: weighing.Weighed) -> str:
    """What a hypothesis says, in one line."""
    said = [slip.says for slip in _slips(rig, weighed)]
    return joined(said) if said else "all is as the files say"


def unexplained(rig: Rig, stand: Stand) -> Found:
    """Return a misfit that no slip explains; a joint said never to move may be it. Certain beyond all physics only."""
    certain = stand.bad or stand.misfit > weighing.PHYSICS * motion(rig, stand)
    verdict: Verdict = "wrong" if certain else "suspect"
    before, _, unit = shown(stand, stand)
    found = Found("unexplained", (), _misses(rig, stand), _CAUSES, verdict, before, unit=unit)
    if not rig.still:
        return replace(found, says=f"{found.says}, and no slip that was tried explains it")
    names = joined(rig.still)
    one = len(rig.still) == 1
    return replace(
        found,
        kind="joint-never-moves",
        where=rig.still,
        says=f"{names} never {'moves' if one else 'move'} in the recording, and {found.says}: "
        f"{'it' if one else 'they'} may have moved without being logged",
        fix=f"record {names}",
    )


def _misses(rig: Rig, stand: Stand) -> str:
    if stand.bad:
        return "the drawn machine cannot stand as its joints were read"
    size = f"{stand.length:.3g} mm" if stand.length is not None else f"{stand.misfit:.3g} sigma"
    told = f"with base and tool fitted, the drawn machine misses the readings by {size}"
    most = weighing.allowed(rig, stand)
    if stand.misfit > most:
        share = most / stand.misfit
        usual = f"{stand.length * share:.2g} mm" if stand.length is not None else f"{most:.2g} sigma"
        return f"{told}, where drawing and noise make at most {usual}"
    if beyond := weighing.joints_beyond(rig, stand.scene):
        return f"{told}, and {joined(beyond)} {'is' if len(beyond) == 1 else 'are'} out of range"
    away = weighing.settle(rig, stand, (), most).away
    name = max(away, key=lambda key: away[key])
    return f"{told} only where {name} is {away[name]:.3g} tolerances from where the file has it"


def shown(before: Stand, after: Stand) -> tuple[float | None, float | None, str]:
    """Return two misfits in a unit that users know: mm where positions are read, else sigmas; None where nothing fits."""
    if before.bad:
        return (None, after.misfit, "sigma") if after.length is None else (None, after.length, "mm")
    if before.length is not None and after.length is not None:
        return before.length, after.length, "mm"
    return before.misfit, after.misfit, "sigma"


# -- A machine file without a sensor


def without_sensor(pair: Pair) -> Check:
    """What to say of a file without ``sensor``."""
    says = "no sensor is stated: nothing says what the readings are"
    fix = "add a block 'sensor' to the machine file: type, sigma and what its type needs"
    rows = len(pair.sheets[0].cells) if pair.sheets else 0
    return Check((Found("no-sensor", ("sensor",), says, fix, "wrong"),), rows, None)


# -- A serial table that cannot be read because its fields are those of a data sheet: which convention fits the readings?

_MEANT = {"standard": "a data sheet's standard table", "modified": "a modified table (Craig)"}


def unnamed_table(pair: Pair, recordings: Sequence[Path]) -> Check | None:
    """What to say of joints with a field ``a`` and no convention; None where the file's fault is another one."""
    section: Mapping[str, Any] = pair.get(("mechanism",)) or {}
    joints = section.get("joints") if isinstance(section, Mapping) else None
    if not isinstance(joints, list) or section.get("type") != "serial" or "convention" in section:
        return None
    if not any(isinstance(row, Mapping) and "a" in row for row in joints):
        return None
    left = {convention: _left(pair, recordings, convention) for convention in _MEANT}
    best = min(left, key=lambda convention: left[convention][0])
    if not math.isfinite(left[best][0]):
        return None
    _, length, unit, rows = left[best]
    found = Found(
        "dh-convention",
        ("mechanism.joints", "mechanism.convention"),
        f"the joints have a field 'a' and no convention is stated; as {_MEANT[best]} they fit best",
        f"state 'convention: {best}' beside 'joints'",
        "wrong",
        None,
        length,
        unit,
        lambda pair: pair.with_field(("mechanism", "convention"), best),
    )
    return Check((found,), rows, length, unit, left_rows=rows, left_mended=True)


def _left(pair: Pair, recordings: Sequence[Path], convention: str) -> tuple[float, float | None, str, int]:
    """Misfit, its size and unit, and rows, under a convention; an infinite misfit where the file has other faults."""
    stated = pair.with_field(("mechanism", "convention"), convention).document
    try:
        machine = build_machine(checked_machine(Path(pair.machine), dict(stated)))
        rows = load_recording(machine, recordings)
    except InputError:
        return math.inf, None, "mm", 0
    stand = Rig(machine, rows).stand()
    length, _, unit = shown(stand, stand)
    return stand.misfit, length, unit, len(rows)


# -- The check itself: files in, findings out; and the gate that every fit goes through first

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
