"""Findings in words, each at the deepest level at which it is known: its law, what drives its place, or its place alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from truepose.identification.diagnosis.result import NAMED, Finding, Lead, Replication, Together
from truepose.identification.report.numbers import percent
from truepose.models.effects.base import effects
from truepose.models.file.driver import DriverKind
from truepose.wording import joined, shortened

SAID = 0.9
"""Probability from which on a level is spoken of as known."""
PLACES = 6
"""Most places of one driver that are listed."""
_ONE: Mapping[DriverKind, str] = {
    "load": "gives way under the load that it carries",
    "position-periodic": "errs in waves of its own position",
    "position": "errs smoothly with its own position",
    "arrival": "stands where it does by the side from which it arrived",
    "temperature": "changes with a temperature",
    "time": "drifts with time",
    "session": "stands elsewhere in another session",
    "coupling": "follows the position of other joints",
    "sensor": "errs by itself",
    "constant": "has a wrong constant",
}
_MANY: Mapping[DriverKind, str] = {
    "load": "give way under the load that they carry",
    "position-periodic": "err in waves of their own positions",
    "position": "err smoothly with their own positions",
    "arrival": "stand where they do by the side from which they arrived",
    "temperature": "change with a temperature",
    "time": "drift with time",
    "session": "stand elsewhere in another session",
    "coupling": "follow the positions of other joints",
    "sensor": "err by themselves",
    "constant": "have wrong constants",
}
NAMES: Mapping[DriverKind, str] = {
    "load": "the weight carried",
    "position-periodic": "its own position",
    "position": "its own position",
    "arrival": "the side of arrival",
    "temperature": "a temperature",
    "time": "time",
    "session": "the session",
    "coupling": "other joints",
    "sensor": "what the sensor reads",
    "constant": "nothing: it is constant",
}


def pooled(finding: Finding) -> tuple[list[str], float]:
    """Places of a finding and of its look-alikes with the same driver, and how probable it is that it is at one of them."""
    alike = [a for a in finding.equivalents if a.kind == finding.levels.kind and not a.nameless]
    places = list(dict.fromkeys((*finding.place, *(part for a in alike for part in a.place))))
    return places, min(1.0, finding.levels.driver + sum(a.probability for a in alike))


def level_of(finding: Finding) -> str:
    """The deepest level that is known with 0.9 or more: ``law``, ``driver``, ``pooled`` (its driver, at one of several
    places), ``place``; ``none`` where none is."""
    if not finding.nameless and finding.probability >= SAID:
        return "law"
    if finding.levels.driver >= SAID:
        return "driver"
    if len(finding.place) == 1 and pooled(finding)[1] >= SAID:
        return "pooled"
    return "place" if finding.levels.place >= SAID else "none"


def driver_clauses(findings: Sequence[Finding]) -> list[str]:
    """Findings whose law is not known, as clauses after ``that``: places of one driver together, surest level first."""
    out = [_untested_clause(f) for f in findings if _untested(f)]
    findings = [f for f in findings if not _untested(f)]
    for level in ("driver", "place", "none"):
        groups: dict[DriverKind, list[Finding]] = {}
        for f in findings:
            if level_of(f) == level:
                groups.setdefault(f.levels.kind, []).append(f)
        out += [_clause(level, kind, own) for kind, own in groups.items()]
    return out + [_pooled_clause(f) for f in findings if level_of(f) == "pooled"]


def known_words(finding: Finding) -> tuple[str, str]:
    """A finding at the deepest level that is known, and how sure that is: ``compliant joint at q2``, ``98 %``; or ``q5 errs in
    waves of its own position``, ``over 99.9 %; which law is open``."""
    if not finding.nameless and (level_of(finding) == "law" or not finding.levels.driver):
        where = shortened(finding.place, PLACES) or "the recording"
        return f"{title(finding.effect)} at {where}", percent(finding.probability)
    kind, place = finding.levels.kind, _erring(finding)
    errs = _MANY[kind] if len(place) > 1 else _ONE[kind]
    where = shortened(place, PLACES) or "the recording"
    return f"{where} {errs}", f"{percent(finding.levels.driver)}; {open_law(finding)}"


def open_law(finding: Finding) -> str:
    """Return how open the law is: not replicated in a half of the rows, likelier than not, or not known."""
    if finding.nameless:
        return "no law of the catalogue"
    halves = finding.replication
    if halves is not None and not halves.replicated:
        return f"its law is not replicated: {unreplicated_words(halves)}"
    likely = (
        f", {title(finding.effect)} with {percent(finding.probability)}"
        if finding.probability > NAMED
        else ""
    )
    return f"which law is open{likely}"


def unreplicated_words(halves: Replication) -> str:
    """Return why the halves of the rows do not replicate a law."""
    if not halves.agree:
        return "the halves of the recording do not agree on its amplitude"
    return "one half of the rows alone would not name it"


def together_words(one: Together) -> str:
    """``q2, link2 or base gives way under the load that it carries (over 99.9 %), which of them is not known``."""
    places = shortened(list(one.places), PLACES) if len(one.places) > PLACES else joined(one.places, "or")
    return (
        f"{places} {_ONE[one.driver]} ({percent(one.probability)} that at least one does), which is not known"
    )


def _erring(finding: Finding) -> list[str]:
    """Return the places where the error is: of joints that are coupled the first, which is driven."""
    return list(finding.place[:1] if finding.levels.kind == "coupling" else finding.place)


def _untested(finding: Finding) -> bool:
    """Whether what explains a finding best could not be tested."""
    return finding.nameless and not finding.tested and bool(finding.equivalents)


def _untested_clause(finding: Finding) -> str:
    best = finding.equivalents[0]
    likely = f"likely a {title(best.effect)} at {joined(best.place)} ({percent(best.probability)})"
    return f"something at {joined(finding.place)} errs, {likely}, which could not be tested"


def _pooled_clause(finding: Finding) -> str:
    places, probability = pooled(finding)
    likeliest = f"{finding.place[0]} with {percent(finding.levels.driver)}"
    told = f"{percent(probability)}; not told apart, {likeliest}"
    return f"{joined(places, 'or')} {_ONE[finding.levels.kind]} ({told})"


def _clause(level: str, kind: DriverKind, findings: Sequence[Finding]) -> str:
    places = sorted({part for f in findings for part in f.place[:1] or ("the sensor",)}, key=_counted)
    shown = shortened(places, PLACES) if len(places) > PLACES else joined(places)
    if level == "driver":
        laws = _laws(findings)
        return f"{shown} {_MANY[kind] if len(places) > 1 else _ONE[kind]}" + (f" ({laws})" if laws else "")
    likely = [f.levels.driver for f in findings]
    said = f"something at {shown} errs, likely with {NAMES[kind]} ({spanned(likely)})"
    return said if level == "place" else said.replace("something", "probably something", 1)


def _counted(name: str) -> tuple[str, int]:
    """q2 before q10."""
    stem = name.rstrip("0123456789")
    return stem, int(name[len(stem) :] or 0)


def _laws(findings: Sequence[Finding]) -> str:
    """How sure the laws are that lead among these; nothing where none does."""
    named: dict[str, list[float]] = {}
    for f in findings:
        if not f.nameless:
            named.setdefault(f.effect, []).append(f.probability)
    if named and max(map(max, named.values())) <= NAMED:
        return "which law is open"
    said = [f"{title(slug)}: {spanned(p)}" for slug, p in named.items()]
    if named and len(said) < len({f.effect for f in findings}):
        said.append("else a form without a name")
    return "; ".join(said)


def title(slug: str) -> str:
    """The catalogue's title of an effect in small letters."""
    entry = effects.get(slug, "report").title if slug in set(effects) else ""
    return (entry if entry[1:2].isupper() else entry[:1].lower() + entry[1:]) or slug


