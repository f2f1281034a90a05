"""The posterior in two short tables: the likeliest sets of effects, and how probable each effect is at each place."""

from __future__ import annotations

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.report import diagnosis_words as words
from truepose.identification.report.document import Table
from truepose.identification.report.level_words import NAMES
from truepose.identification.report.numbers import percent
from truepose.wording import joined

SETS, EFFECTS = 5, 10


def posterior_tables(diagnosis: Diagnosis) -> list[Table]:
    """The likeliest sets, then effects one by one; none where nothing was sampled."""
    out = []
    if diagnosis.sets:
        rows = [[words.set_words(one.effects), percent(one.probability)] for one in diagnosis.sets[:SETS]]
        caption = (
            "The likeliest sets: these terms are there and no others, each by the effect whose form it has. What has no"
            " name in the catalogue is called a form without a name (empirical)."
        )
        out.append(Table(["set of effects", "probability"], rows, caption))
    if diagnosis.inclusion:
        rows = [
            [words.effect_title(i.effect), ", ".join(i.place), percent(i.probability)]
            for i in diagnosis.inclusion[:EFFECTS]
        ]
        hidden = len(diagnosis.inclusion) - EFFECTS
        caption = "Probability that an effect is there with this very law, in all sets together."
        caption += f" {words.several(hidden, 'less probable one')} left out." if hidden > 0 else ""
        out.append(Table(["effect", "place", "probability"], rows, caption, text_columns=2))
    if diagnosis.together:
        lines = [
            [joined(one.places, "or"), NAMES[one.driver], percent(one.probability)]
            for one in diagnosis.together
        ]
        caption = "Probability that at least one of these places answers to the driver, where none is sure by itself."
        out.append(Table(["one of", "driver", "probability"], lines, caption, text_columns=2))
    return out
