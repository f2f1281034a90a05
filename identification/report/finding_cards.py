"""Every finding with what it does, how sure it is, what cannot be told from it and what would tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification.diagnosis.result import UNNAMED, Alternative, Diagnosis, Finding
from truepose.identification.report import finding_words as words
from truepose.identification.report import verdict
from truepose.identification.report.curves import Curve, all_curves
from truepose.identification.report.formulas import coupling_matrix
from truepose.identification.report.naming import coefficient_words, effect_class, effect_title, with_article
from truepose.identification.report.numbers import known, percent, significant, uncertain
from truepose.models.machine.mechanism import vector_of
from truepose.shown.chart import Axis, Band, Cells, Chart, Layer, Level, Line, Marks
from truepose.shown.document import Block, Card, Charts, Fold, Items, Section, Table, Text

MANY = 12
"""Most charts of findings without a name."""
COLUMNS_WITH_NUMBERS = 8
"""Columns of a matrix up to which its numbers stand in the cells."""
BAND = 1.96
_CURVES = (
    "What the finding adds against what drives it. Line and band: what was identified, with its 95 % interval. Dots: what each"
    " row says of it by itself, the fitted value plus that row's own residual; they should scatter about the line."
)


def findings_section(diagnosis: Diagnosis, rows: Index) -> Section:
    """Why the verdict is what it is, then every finding. ``rows``: those that charts draw."""
    blocks: list[Block] = []
    if diagnosis.concealed and "free" in diagnosis.fits:
        blocks.append(Text(verdict.concealed_words(diagnosis), "warn"))
    blocks.append(Items(verdict.reasons(diagnosis), title="Why we say so"))
    found = all_curves(diagnosis, diagnosis.findings, rows)
    drawn = [[curve.thinned(rows) for curve in own] for own in found]
    pairs = list(zip(range(1, len(drawn) + 1), diagnosis.findings, drawn, strict=True))
    blocks += [finding_card(diagnosis, f, own, number) for number, f, own in pairs if not f.nameless]
    nameless = [(number, f, own) for number, f, own in pairs if f.nameless]
    if nameless:
        blocks.append(_nameless([(number, f) for number, f, _ in nameless]))
        charts = [curve_chart(curve) for _, _, own in nameless for curve in own]
        blocks += [Charts(charts[:MANY], _CURVES)] if charts else []
    return Section("verdict", "What was left out, and why we say so", blocks)


def _nameless(findings: Sequence[tuple[int, Finding]]) -> Table:
    rows = [
        [
            str(number),
            ", ".join(f.place),
            words.NAMES[f.levels.kind],
            percent(f.levels.place),
            percent(f.levels.driver),
            significant(f.log_bayes_factor),
        ]
        for number, f in findings
    ]
    caption = "What is there without a law of the catalogue: where, and what it follows."
    head = ["", "place", "follows", "place known", "driver known", "log Bayes factor"]
    return Table(head, rows, caption, text_columns=3)


def finding_card(diagnosis: Diagnosis, finding: Finding, drawn: Sequence[Curve], number: int = 0) -> Card:
    """One finding: what it is, how large, how sure, what cannot be told from it, what would tell."""
    hedge = "" if words.is_law_known(finding) else f"If it is {with_article(finding.effect)}: "
    blocks: list[Block] = [Text(f"{hedge}{words.explanation(finding)}")] if finding.explanation else []
    if finding.parameters:
        size = coefficient_words(finding.parameters).replace(" +- ", " ± ")
        blocks.append(Text(f"Size: {size} (likeliest explanation)."))
    blocks.append(Text(f"How sure: {words.sure_words(finding)}"))
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
    title, sure = words.known_words(finding)
    return Card(f"{title[0].upper()}{title[1:]}", blocks, badge=sure, slug=finding.effect, number=number)


def _pictures(diagnosis: Diagnosis, finding: Finding, drawn: Sequence[Curve]) -> list[Block]:
    """A matrix as a heat map, and what the finding adds against what drives it."""
    out: list[Block] = []
    found = coupling_matrix(diagnosis, finding)
    if found is not None:
        ports, values = found
        chart = matrix(1e3 * values, list(map(vector_of, ports)), diagnosis.nominal.mechanism.readings)
        said = "How far each part moves as each joint travels by one, in thousandths. Blue: along, orange: against it."
        out.append(Charts([chart], said))
    return [*out, Charts([curve_chart(curve) for curve in drawn], _CURVES)] if drawn else out


def _amplitudes(finding: Finding) -> Block:
    rows = [
        [name, uncertain(q.value, q.std, q.unit), _sizes(q.value, q.std)]
        for name, q in finding.parameters.items()
    ]
    settings = "; ".join(_settings(one) for one in finding.settings if one)
    entry = effect_class(finding.effect)
    formula = (
        f"Formula: {entry.formula}. Usual size: {entry.size or 'not stated'}. "
        if entry and entry.formula
        else ""
    )
    caption = f"{formula}Estimated in the fit with effects{f'; setting {settings}' if settings else ''}."
    title = "Formula and amplitude" if len(rows) == 1 else f"Formula and {len(rows)} amplitudes"
    return Fold(title, [Table(["amplitude", "estimate ± 1 sigma", "estimate / sigma"], rows, caption)])


def _sizes(value: float, std: float) -> str:
    return significant(abs(value) / std, 2) if known(value) and known(std) and std > 0 else "-"


def _settings(one: Mapping[str, float]) -> str:
    return ", ".join(f"{name} = {value:g}" for name, value in one.items())


def _class_table(finding: Finding) -> Table:
    every: list[Finding | Alternative] = [finding, *finding.equivalents]
    rows = [
        [
            "something without a name" if other.effect == UNNAMED else effect_title(other.effect),
            ", ".join(other.place),
            "(named above)" if other is finding else other.experiment,
            percent(other.probability),
            significant(other.log_bayes_factor),
        ]
        for other in every
    ]
    caption = "Explanations that these readings cannot tell apart, each with the probability that it is there at all."
    head = ["explanation", "place", "what would tell", "probability", "log Bayes factor"]
    return Table(head, rows, caption, text_columns=3)


def curve_chart(curve: Curve) -> Chart:
    """What was identified with its 95 % band, and what each row says of it."""
    layers: list[Layer] = [Level(0.0, "y", dashed=False)]
    low, high = curve.y - BAND * curve.std, curve.y + BAND * curve.std
    if len(curve.x):
        layers.append(Band(curve.x, low, high, "after", "95 % band"))
    axis = Axis(curve.y_title)
    if curve.rows is not None:
        layers.append(Marks(curve.measured, curve.rows, "before", "each row", by_row=True))
        axis = Axis(curve.y_title, *_ends(curve.rows, low, high))
    if len(curve.x):
        layers.append(Line(curve.x, curve.y, "after", "identified"))
    if curve.fitted is not None:
        layers.append(Marks(curve.measured, curve.fitted, "after", "identified, in each row", by_row=True))
    return Chart(curve.title, Axis(curve.x_title), axis, layers)


def _ends(rows: Array, low: Array, high: Array) -> tuple[float, float]:
    """Ends that show the function and all but the wildest rows."""
    known_rows = rows[np.isfinite(rows)]
    ends = np.quantile(known_rows, [0.01, 0.99]) if known_rows.size else np.zeros(2)
    lowest = min(float(ends[0]), float(np.min(low, initial=0.0)))
    highest = max(float(ends[1]), float(np.max(high, initial=0.0)))
    room = 0.08 * (highest - lowest) or 1.0
    return lowest - room, highest + room


def matrix(values: Array, rows: Sequence[str], columns: Sequence[str]) -> Chart:
    """A matrix (r, c) as a heat map, with its numbers where there is room."""
    numbers = len(columns) <= COLUMNS_WITH_NUMBERS
    texts = [[f"{v:.2g}" for v in line] for line in values.tolist()] if numbers else []
    height = 70.0 + max(len(rows), 4) * (22.0 if numbers else 300.0 / max(len(rows), 12))
    axes = Axis("joint that travels", names=columns), Axis("what moves [10⁻³]", names=rows)
    return Chart("", *axes, [Cells(values, texts)], height=height)
