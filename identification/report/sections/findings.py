"""What was left out, and why we say so: the verdict, then every finding with what it does and how sure it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from truepose.arrays import Index
from truepose.identification.diagnosis.null_fits import fringes_by_row
from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.identification.report import diagnosis_words as words
from truepose.identification.report import verdict_reasons
from truepose.identification.report.applied_words import applied_words
from truepose.identification.report.coefficient_words import coefficient_words
from truepose.identification.report.curves import Curve, all_curves
from truepose.identification.report.document import Block, Card, Charts, Fold, Items, Section, Table, Text
from truepose.identification.report.figures.effects import curve_charts, matrix
from truepose.identification.report.formulas import coupling_matrix
from truepose.identification.report.level_words import NAMES, known_words, lead_words, level_of, with_article
from truepose.identification.report.numbers import known, measure, percent, significant, uncertain
from truepose.identification.report.row_words import excluded_words
from truepose.identification.report.untestable_words import missing_words, untestable_lines
from truepose.models.machine.mechanism import vector_of
from truepose.wording import joined

MANY = 12
"""Coefficients up to which a table of them is open."""
AVERAGES = (
    "improved.yaml holds the average over all explanations that the readings allow, each weighed by its probability. Its"
    " numbers, and the errors that come of them, therefore differ a little from those of the likeliest explanation, which the"
    " findings tell."
)
"""What no one may misread."""


def findings_section(diagnosis: Diagnosis, rows: Index) -> Section:
    """The verdict in plain words, then every finding. ``rows``: those that charts draw."""
    blocks: list[Block] = []
    if diagnosis.concealed and "free" in diagnosis.fits:
        blocks.append(Text(words.concealed_words(diagnosis), "warn"))
    blocks.append(Items(verdict_reasons.reasons(diagnosis), title="Why we say so"))
    applied = applied_words(diagnosis.applied) if diagnosis.verdict != "adequate" else []
    if applied:
        blocks.append(Items([*applied, AVERAGES], title="What improved.yaml is worth to the tool"))
    blocks += _untested(diagnosis)
    doubts = verdict_reasons.doubts(diagnosis)
    if doubts:
        blocks.append(Items(doubts, title="What speaks against it", tone="warn"))
    if diagnosis.remainder is not None:
        blocks.append(_remainder(diagnosis))
    drawn = [
        [curve.thinned(rows) for curve in found] for found in all_curves(diagnosis, diagnosis.findings, rows)
    ]
    blocks += [
        finding_card(diagnosis, finding, own, number)
        for number, (finding, own) in enumerate(zip(diagnosis.findings, drawn, strict=True), 1)
        if not finding.nameless
    ]
    blocks += _nameless(diagnosis, drawn)
    if diagnosis.outlier_rows:
        blocks.append(Text(outlier_words(diagnosis.outlier_rows)))
        fringes = fringes_by_row(diagnosis.after, diagnosis.recording, diagnosis.outlier_rows)
        if fringes:
            blocks.append(Text(fringe_words(fringes)))
    return Section("verdict", "What was left out, and why we say so", blocks)


def _untested(diagnosis: Diagnosis) -> list[Block]:
    out: list[Block] = []
    missing = missing_words(diagnosis.missing, words.effect_title)
    if missing:
        title = "What could not be tested, and what would make it testable"
        out.append(Items(missing, title=title, tone="warn"))
    others = untestable_lines(diagnosis.untestable, diagnosis.missing, words.effect_title)
    return [*out, Items(others, title="What else could not be tested")] if others else out


def _nameless(diagnosis: Diagnosis, drawn: Sequence[Sequence[Curve]]) -> list[Block]:
    """What has a place and a driver, and no name; and what leads below the level of a finding."""
    out: list[Block] = []
    nameless = [(k, finding) for k, finding in enumerate(diagnosis.findings, 1) if finding.nameless]
    if nameless:
        rows = [
            [
                str(k),
                ", ".join(f.place),
                NAMES[f.levels.kind],
                percent(f.levels.place),
                percent(f.levels.driver),
                significant(f.log_bayes_factor),
            ]
            for k, f in nameless
        ]
        caption = "What is there without a law of the catalogue: where, and what it follows."
        head = ["", "place", "follows", "place known", "driver known", "log Bayes factor"]
        out.append(Table(head, rows, caption, text_columns=3))
        found = [chart for k, _ in nameless for chart in curve_charts(drawn[k - 1])]
        if found:
            out.append(Charts(found[:MANY], _CURVES))
    if diagnosis.leading:
        leads = [lead_words(one) for one in diagnosis.leading[:MANY]]
        out.append(Items(leads, title="Leading, less probable than not"))
    return out


def outlier_words(rows: Sequence[int]) -> str:
    """Say which rows were excluded, and why."""
    alone = len(rows) == 1
    return (
        f"Outliers: {excluded_words(rows, 30)} (the first line of data is row 1). Chance alone would not put"
        f" {'it' if alone else 'them'} so far from all others."
    )


def fringe_words(rows: Mapping[int, int]) -> str:
    """Rows whose reading is off by whole half wavelengths, and by how many."""
    told = ", ".join(f"row {row} by {count:+d}" for row, count in rows.items())
    return f"Miscounted fringes: among these rows some are off by whole half wavelengths: {told}."


def _remainder(diagnosis: Diagnosis) -> Text:
    left = diagnosis.remainder
    assert left is not None
    units = diagnosis.nominal.residual_units
    worth = [f"{measure(gain, units[kind])} ({kind})" for kind, gain in left.gain.items()]
    gained = f" Modelling it lowers the rms of held-out rows by {joined(worth)} more." if worth else ""
    return Text(
        f"What remains unexplained: residuals of {significant(left.size_sigma)} sigma rms, which seem to"
        f" {words.follows(left)}. Form: {words.form_words(left)}.{gained}"
    )


_CURVES = (
    "What the finding adds against what drives it. Line and band: what was identified, with its 95 % interval. Dots: what each"
    " row says of it by itself, the fitted value plus that row's own residual; they should scatter about the line."
)


def finding_card(diagnosis: Diagnosis, finding: Finding, drawn: Sequence[Curve], number: int = 0) -> Card:
    """One finding: what it is, how large, how sure, what cannot be told from it, what would tell."""
    certain = level_of(finding) == "law" or not finding.levels.driver
    hedge = "" if certain else f"If it is {with_article(finding.effect)}: "
    blocks: list[Block] = [Text(f"{hedge}{words.explanation(finding)}")] if finding.explanation else []
    if finding.parameters:
        blocks.append(
            Text(
                f"Size: {coefficient_words(finding.parameters).replace(' +- ', ' ± ')} (likeliest explanation)."
            )
        )
    blocks.append(Text(f"How sure: {words.certainty_words(finding)}"))
    blocks += _pictures(diagnosis, finding, drawn)
    if finding.equivalents:
        blocks.append(_class_table(finding))
    experiment = words.separating_experiment(finding)
    if experiment:
        lead = "To tell them apart" if finding.equivalents else "To check it on the machine"
        blocks.append(Text(f"{lead}: {experiment.rstrip('.')}."))
    blocks.append(Text(words.tolerance_words(finding), "warn" if finding.prior_dependent else "muted"))
    if finding.parameters:
        blocks.append(_amplitudes(finding))
    title, sure = known_words(finding)
    return Card(
        f"{title[0].upper()}{title[1:]}" if certain else title,
        blocks,
        badge=sure,
        slug=finding.effect,
        number=number,
    )


def _pictures(diagnosis: Diagnosis, finding: Finding, drawn: Sequence[Curve]) -> list[Block]:
    """A matrix as a heat map, and what the finding adds against what drives it."""
    out: list[Block] = []
    found = coupling_matrix(diagnosis, finding)
    if found is not None:
        ports, values = found
        axes = ("joint that travels", "what moves [10⁻³]")
        names = diagnosis.nominal.mechanism.readings
        chart = matrix("", 1e3 * values, list(map(vector_of, ports)), names, axes)
        said = "How far each part moves as each joint travels by one, in thousandths. Blue: along, orange: against it."
        out.append(Charts([chart], said))
    return [*out, Charts(curve_charts(drawn), _CURVES)] if drawn else out


def _amplitudes(finding: Finding) -> Block:
    rows = [
        [name, uncertain(q.value, q.std, q.unit), _sizes(q.value, q.std)]
        for name, q in finding.parameters.items()
    ]
    head = ["amplitude", "estimate ± 1 sigma", "estimate / sigma"]
    fixed = _settings_words(finding.settings)
    entry = words.effect_class(finding.effect)
    formula = (
        f"Formula: {entry.formula}. Usual size: {entry.size or 'not stated'}. "
        if entry and entry.formula
        else ""
    )
    caption = f"{formula}Estimated in the fit with effects{f'; setting {fixed}' if fixed else ''}."
    title = "Formula and amplitude" if len(rows) == 1 else f"Formula and {len(rows)} amplitudes"
    return Fold(title, [Table(head, rows, caption)])


def _sizes(value: float, std: float) -> str:
    return significant(abs(value) / std, 2) if known(value) and known(std) and std > 0 else "-"


def _settings_words(settings: Sequence[Mapping[str, float]]) -> str:
    return "; ".join(
        ", ".join(f"{name} = {value:g}" for name, value in one.items()) for one in settings if one
    )


def _class_table(finding: Finding) -> Table:
    first = [
        words.effect_title(finding.effect),
        ", ".join(finding.place),
        "(named above)",
        percent(finding.probability),
        significant(finding.log_bayes_factor),
    ]
    rows = [
        [
            "something without a name" if other.nameless else words.effect_title(other.effect),
            ", ".join(other.place),
            other.experiment,
            percent(other.probability),
            significant(other.log_bayes_factor),
        ]
        for other in finding.equivalents
    ]
    caption = (
        "Explanations that these readings cannot tell apart, each with the probability that it is there at all:"
        " several may be."
    )
    head = ["explanation", "place", "what would tell", "probability", "log Bayes factor"]
    return Table(head, [first, *rows], caption, text_columns=3)
