"""Results in plain sentences: the verdict, and each finding, how sure it is and what would separate it."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.identification.diagnosis.naming import CERTAIN
from truepose.identification.diagnosis.result import Alternative, Diagnosis, Finding, Remainder
from truepose.identification.report.document import Tone
from truepose.identification.report.level_words import (
    driver_clauses,
    lead_words,
    level_of,
    levels_words,
    unreplicated_words,
    with_article,
)
from truepose.identification.report.misfit_words import misfit_clause
from truepose.identification.report.numbers import known, percent, significant
from truepose.models.effects.base import Effect, effects
from truepose.models.effects.common import OF_ROWS
from truepose.models.effects.empirical import LOAD, MOMENT
from truepose.wording import joined

LEADS = 3
"""Most of what leads that the headline names."""
_SHARED = ("order", "steps", "linear", "quadratic", "periodic")
_ALARM_NAMES = {
    "residual": "lack of fit",
    "prior_conflict": "conflict with tolerances",
    "structure": "structure in residuals",
}
_ALARMS = {
    "residual": "does an ordinary fit, parameters free, leave more than noise?",
    "prior_conflict": "do the readings want parameters that the drawings exclude?",
    "structure": "do residuals under tolerances follow a driver or the order of rows?",
}


def effect_class(slug: str) -> type[Effect] | None:
    """The catalogue's entry, None for a slug it does not have."""
    return effects.get(slug, "report") if slug in set(effects) else None


def effect_title(slug: str) -> str:
    """An effect in words with its slug: ``platform that bends (platform-deformation)``."""
    entry = effect_class(slug)
    title = entry.title if entry is not None else ""
    if not title or title.lower() == slug:
        return slug
    return f"{title if title[1:2].isupper() else title[0].lower() + title[1:]} ({slug})"


def place_words(place: Sequence[str]) -> str:
    """``at leg1``; nothing for an effect without a place."""
    return f"at {', '.join(place)}" if place else ""


def named(item: Finding | Alternative) -> str:
    """An effect and its place."""
    return f"{effect_title(item.effect)} {place_words(item.place)}".strip()


def set_words(effects: Sequence[tuple[str, tuple[str, ...]]]) -> str:
    """Effects of a set with their places; that no effect is there for the empty one, whose noise explains the rest."""
    said = [
        f"{slug} {place_words(place)}" if place else "a smooth remainder without a place"
        for slug, place in effects
    ]
    return "; ".join(said) or "no effect"


def several(count: int, one: str) -> str:
    """``1 finding``, ``2 findings``."""
    return f"{count} {one if count == 1 else one + 's'}"


def headline(diagnosis: Diagnosis, *, brief: bool = False) -> tuple[str, Tone]:
    """The verdict in one sentence, and its tone; ``brief``: without what the misfit speaks for."""
    model = f"The model of {diagnosis.nominal.name}"
    misfit = "" if brief else misfit_clause(diagnosis)
    if diagnosis.verdict == "missing-physics" and diagnosis.findings:
        return f"{model} {joined(_faults(diagnosis.findings))}{misfit}.", "warn"
    if diagnosis.verdict == "unknown":
        left, leads = diagnosis.remainder, diagnosis.leading[:LEADS]
        where = f" What is left seems to {follows(left)}." if left is not None else ""
        first = f" Leading: {'; '.join(map(lead_words, leads))}." if leads else ""
        return f"{model} lacks something whose place and driver are not known{misfit}.{where}{first}", "warn"
    beside = [named(f) for f in diagnosis.findings]
    rest = f" Apart from {joined(beside)}, these" if beside else " These"
    return f"{model} is adequate{misfit}.{rest} readings show nothing that it leaves out.", "good"


