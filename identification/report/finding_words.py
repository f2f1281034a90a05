"""Findings in words, each at the deepest level at which it is known: its law, what drives its place, or its place alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from truepose.identification.diagnosis.naming import CERTAIN
from truepose.identification.diagnosis.result import NAMED, Finding, Lead, Remainder, Replication, Together
from truepose.identification.report.phrases import (
    coefficient_words,
    known,
    law_words,
    named,
    percent,
    place_words,
    several,
    significant,
    spanned,
    title,
    told,
)
from truepose.models.effects.common import OF_ROWS
from truepose.models.effects.empirical import LOAD, MOMENT
from truepose.models.file.driver import DriverKind
from truepose.wording import joined, shortened

SAID = 0.9
"""Probability from which on a level is spoken of as known."""
PLACES, RIVALS = 6, 4
"""Most places of one driver, and most rivals, that are listed."""
NAMES: Mapping[DriverKind, str] = {
    "load": "the weight carried",
    "position-periodic": "its own position, in waves",
    "position": "its own position",
    "arrival": "the side of arrival",
    "temperature": "a temperature",
    "time": "time",
    "session": "the session",
    "coupling": "other joints",
    "sensor": "what the sensor reads",
    "constant": "nothing: it is constant",
}
_SHARED = ("order", "steps", "linear", "quadratic", "periodic")
_OF_WEIGHT = {LOAD: "the load that it carries", MOMENT: "the moment on it"}
"""Sources that no column holds, in words."""


def is_law_known(finding: Finding) -> bool:
    """Whether a finding is told by its law: it has one, and that is known, or nothing is known of its driver."""
    return not finding.nameless and (finding.probability >= SAID or not finding.levels.driver)


def pooled(finding: Finding) -> tuple[list[str], float]:
    """Places of a finding and of its look-alikes with the same driver, and how probable it is that it is at one of them."""
    alike = [a for a in finding.equivalents if a.kind == finding.levels.kind and not a.nameless]
    places = list(dict.fromkeys((*finding.place, *(part for a in alike for part in a.place))))
    return places, min(1.0, finding.levels.driver + sum(a.probability for a in alike))


def _where(finding: Finding) -> tuple[str, float]:
    """Where the error is, of coupled joints the first, which is driven; and the probability of its driver there."""
    places, probability = pooled(finding)
    if _is_pooled(finding):
        return joined(places, "or"), probability
    return _places(_erring(finding)), finding.levels.driver


def _is_pooled(finding: Finding) -> bool:
    """Whether its driver is known at one of several places, and at none of them by itself."""
    return finding.levels.driver < SAID <= pooled(finding)[1] and len(finding.place) == 1


def _erring(finding: Finding) -> Sequence[str]:
    return finding.place[:1] if finding.levels.kind == "coupling" else finding.place


def _places(place: Sequence[str]) -> str:
    said = shortened(place, PLACES) if len(place) > PLACES else joined(place)
    return said or "the recording"


def _untested(finding: Finding) -> str:
    """What explains a finding best, where that could not be tested."""
    if not finding.nameless or finding.tested or not finding.equivalents:
        return ""
    best = finding.equivalents[0]
    likely = f"likely a {title(best.effect)} at {joined(best.place)} ({percent(best.probability)})"
    return f"something at {joined(finding.place)} errs, {likely}, which could not be tested"


def known_words(finding: Finding) -> tuple[str, str]:
    """A finding at the deepest level that is known, and how sure that is: ``compliant joint at q2``, ``98 %``; or ``something
    at q5 follows its own position``, ``over 99.9 %; which law is open``."""
    if is_law_known(finding):
        where = shortened(finding.place, PLACES) or "the recording"
        return f"{title(finding.effect)} at {where}", percent(finding.probability)
    untested = _untested(finding)
    if untested:
        return untested, percent(finding.levels.place)
    where, probability = _where(finding)
    return (
        f"something at {where} follows {NAMES[finding.levels.kind]}",
        f"{percent(probability)}; {open_law(finding)}",
    )


def open_law(finding: Finding) -> str:
    """Return how open the law is: not replicated in a half of the rows, likelier than not, or not known."""
    if finding.nameless:
        return "no law of the catalogue"
    halves = finding.replication
    if halves is not None and not halves.replicated:
        return f"its law is not replicated: {unreplicated_words(halves)}"
    likely = finding.probability > NAMED
    return "which law is open" + (
        f", {title(finding.effect)} with {percent(finding.probability)}" if likely else ""
    )


def unreplicated_words(halves: Replication) -> str:
    """Return why the halves of the rows do not replicate a law."""
    if not halves.agree:
        return "the halves of the recording do not agree on its amplitude"
    return "one half of the rows alone would not name it"


def finding_item(finding: Finding) -> str:
    """A finding in a line: what it is, how sure that is, its size, what it could be instead, and what it does."""
    what, sure = known_words(finding)
    slug = f" ({finding.effect})" if is_law_known(finding) and title(finding.effect) != finding.effect else ""
    rivals = dict.fromkeys(
        "something without a name" if other.nameless else f"{other.effect} {place_words(other.place)}".strip()
        for other in finding.equivalents
    )
    parts = [f"{what}{slug}: {sure}"]
    if slug and finding.levels.driver:
        parts.append(f"its driver ({NAMES[finding.levels.kind]}) {percent(finding.levels.driver)}")
    parts.append(coefficient_words(finding.parameters))
    parts.append(f"could also be {shortened(list(rivals), RIVALS)}" if rivals else "")
    said = "; ".join(part for part in parts if part)
    return f"{said}. {finding.explanation}" if finding.explanation else said


def fault_words(findings: Sequence[Finding]) -> str:
    """What is wrong with a model, as verbs with their objects: ``leaves out a compliant joint (joint-compliance) at q2``."""
    rows = [f for f in findings if f.effect in OF_ROWS]
    others = [f for f in findings if f.effect not in OF_ROWS]
    law = [f for f in others if not f.nameless and f.probability >= SAID]
    absent = [_or_alike(f) for f in law if f.effect != "wrong-constant"]
    wrong = [_or_alike(f) for f in law if f.effect == "wrong-constant"]
    out = [f"leaves out {joined(absent)}"] if absent else []
    out += [f"has {joined(wrong)}"] if wrong else []
    clauses = driver_clauses([f for f in others if f not in law])
    out += [f"misses that {joined(clauses)}"] if clauses else []
    return joined(out + ([f"was fitted beside {joined([named(f) for f in rows])}"] if rows else []))


def driver_clauses(findings: Sequence[Finding]) -> list[str]:
    """Findings whose law is not known, as clauses after ``that``: places of one driver together."""
    out = [said for f in findings if (said := _untested(f))]
    groups: dict[tuple[DriverKind, str], list[Finding]] = {}
    for f in sorted((f for f in findings if not _untested(f)), key=lambda f: -f.levels.driver):
        groups.setdefault((f.levels.kind, _where(f)[0] if _is_pooled(f) else ""), []).append(f)
    for (kind, either), group in groups.items():
        places = either or _places(list(dict.fromkeys(part for f in group for part in _erring(f))))
        sure = spanned([_where(f)[1] for f in group])
        out.append(f"something at {places} follows {NAMES[kind]} ({sure})")
    return out


def _or_alike(finding: Finding) -> str:
    """A finding, and that look-alikes with a name are as good where its own is not sure."""
    alike = [other for other in finding.equivalents if not other.nameless]
    if finding.probability > CERTAIN or not alike:
        return told(finding)
    others = told(alike[0]) if len(alike) == 1 else f"one of {len(alike)} look-alikes"
    return f"{told(finding)} or {others}"


def sure_words(finding: Finding) -> str:
    """How sure a finding is, at each level and of its class."""
    levels = finding.levels
    alike = [other for other in finding.equivalents if not other.nameless]
    law = f"{percent(finding.probability)} that it is {law_words(finding.effect)}"
    if _untested(finding):
        return f"Probability {percent(levels.place)} that {_untested(finding)}."
    said = f"Probability {law}"
    if levels.driver:
        where = f"Probability {percent(levels.place)} that something is at {_where(finding)[0]}"
        driver = f"{where}, {percent(levels.driver)} that it follows {NAMES[levels.kind]}"
        if finding.nameless:
            return f"{driver}; no law of the catalogue stands for it."
        untested = "" if finding.tested else " (whether its form is another could not be tested)"
        said = f"{driver}, {law}{untested}"
    if not alike:
        return f"{said}."
    return f"{said}; {percent(finding.certainty)} that it is one of the {several(len(alike) + 1, 'explanation')} below."


def tolerance_words(finding: Finding) -> str:
    """Whether the naming rests on tolerances alone."""
    flip = finding.flip_lambda
    turn = (
        f"With every tolerance {significant(flip, 2)} times wider the verdict would flip."
        if known(flip)
        else ""
    )
    if finding.prior_dependent:
        alone = "The naming rests on the drawing tolerances alone: free geometry could imitate this effect."
        return f"{alone} {turn}".rstrip()
    return turn or "The naming does not rest on tolerances: no widening up to a hundred times would flip it."


def explanation(finding: Finding) -> str:
    """What the effect is, how it was found, and what speaks against it."""
    said = [*against_words(finding), finding.explanation]
    if finding.family:
        said.append("It was found at more places of this kind, and each makes the others likelier.")
    return " ".join(said)


def against_words(finding: Finding) -> list[str]:
    """Return what the halves of the recording say against a name; nothing where both have it."""
    halves = finding.replication
    if halves is None or halves.replicated:
        return []
    alone = f" (probability {percent(halves.least)})" if halves.agree else ""
    return [f"Not replicated: {unreplicated_words(halves)}{alone}."]


def separating_experiment(finding: Finding) -> str:
    """What would tell the effect from others, and from the likeliest other name in particular."""
    rival = next((other for other in finding.equivalents if not other.nameless), None)
    if rival is None or not rival.experiment or rival.effect == finding.effect:
        return finding.experiment
    return f"{finding.experiment}; against {rival.effect}: {rival.experiment}"


def together_words(one: Together) -> str:
    """``q2, link2 or base: at least one follows the weight carried (over 99.9 %), which is not known``."""
    places = shortened(list(one.places), PLACES) if len(one.places) > PLACES else joined(one.places, "or")
    return (
        f"{places}: at least one follows {NAMES[one.driver]} ({percent(one.probability)}), which is not known"
    )


def lead_words(lead: Lead) -> str:
    """What leads below the level of a finding: ``backlash at q3 (40 %; something follows the side of arrival there: 45 %)``."""
    what = f"something follows {NAMES[lead.levels.kind]} there: {percent(lead.levels.driver)}"
    return f"{lead.effect} {place_words(lead.place)}".strip() + f" ({percent(lead.probability)}; {what})"


def follows(left: Remainder) -> str:
    """Which driver the remainder follows, hypothetically: to be said after ``seems to``."""
    if left.driver == "order":
        return "vary with the order of acquisition (a hypothesis)"
    where = f" {place_words(left.place)}" if left.place and left.place != (left.driver,) else ""
    return f"follow {left.driver or 'no recorded driver'}{where} (a hypothesis)"


def form_words(left: Remainder) -> str:
    """In which form the remainder goes with its driver, hypothetically."""
    form, driver = left.form, _OF_WEIGHT.get(left.driver, left.driver)
    where = left.place[0] if left.place else ""
    said = {
        "order": "varies with the order of acquisition",
        "steps": f"steps with {driver}",
        "linear": f"linear in {driver}",
        "quadratic": f"bent (quadratic) in {driver}",
        "periodic": f"periodic in {driver}, about {form.cycles} periods over its range",
        "line": f"{where} errs in proportion to {driver}",
        "curve": f"{where} errs as a smooth curve in {driver}",
        "product": f"{where} errs as the product of {driver}",
        "warp": f"{where} errs as a volume warped quadratically by where the point is",
    }[form.kind]
    part = f"; explains {100 * form.share:.0f} % of the remainder" if form.kind in _SHARED else ""
    return f"{said}{part}; hypothesised"