def with_article(slug: str) -> str:
    """The title as a sentence has it: ``a compliant joint``, ``an eccentric encoder disc``, ``backlash``."""
    said = title(slug)
    if slug not in set(effects) or not effects.get(slug, "report").counted:
        return said
    return f"{'an' if said[0] in 'aeiou' else 'a'} {said}"


def spanned(values: Sequence[float]) -> str:
    """Probabilities from the lowest to the highest; one where they read alike."""
    low, high = min(values), max(values)
    return percent(low) if percent(low) == percent(high) else f"{percent(low)} to {percent(high)}"


def levels_words(finding: Finding) -> str:
    """All three levels of a finding in one sentence."""
    levels = finding.levels
    where = joined(_erring(finding)) or "the recording"
    said = (
        f"Probability {percent(levels.place)} that something is at {where}, {percent(levels.driver)} that it follows"
        f" {NAMES[levels.kind]}"
    )
    if _untested(finding):
        return f"Probability {percent(levels.place)} that {_untested_clause(finding)}."
    if finding.nameless:
        return f"{said}; no law of the catalogue stands for it."
    law = f"{percent(finding.probability)} that it is {with_article(finding.effect)} ({finding.effect})"
    untested = "" if finding.tested else " (whether its form is another could not be tested)"
    return f"{said}, {law}{untested}."


def lead_words(lead: Lead) -> str:
    """What leads below the level of a finding: ``backlash at q3 (40 %; something follows the side of arrival there: 45 %)``."""
    where = f" at {', '.join(lead.place)}" if lead.place else ""
    what = f"something follows {NAMES[lead.levels.kind]} there: {percent(lead.levels.driver)}"
    return f"{lead.effect}{where} ({percent(lead.probability)}; {what})"


__all__ = [
    "NAMES",
    "driver_clauses",
    "lead_words",
    "level_of",
    "levels_words",
    "spanned",
    "title",
    "together_words",
    "unreplicated_words",
    "with_article",
]
