"""How explanations were weighed: the best of them alone, the posterior over sets of them, and the alarms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from truepose.identification.diagnosis.result import Alarm, Alternative, Diagnosis
from truepose.identification.report.finding_words import set_words
from truepose.identification.report.naming import effect_title, several
from truepose.identification.report.numbers import p_value, percent, significant
from truepose.identification.report.verdict import ALARMS
from truepose.shown.document import Block, Fold, Section, Table, Text

CANDIDATES, SETS, EFFECTS = 15, 5, 10


def weighing_section(diagnosis: Diagnosis) -> Section:
    """The best candidates, the likeliest sets, effects one by one, alarms."""
    merged = _merged(diagnosis.candidates)
    blocks: list[Block] = [Text("No explanation could be weighed.")]
    if merged:
        blocks = [Fold("The best explanations, each weighed alone", [_best(merged)])]
    if diagnosis.sets:
        rows = [[set_words(one.effects), percent(one.probability)] for one in diagnosis.sets[:SETS]]
        caption = (
            "The likeliest sets: these terms are there and no others, each by the effect whose form it has. What has no name in"
            " the catalogue is called a form without a name (empirical)."
        )
        blocks.append(Table(["set of effects", "probability"], rows, caption))
    if diagnosis.inclusion:
        shown, hidden = diagnosis.inclusion[:EFFECTS], len(diagnosis.inclusion) - EFFECTS
        rows = [[effect_title(i.effect), ", ".join(i.place), percent(i.probability)] for i in shown]
        caption = "Probability that an effect is there with this very law, in all sets together."
        caption += f" {several(hidden, 'less probable one')} left out." if hidden > 0 else ""
        blocks.append(Table(["effect", "place", "probability"], rows, caption, text_columns=2))
    return Section("weighing", "How explanations were weighed", [*blocks, alarms_table(diagnosis)])


def alarms_table(diagnosis: Diagnosis) -> Table:
    """The alarms on the model without effects, and what became of each that was raised."""
    rows = [
        [
            ": ".join(ALARMS.get(name, (name,))),
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


def _best(merged: Sequence[tuple[Alternative, int]]) -> Table:
    rows = [
        [
            str(k),
            effect_title(c.effect),
            ", ".join(c.place),
            str(n),
            significant(c.log_bayes_factor),
            percent(c.probability),
        ]
        for k, (c, n) in enumerate(merged[:CANDIDATES], 1)
    ]
    caption = (
        f"The best {len(rows)} of {len(merged)} explanations (an effect at a place), each weighed alone, before any effect was"
        " accepted. Forms: orders, lags or shapes of the effect that were tried; the best one's evidence and the sum of their"
        " probabilities are shown. A log Bayes factor of 3 is worth a name."
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