def _faults(findings: Sequence[Finding]) -> list[str]:
    """What is wrong with the model, as verbs with their objects; each finding at the deepest level that is known."""
    law = [f for f in findings if level_of(f) == "law" and f.effect not in OF_ROWS]
    wrong = [_or_alike(f) for f in law if f.effect == "wrong-constant"]
    absent = [_or_alike(f) for f in law if f.effect != "wrong-constant"]
    rows = [named(f) for f in findings if f.effect in OF_ROWS]
    out = [f"leaves out {joined(absent)}"] if absent else []
    out += [f"has {joined(wrong)}"] if wrong else []
    clauses = driver_clauses([f for f in findings if f.effect not in OF_ROWS])
    out += [f"misses that {joined(clauses)}"] if clauses else []
    return out + ([f"was fitted beside {joined(rows)}"] if rows else [])


def _or_alike(finding: Finding) -> str:
    """A finding, and that look-alikes with a name are as good where its own is not sure."""
    alike = [other for other in finding.equivalents if not other.nameless]
    if finding.probability > CERTAIN or not alike:
        return told(finding)
    others = told(alike[0]) if len(alike) == 1 else f"one of {len(alike)} look-alikes"
    return f"{told(finding)} or {others}"


def told(item: Finding | Alternative) -> str:
    """An effect and its place as a sentence has them: ``a platform that bends (platform-deformation) at platform``."""
    name = with_article(item.effect)
    slug = f" ({item.effect})" if name != item.effect else ""
    return f"{name}{slug} {place_words(item.place)}".strip()


def follows(left: Remainder) -> str:
    """Which driver the remainder follows, hypothetically: to be said after ``seems to``."""
    if left.driver == "order":
        return "vary with the order of acquisition (a hypothesis)"
    where = f" {place_words(left.place)}" if left.place and left.place != (left.driver,) else ""
    return f"follow {left.driver or 'no recorded driver'}{where} (a hypothesis)"


_OF_WEIGHT = {LOAD: "the load that it carries", MOMENT: "the moment on it"}
"""Sources that no column holds, in words."""


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


def concealed_words(diagnosis: Diagnosis) -> str:
    """That an ordinary fit would have looked good, and where the missing physics went."""
    free = diagnosis.fits["free"]
    return (
        f"Concealed: an ordinary fit would have looked good (chi2/dof {significant(free.chi2_per_dof)}),"
        " because its free parameters swallowed what is missing. They left their drawings to do so:"
        f" {free.worst_parameter} by {significant(free.worst_parameter_sigma)} tolerances (directions that"
        " the readings hardly determine add to such figures, so the alarms below count only combinations"
        " that they do)."
    )


def certainty_words(finding: Finding) -> str:
    """How sure, at each level, and of the class."""
    if finding.levels.driver > 0.0:
        return " ".join([levels_words(finding), *_class_words(finding)])
    own = f"Probability {percent(finding.probability)} that it is {told(finding)}"
    if not finding.equivalents:
        rest = "No other explanation of the catalogue comes close"
        shared = "The rest is shared by others: see how explanations were weighed"
        return f"{own}. {rest if finding.probability > CERTAIN else shared}."
    return (
        f"{own}; {percent(finding.certainty)} that it is one of the"
        f" {several(len(finding.equivalents) + 1, 'explanation')} below, which these readings cannot tell"
        " apart."
    )


def _class_words(finding: Finding) -> list[str]:
    """How sure it is that one of the names of a class is right; nothing where there is one only."""
    named_ones = [other for other in finding.equivalents if not other.nameless]
    if not named_ones or finding.nameless:
        return []
    count = several(len(named_ones) + 1, "explanation")
    return [f"{percent(finding.certainty)} that it is one of the {count} below that have a name."]


def tolerance_words(finding: Finding) -> str:
    """Whether the naming rests on tolerances alone."""
    flip = finding.flip_lambda
    said = f"With every tolerance {significant(flip, 2)} times wider the verdict would flip."
    turn = said if known(flip) else ""
    if finding.prior_dependent:
        alone = "The naming rests on the drawing tolerances alone: free geometry could imitate this effect."
        return f"{alone} {turn}".rstrip()
    return turn or "The naming does not rest on tolerances: no widening up to a hundred times would flip it."


def alarm_name(name: str) -> str:
    """An alarm as it is called in print."""
    return _ALARM_NAMES.get(name, name)


def alarm_question(name: str) -> str:
    """What an alarm asks."""
    return _ALARMS.get(name, name)
