"""How explanations were weighed: evidence over places, the best of them, the posterior, the alarms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from truepose.identification.diagnosis.result import Alarm, Alternative, Diagnosis
from truepose.identification.report import diagnosis_words as words
from truepose.identification.report.document import Block, Charts, Fold, Section, Table, Text
from truepose.identification.report.figures import evidence
from truepose.identification.report.numbers import p_value, percent, significant
from truepose.identification.report.sections.sets import posterior_tables

CANDIDATES = 15


def evidence_section(diagnosis: Diagnosis) -> Section:
    """Map over places and the best candidates."""
    blocks: list[Block] = []
    places = {p for f in diagnosis.findings for p in f.place}
    if diagnosis.evidence_map:
        hidden = max(len(diagnosis.evidence_map) - evidence.SHOWN, 0)
        caption = (
            "Evidence of the best single explanation at each place, weighed alone against a model that leaves"
            " nothing out. Bars beyond 3 are worth a name; a strong cause lends some evidence to places that"
            " partly imitate it." + (f" The {hidden} weakest places are not shown." if hidden else "")
        )
        blocks.append(Charts([evidence.evidence_map(diagnosis.evidence_map, places)], caption))
    else:
        blocks.append(Text("No explanation could be weighed."))
    if diagnosis.candidates:
        blocks.append(Fold("The best explanations, each weighed alone", [_best(diagnosis)]))
    blocks += posterior_tables(diagnosis)
    blocks.append(alarms(diagnosis))
    return Section("weighing", "How explanations were weighed", blocks)


def alarms(diagnosis: Diagnosis) -> Table:
    """The alarms on the model without effects, and what became of each that was raised."""
    rows = [
        [
            f"{words.alarm_name(name)}: {words.alarm_question(name)}",
            alarm.about,
            _state(diagnosis, name, alarm),
            significant(alarm.statistic),
            p_value(alarm.p),
        ]
        for name, alarm in diagnosis.alarms.items()
    ]
    caption = (
        "The three alarms on the model without effects. p: how often a machine with nothing missing would do as much; below"
        " 1 % is raised."
    )
    return Table(["alarm", "judged against", "state", "statistic", "p"], rows, caption, text_columns=3)


def _state(diagnosis: Diagnosis, name: str, alarm: Alarm) -> str:
    """Whether an alarm is raised, and what became of it; under the verdict ``adequate``, why nothing is missing."""
    if not alarm.raised:
        return "quiet"
    if diagnosis.verdict == "adequate":
        wide = max(diagnosis.inflation.values(), default=1.0)
        return (
            "raised, but no explanation is likelier than none: noise of"
            f" {significant(diagnosis.noise, 2)} and tolerances of {significant(wide, 2)} times the stated explain it"
        )
    after = diagnosis.alarms_after.get(name)
    if after is None or not diagnosis.terms:
        return "raised"
    return "raised; still raised with what was found" if after.raised else "raised; quiet with what was found"


def _best(diagnosis: Diagnosis) -> Table:
    merged = _merged(diagnosis.candidates)
    rows = [
        [
            str(k),
            words.effect_title(c.effect),
            ", ".join(c.place),
            str(n),
            significant(c.log_bayes_factor),
            percent(c.probability),
        ]
        for k, (c, n) in enumerate(merged[:CANDIDATES], 1)
    ]
    caption = (
        f"The best {len(rows)} of {len(merged)} explanations (an effect at a place), each weighed alone,"
        " before any effect was accepted. Forms: orders, lags or shapes of the effect that were tried; the"
        " best one's evidence and the sum of their probabilities are shown."
    )
    head = ["", "explanation", "place", "forms", "log Bayes factor", "probability"]
    return Table(head, rows, caption, text_columns=3)


def _merged(candidates: Sequence[Alternative]) -> list[tuple[Alternative, int]]:
    """One line an effect and place: its best form with the summed probability, how many forms; best first."""
    groups: dict[tuple[str, tuple[str, ...]], list[Alternative]] = {}
    for c in candidates:
        if np.isfinite(c.log_bayes_factor):
            groups.setdefault((c.effect, c.place), []).append(c)
    out = []
    for forms in groups.values():
        best = max(forms, key=lambda c: c.log_bayes_factor)
        out.append((replace(best, probability=sum(c.probability for c in forms)), len(forms)))
    return sorted(out, key=lambda item: -item[0].log_bayes_factor)
