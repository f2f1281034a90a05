"""A diagnosis as a document, top to bottom: first screen, findings, fits, residuals, constants, uncertainty, limits, origin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from truepose.arrays import Index
from truepose.identification.diagnosis.null_fits import fringes_by_row
from truepose.identification.diagnosis.result import Alternative, Diagnosis, Finding
from truepose.identification.fit.estimated import Estimate
from truepose.identification.report import finding_words as words
from truepose.identification.report import verdict
from truepose.identification.report.applied_words import applied_words, diagnosis_gains
from truepose.identification.report.closing import (
    diagnosis_steps,
    limits_section,
    origin_section,
    uncertainty_section,
)
from truepose.identification.report.constants import constants_section, mount_words
from truepose.identification.report.curves import Curve, all_curves, curve_chart
from truepose.identification.report.estimate import document_facts
from truepose.identification.report.notes import diagnosis_notes
from truepose.identification.report.phrases import (
    coefficient_words,
    effect_title,
    excluded_words,
    measure,
    named,
    percent,
    significant,
    unit_symbol,
    with_article,
)
from truepose.identification.report.residuals import picked, residual_section, telling_drivers
from truepose.identification.report.results import diagnosis_judgement
from truepose.identification.report.scene import scene_of
from truepose.shown.document import Block, Card, Charts, Document, Guilty, Items, Section, Table, Text
from truepose.shown.result import document
from truepose.wording import joined

MOST, GUILTY = 12, 8
_VERDICTS = {"missing-physics": "physics is missing", "unknown": "something is missing"}
_CURVES = (
    "What the finding adds against what drives it. Line and band: what was identified, with its 95 % interval. Dots: what each"
    " row says of it by itself, the fitted value plus that row's own residual; they should scatter about the line."
)


@document.register
def diagnosis_document(found: Diagnosis, output: Path | None = None, checked: bool = False) -> Document:
    """Return the document of a diagnosis whose results are in the folder ``output`` (None for a page, which names files alone).

    checked: whether ``check`` has looked at the files, so that nobody is sent back to it.
    """
    said, tone = verdict.headline(found)
    judgement = diagnosis_judgement(found)
    if judgement.refusal:
        said, tone = f"{judgement.refusal}. {said}", "warn"
    fits = {"before": found.before} | ({"after": found.after} if found.terms else {})
    rows = picked(found.nominal, found.recording, len(fits))
    facts = [("verdict", _VERDICTS.get(found.verdict, found.verdict))]
    return Document(
        f"truepose: diagnosis of {found.nominal.name}",
        said,
        tone,
        [*facts, *document_facts(found.nominal.name, found.recording, found.before)],
        diagnosis_gains(found),
        [one for one in _summary(found) if one.items],
        diagnosis_steps(found, output, calibrated=judgement.calibrated, checked=checked),
        diagnosis_notes(found),
        more="see report.html",
        sections=lambda: _sections(found, fits, rows),
        scene=lambda: scene_of(
            found.before,
            found.after if found.terms else None,
            found.recording,
            [_guilty(f) for f in found.findings[:GUILTY]],
        ),
        rows=rows.tolist(),
    )


def _summary(found: Diagnosis) -> list[Items]:
    """Return what was found, how sure, what it is worth, what speaks against it, what was not tested, what was left out."""
    cannot = [
        *verdict.missing_words(found.missing, effect_title),
        *verdict.untestable_lines(found.untestable, found.missing, effect_title),
    ]
    fits = ", ".join(f"{name} {significant(fit.chi2_per_dof)}" for name, fit in found.fits.items())
    leads = [words.lead_words(one) for one in found.leading[:MOST]]
    return [
        Items([words.finding_item(f) for f in found.findings], "What was found", weight=3),
        Items(leads, "Leading, less probable than not", label="leading"),
        Items([words.together_words(one) for one in found.together], "Together", label="together"),
        Items(_remainder(found), "What remains", label="remainder"),
        Items([*applied_words(found.applied), *mount_words(found.after)], "What improved.yaml holds"),
        Items(verdict.doubts(found), "What speaks against it", "warn", "against it"),
        Items(cannot, "What could not be tested", "warn", "could not be tested"),
        Items(_excluded(found), "Rows left out"),
        Items([f"chi2 per degree of freedom: {fits}"], "Misfit"),
    ]


def _remainder(found: Diagnosis) -> list[str]:
    left, units = found.remainder, found.nominal.residual_units
    if left is None:
        return []
    worth = [f"{measure(gain, units[kind])} ({kind})" for kind, gain in left.gain.items()]
    gained = f"; modelling it lowers the rms of held-out rows by {joined(worth)} more" if worth else ""
    return [f"{significant(left.size_sigma)} sigma rms, {words.form_words(left)}{gained}"]


def _excluded(found: Diagnosis) -> list[str]:
    if not found.outlier_rows:
        return []
    fringes = fringes_by_row(found.after, found.recording, found.outlier_rows)
    off = [f"row {row} by {count:+d}" for row, count in fringes.items()]
    more = [f"miscounted fringes, off by whole half wavelengths: {', '.join(off)}"] if off else []
    return [excluded_words(found.outlier_rows), *more]


def _guilty(finding: Finding) -> Guilty:
    said, sure = words.known_words(finding)
    return Guilty(said, "" if finding.nameless else finding.effect, sure, finding.place)


def _sections(found: Diagnosis, fits: Mapping[str, Estimate], rows: Index) -> list[Section]:
    machine, recording = found.nominal, found.recording
    estimates, last = {"free": found.free, **fits}, list(fits)[-1]
    allowed = found.fits[last].worst_allowed if last in found.fits else None
    averaged = bool(found.terms)
    return [
        _findings_section(found, rows),
        residual_section(machine, recording, fits, telling_drivers(found), rows),
        constants_section(found.after, "improved.yaml", estimates, allowed, averaged=averaged),
        uncertainty_section(found.after, recording, found.before),
        limits_section(fits[last], diagnosis_notes(found)),
        origin_section(machine, recording, "diagnose"),
    ]


def _findings_section(found: Diagnosis, rows: Index) -> Section:
    """Return why the verdict is what it is, then every finding."""
    blocks: list[Block] = []
    if found.concealed and "free" in found.fits:
        blocks.append(Text(verdict.concealed_words(found), "warn"))
    blocks.append(Items(verdict.reasons(found), title="Why we say so"))
    curves = all_curves(found, found.findings, rows)
    pairs = zip(found.findings, curves, strict=True)
    blocks += [_card(finding, own, rows, number) for number, (finding, own) in enumerate(pairs, 1)]
    return Section("verdict", "What was left out, and why we say so", blocks)


def _card(finding: Finding, curves: Sequence[Curve], rows: Index, number: int) -> Card:
    """Return what a finding is, how large, how sure, what cannot be told from it, and what would tell."""
    title, sure = words.known_words(finding)
    hedge = "" if words.is_law_known(finding) else f"If it is {with_article(finding.effect)}: "
    blocks: list[Block] = [Text(f"{hedge}{words.explanation(finding)}")] if finding.explanation else []
    if finding.parameters:
        size = coefficient_words(finding.parameters).replace(" +- ", " ± ")
        settings = "".join(f"; {name} {value:g}" for one in finding.settings for name, value in one.items())
        blocks.append(Text(f"Size: {size}{settings} (likeliest explanation)."))
    blocks.append(Text(f"How sure: {words.sure_words(finding)}"))
    if curves:
        blocks.append(Charts([curve_chart(curve, rows) for curve in curves], _CURVES))
    if finding.equivalents:
        alike = [_alternative_words(other) for other in finding.equivalents]
        blocks.append(Items(alike, "Explanations that these readings cannot tell from it"))
    experiment = words.separating_experiment(finding)
    if experiment:
        lead = "To tell them apart" if finding.equivalents else "To check it on the machine"
        blocks.append(Text(f"{lead}: {experiment.rstrip('.')}."))
    blocks.append(Text(words.tolerance_words(finding), "warn" if finding.prior_dependent else "muted"))
    return Card(f"{title[0].upper()}{title[1:]}", blocks, badge=sure, slug=finding.effect, number=number)


def _alternative_words(other: Alternative) -> str:
    name = f"something without a name at {joined(other.place)}" if other.nameless else named(other)
    experiment = f"; what would tell: {other.experiment}" if other.experiment else ""
    return f"{name}: {percent(other.probability)}, log Bayes factor {significant(other.log_bayes_factor)}{experiment}"


@document.register
def _(found: Finding) -> Document:
    alike = [f"could also be: {named(other)} ({percent(other.probability)})" for other in found.equivalents]
    experiment = words.separating_experiment(found)
    rows = [
        [name, f"{q.value:.6g}", f"{q.std:.2g}", unit_symbol(q.unit)] for name, q in found.parameters.items()
    ]
    facts = [
        words.sure_words(found),
        words.tolerance_words(found),
        *alike,
        *([f"what would separate it: {experiment}"] if experiment else []),
    ]
    return Document(
        f"Finding {named(found)}",
        f"Finding {named(found)}: {words.explanation(found)}",
        summary=[Items(facts), Table(["coefficient", "value", "1-sigma", "unit"], rows)],
        more="to_frame() has all coefficients",
    )
