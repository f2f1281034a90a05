"""What the data cannot tell."""

from __future__ import annotations

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.report import diagnosis_words as words
from truepose.identification.report import gauge
from truepose.identification.report.document import Block, Items, Section, Table
from truepose.identification.report.notes import diagnosis_notes
from truepose.identification.report.numbers import significant
from truepose.wording import joined


def limits_section(diagnosis: Diagnosis) -> Section:
    """What the data cannot tell."""
    fit = diagnosis.after if diagnosis.terms else diagnosis.before
    blocks = limits_blocks(fit)
    same = [
        f"{words.named(f)}: also {joined([words.named(e) for e in f.equivalents], 'or')}"
        for f in diagnosis.findings
        if f.equivalents
    ]
    if same:
        blocks.append(Items(same, title="Explanations that cannot be told apart"))
    if diagnosis.untestable:
        rows = [[words.effect_title(u.effect), u.why] for u in diagnosis.untestable]
        caption = "Effects that this recording cannot speak of. None of them is excluded by the verdict."
        blocks.append(Table(["not testable", "why"], rows, caption, text_columns=2))
    left = diagnosis.remainder
    if left is not None:
        rows = [
            ["driver", left.driver or "-"],
            ["place", ", ".join(left.place) or "-"],
            ["form", words.form_words(left)],
            ["size", f"{significant(left.size_sigma)} σ"],
        ]
        blocks.append(Table(["remainder (hypothesised)", ""], rows, text_columns=2))
    notes = diagnosis_notes(diagnosis)
    if notes:
        blocks.append(Items(notes, title="Notes"))
    return Section("limits", "What the data cannot tell", blocks)


def limits_blocks(fit: Estimate) -> list[Block]:
    """Rank, blind directions and weakly determined parameters, in words."""
    return [Items([*gauge.rank_words(fit), *gauge.weak_words(fit)], title="Geometry")]
