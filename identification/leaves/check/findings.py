"""Say what a search found: a mend where one is certain, questions where several lead, or that no slip explains the misfit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from truepose.identification.leaves.check import weighing
from truepose.identification.leaves.check.kinds.frames import frame_unknown
from truepose.identification.leaves.check.pair import Slip, Stand
from truepose.identification.leaves.check.result import Found, Verdict
from truepose.identification.leaves.check.rig import Rig, motion
from truepose.identification.leaves.check.search import Search, still_columns
from truepose.wording import joined

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
