"""Section 1: what was left out, and why we say so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from truepose.identification.diagnosis.outliers import fringes_by_row
from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.identification.report import diagnosis_words as words
from truepose.identification.report import verdict_reasons
from truepose.identification.report.applied_words import applied_words
from truepose.identification.report.document import Block, Card, Items, Plot, Section, Table, Text
from truepose.identification.report.level_words import NAMES, lead_words
from truepose.identification.report.numbers import known, measure, p_value, percent, significant, uncertain
from truepose.identification.report.sections.sets import posterior_tables
from truepose.identification.report.untestable_words import missing_words, untestable_lines
from truepose.wording import joined, shortened

MANY = 12


def findings_section(diagnosis: Diagnosis) -> Section:
    """The verdict in plain words, then every finding, then the alarms and what could not be tested."""
    blocks: list[Block] = []
    missing = missing_words(diagnosis.missing)
    if missing:
        blocks.append(
            Items(missing, title="What could not be tested, and what would make it testable", tone="warn")
        )
    if diagnosis.concealed and "free" in diagnosis.fits:
        blocks.append(Text(words.concealed_words(diagnosis), "warn"))
    blocks.append(Items(verdict_reasons.reasons(diagnosis), title="Why we say so"))
    applied = applied_words(diagnosis.applied) if diagnosis.verdict != "adequate" else []
    if applied:
        blocks.append(Items(applied, title="What it is worth to the tool"))
    untested = untestable_lines(diagnosis.untestable, diagnosis.missing)
    if untested:
        blocks.append(Items(untested, title="What else could not be tested"))
    doubts = verdict_reasons.doubts(diagnosis)
    if doubts:
        blocks.append(Items(doubts, title="What speaks against it", tone="warn"))
    if diagnosis.remainder is not None:
        blocks.append(_remainder(diagnosis))
    blocks += [finding_card(diagnosis, finding) for finding in diagnosis.findings if not finding.nameless]
    blocks += _nameless(diagnosis)
    if diagnosis.outlier_rows:
        blocks.append(Text(outlier_words(diagnosis.outlier_rows)))
        fringes = fringes_by_row(diagnosis.after, diagnosis.recording, diagnosis.outlier_rows)
        if fringes:
            blocks.append(Text(fringe_words(fringes)))
    blocks += posterior_tables(diagnosis)
    blocks.append(_alarms(diagnosis))
    if diagnosis.untestable:
        rows = [[words.effect_title(u.effect), u.why] for u in diagnosis.untestable]
        caption = (
            "Effects that this recording cannot speak of. None of them is excluded by the verdict above."
        )
        blocks.append(Table(["not testable", "why"], rows, caption, text_columns=2))
    return Section("verdict", "What was left out, and why we say so", blocks)


def _nameless(diagnosis: Diagnosis) -> list[Block]:
    """What has a place and a driver, and no name; and what leads below the level of a finding."""
    out: list[Block] = []
    nameless = [finding for finding in diagnosis.findings if finding.nameless]
    if nameless:
        rows = [
            [
                ", ".join(f.place),
                NAMES[f.levels.kind],
                percent(f.levels.place),
                percent(f.levels.driver),
                significant(f.log_bayes_factor),
            ]
            for f in nameless
        ]
        caption = "What is there without a law of the catalogue: where, and what it follows."
        head = ["place", "follows", "place known", "driver known", "log Bayes factor"]
        out.append(Table(head, rows, caption, text_columns=2))
    if diagnosis.leading:
        out.append(
            Items(
                [lead_words(one) for one in diagnosis.leading[:MANY]], title="Leading, less probable than not"
            )
        )
    return out


def outlier_words(rows: Sequence[int]) -> str:
    """Rows that were set aside."""
    shown = shortened([str(row) for row in rows], 30)
    return (
        f"Outliers: {words.several(len(rows), 'row')} (first line of data is row 1) lie so far from all"
        f" others that chance would not put them there: {shown}. They were not fitted."
    )


def fringe_words(rows: Mapping[int, int]) -> str:
    """Rows whose reading is off by whole half wavelengths, and by how many."""
    told = ", ".join(f"row {row} by {count:+d}" for row, count in rows.items())
    return f"Miscounted fringes: among these rows some are off by whole half wavelengths: {told}."


def _remainder(diagnosis: Diagnosis) -> Text:
    left = diagnosis.remainder
    assert left is not None
    units = diagnosis.machine.residual_units
    worth = [f"{measure(gain, units[kind])} ({kind})" for kind, gain in left.gain.items()]
    gained = f" Modelling it lowers the rms of held-out rows by {joined(worth)} more." if worth else ""
    return Text(
        f"What remains unexplained: residuals of {significant(left.size_sigma)} sigma rms, which seem to"
        f" {words.follows(left)}. Form: {words.form_words(left)}.{gained}"
    )


def _alarms(diagnosis: Diagnosis) -> Table:
    rows = []
    for name, alarm in diagnosis.alarms.items():
        asked = f"{words.alarm_name(name)}: {words.alarm_question(name)}"
        rows.append(
            [
                asked,
                alarm.about,
                significant(alarm.statistic),
                p_value(alarm.p),
                "raised" if alarm.raised else "quiet",
            ]
        )
    caption = (
        "The three alarms on the model without effects. p: how often a machine with nothing missing would do"
        " as much; below 1 % is raised."
    )
    return Table(["alarm", "judged against", "statistic", "p", "state"], rows, caption, text_columns=2)


def finding_card(diagnosis: Diagnosis, finding: Finding) -> Card:
    """One finding: how large, how sure, what cannot be told from it, what would tell."""
    where = ", ".join(finding.place) or "whole recording"
    blocks: list[Text | Items | Table | Plot] = (
        [Text(words.explanation(finding))] if finding.explanation else []
    )
    entry = words.effect_class(finding.effect)
    if entry is not None and entry.formula:
        blocks.append(Text(f"Formula: {entry.formula}. Usual size: {entry.size or 'not stated'}.", "muted"))
    if finding.parameters:
        blocks.append(_amplitudes(finding))
    blocks.append(Text(f"How sure: {words.certainty_words(finding)}"))
    if finding.equivalents:
        blocks.append(_class_table(finding))
    blocks.append(Text(words.tolerance_words(finding), "warn" if finding.prior_dependent else ""))
    experiment = words.separating_experiment(finding)
    if experiment:
        lead = "To tell them apart" if finding.equivalents else "To check it on the machine"
        blocks.append(Text(f"{lead}: {experiment.rstrip('.')}."))
    return Card(
        f"{words.effect_title(finding.effect)} at {where}", blocks, badge=percent(finding.probability)
    )


def _amplitudes(finding: Finding) -> Table:
    rows = [
        [name, uncertain(q.value, q.std, q.unit), _sizes(q.value, q.std)]
        for name, q in finding.parameters.items()
    ]
    head = ["amplitude", "estimate ± 1 sigma", "estimate / sigma"]
    fixed = _settings_words(finding.settings)
    caption = f"Estimated in the fit with effects{f'; setting {fixed}' if fixed else ''}."
    if len(rows) > MANY:
        half = (len(rows) + 1) // 2
        padded = [*rows[half:], *[["", "", ""]] * (2 * half - len(rows))]
        return Table([*head, *head], [[*a, *b] for a, b in zip(rows[:half], padded, strict=True)], caption)
    return Table(head, rows, caption)


def _sizes(value: float, std: float) -> str:
    return significant(abs(value) / std, 2) if known(value) and known(std) and std > 0 else "-"


def _settings_words(settings: Sequence[Mapping[str, float]]) -> str:
    return "; ".join(
        ", ".join(f"{name} = {value:g}" for name, value in one.items()) for one in settings if one
    )


def _class_table(finding: Finding) -> Table:
    rows = [
        [
            finding.effect,
            ", ".join(finding.place),
            percent(finding.probability),
            significant(finding.log_bayes_factor),
            "(named above)",
        ]
    ]
    for other in finding.equivalents:
        rows.append(
            [
                other.effect,
                ", ".join(other.place),
                percent(other.probability),
                significant(other.log_bayes_factor),
                other.experiment,
            ]
        )
    ordered = [[row[0], row[1], row[4], row[2], row[3]] for row in rows]
    caption = (
        "Explanations that these readings cannot tell apart, each with the probability that it is there at all:"
        " several may be."
    )
    return Table(
        ["explanation", "place", "what would tell", "probability", "log Bayes factor"],
        ordered,
        caption,
        text_columns=3,
    )
