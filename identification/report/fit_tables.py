"""The fits side by side, and the proofs on rows that were not fitted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.diagnosis.holdout import ROLE, VALIDATION
from truepose.identification.diagnosis.result import Diagnosis, Proof
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.summary import FitSummary
from truepose.identification.report.numbers import measure, significant
from truepose.shown.document import Section, Table, Text

NAMES = {
    "free": "ordinary fit, parameters free",
    "before": "under tolerances, no effects",
    "calibrated": "calibrated, under tolerances",
    "after": "under tolerances, with effects",
}


def fit_section(diagnosis: Diagnosis) -> Section:
    """Fit before and after, and the proofs."""
    fits = {"free": diagnosis.free, "before": diagnosis.before}
    if diagnosis.terms:
        fits["after"] = diagnosis.after
    proof = diagnosis.proof
    nothing = Text("No effect was added, so there is nothing to prove on held-out rows.", "muted")
    return Section(
        "fit",
        "Fit before and after",
        [
            fit_table(fits, diagnosis.fits, diagnosis.recording.validation),
            nothing if proof is None else proof_table(proof),
        ],
    )


def fit_table(fits: Mapping[str, Estimate], summaries: Mapping[str, FitSummary], validation: Mask) -> Table:
    """Misfit of each fit, in stated sigmas and by kind of reading; validation (n,): rows held out."""
    keys = [key for key in fits if key in summaries]
    units = fits[keys[0]].nominal.residual_units
    rows: list[list[str]] = []
    for name in ("calibration rows", "validation rows"):
        held = name == "validation rows"
        if held and not validation.any():
            continue
        sigmas = [_rms(fits[k].residual[validation if held else fits[k].used]) for k in keys]
        rows.append([f"rms residual, {name} [σ]", *map(significant, sigmas)])
        rms = [(summaries[k].validation_rms if held else summaries[k].rms) or {} for k in keys]
        rows += [
            [f"rms {kind}, {name}", *(measure(one.get(kind), unit) for one in rms)]
            for kind, unit in units.items()
        ]
    own = [summaries[k] for k in keys]
    rows.append(["chi2 / degree of freedom", *(significant(s.chi2_per_dof) for s in own)])
    rows.append(
        ["farthest parameter [tolerances]"]
        + [f"{s.worst_parameter} {significant(s.worst_parameter_sigma)}" for s in own]
    )
    # of a free fit the widened tolerances would be the yardstick, which says nothing
    allowed = ["-" if k == "free" else significant(summaries[k].worst_allowed) for k in keys]
    rows.append(["what a true model stays below in 99 of 100 cases", *allowed])
    caption = (
        "The fits side by side; 1 σ is the sensor's stated noise. The free fit's parameters are not held to their tolerances,"
        " so its figures look best whatever is missing."
    )
    return Table(["", *(NAMES[k] for k in keys)], rows, caption)


def _rms(residual: Array) -> float | None:
    values = residual[np.isfinite(residual) & (residual != 0.0)]  # a row that refers to itself reads nothing
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def proof_table(proof: Proof) -> Table:
    """Held-out ratio, placebo, black box and injection, each with what it should be."""
    low, high = proof.ratio_interval
    held = VALIDATION if proof.held_out == ROLE else proof.held_out
    part = "besides" if proof.held_out == ROLE else "of these"
    injected = {True: "found again", False: "not found again", None: "-"}[proof.injected_recovered]
    ratio = f"{significant(proof.ratio)} ({significant(low)} to {significant(high)})"
    rows = [
        [f"held-out rms, after over before ({held})", ratio, "below 1"],
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
        "The named physics and a black box of as many coefficients on rows that were not fitted (95 % bootstrap interval)."
        " Physics that is really there lowers the misfit where it was never fitted; mere flexibility does not."
    )
    return Table(["proof", "result", "should be"], rows, caption)
