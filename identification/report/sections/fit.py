"""The fit before and after, and the proofs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from truepose.identification.diagnosis.holdout import ROLE, VALIDATION
from truepose.identification.diagnosis.result import Diagnosis, Proof
from truepose.identification.report.document import Block, Charts, Section, Table, Text
from truepose.identification.report.figures import fit as fit_figures
from truepose.identification.report.fits import FitColumn, fit_columns, stated_noise
from truepose.identification.report.numbers import measure, significant
from truepose.models.machine.machine import Machine


def fit_section(diagnosis: Diagnosis) -> Section:
    """Fit before and after, and the proofs."""
    blocks = fit_blocks(diagnosis.nominal, fit_columns(diagnosis))
    if diagnosis.proof is not None:
        blocks += proof_blocks(diagnosis.proof)
    else:
        blocks.append(Text("No effect was added, so there is nothing to prove on held-out rows.", "muted"))
    return Section("fit", "Fit before and after", blocks)


def fit_blocks(machine: Machine, fits: Sequence[FitColumn]) -> list[Block]:
    """Table and bars of the fits."""
    noise, units = stated_noise(machine), machine.residual_units
    caption = (
        "Misfit of each fit, in stated sigmas and as the length or angle of the whole error vector. The dashed line is the"
        " sensor's stated noise; bars should come down to it, those of validation rows (never fitted) with them."
    )
    return [_fit_table(fits, units), Charts(fit_figures.fit_bars(fits, noise, units), caption)]


def _fit_table(fits: Sequence[FitColumn], units: Mapping[str, str]) -> Table:
    rows: list[list[str]] = []
    for role, name in ((0, "calibration rows"), (1, "validation rows")):
        if all(f.sigma[role] is None for f in fits):
            continue
        rows.append([f"rms residual, {name} [σ]", *(significant(f.sigma[role]) for f in fits)])
        for kind in dict.fromkeys(kind for f in fits for kind in f.rms):
            rows.append([f"rms {kind}, {name}", *(measure(f.rms_of(role, kind), units[kind]) for f in fits)])
    rows.append(["chi2 / degree of freedom", *(significant(f.summary.chi2_per_dof) for f in fits)])
    worst = [f"{f.summary.worst_parameter} {significant(f.summary.worst_parameter_sigma)}" for f in fits]
    rows.append(["farthest parameter [tolerances]", *worst])
    # of a free fit the widened tolerances would be the yardstick, which says nothing
    allowed = [_allowed(f) for f in fits]
    rows.append(["what a true model stays below in 99 of 100 cases", *allowed])
    caption = (
        "The fits side by side. The free fit's parameters are not held to their tolerances, so its"
        " figures look best whatever is missing."
    )
    return Table(["", *(f.name for f in fits)], rows, caption)


def _allowed(fit: FitColumn) -> str:
    """The allowed farthest parameter, for fits under tolerances."""
    return "-" if fit.key == "free" else significant(fit.summary.worst_allowed)


def proof_blocks(proof: Proof) -> list[Block]:
    """Held-out ratio, placebo, black box and injection, each with what it should be."""
    low, high = proof.ratio_interval
    held = VALIDATION if proof.held_out == ROLE else proof.held_out
    part = "besides" if proof.held_out == ROLE else "of these"
    injected = {True: "found again", False: "not found again", None: "-"}[proof.injected_recovered]
    rows = [
        [
            f"held-out rms, after over before ({held})",
            f"{significant(proof.ratio)} ({significant(low)} to {significant(high)})",
            "below 1",
        ],
        *(
            [f"{part}, {b.name} ({b.rows} rows, fitted without them)", significant(b.ratio), "below 1"]
            for b in proof.blocks
            if b.name != VALIDATION
        ),
        [
            "the same for an equally flexible black box",
            significant(proof.black_box_ratio),
            "above the line before",
        ],
        [
            "log Bayes factor of a placebo (drivers shuffled)",
            significant(proof.placebo_gain),
            "near or below 0",
        ],
        ["the effect put into simulated readings", injected, "found again"],
    ]
    caption = (
        "The named physics and a black box of as many coefficients on rows that were not fitted (95 %"
        " bootstrap interval). Physics that is really there lowers the misfit where it was never fitted; mere"
        " flexibility does not."
    )
    return [Table(["proof", "result", "should be"], rows), Charts([fit_figures.proof_plot(proof)], caption)]
