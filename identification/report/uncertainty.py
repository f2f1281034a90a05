"""How well the tool is known: the uncertainty budget, and ISO 9283."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from truepose.errors import TrueposeError
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.repeatability import pose_test
from truepose.identification.fit.tool_pose import (
    EXPLANATIONS,
    READINGS,
    TOLERANCES,
    UNEXPLAINED,
    ToolSpread,
    tool_spread,
)
from truepose.identification.recording.recording import Recording
from truepose.identification.report.phrases import measure
from truepose.identification.report.scene import thinned
from truepose.shown.document import Block, Section, Table, Text

ROWS = 300
COVERAGE = 2.0
"""Coverage factor: an interval of about 95 %."""
_SOURCES: Mapping[str, tuple[str, str]] = {
    READINGS: ("noise of the readings, as it went through the fit", "A"),
    TOLERANCES: ("what the readings leave to the drawing's tolerances", "B"),
    EXPLANATIONS: ("explanations that the readings cannot tell apart", "B"),
    UNEXPLAINED: ("what the model leaves unexplained beyond the instrument's noise", "A"),
}


def uncertainty_section(fit: Estimate, recording: Recording, before: Estimate | None) -> Section:
    """Return the budget at the recorded poses, and ISO 9283 where the recording allows it.

    ``before``: the fit to compare the standard's figures with, None for a calibration alone.
    """
    good = np.flatnonzero(np.isfinite(fit.residual).all(axis=1))
    if not len(good) or not len(fit.prior.free):
        said = "Nothing was estimated, so there is no uncertainty to tell."
        return Section("uncertainty", "How well the tool's position is known", [Text(said)])
    try:
        blocks: list[Block] = [_budget(tool_spread(fit, recording, thinned(good, ROWS)))]
    except TrueposeError as exc:
        blocks = [Text(f"The uncertainty of the tool could not be evaluated: {exc}")]
    blocks.append(_iso_9283(fit, recording, before))
    return Section("uncertainty", "How well the tool's position is known", blocks)


def _budget(spread: ToolSpread) -> Table:
    """Sources, their standard uncertainties and shares, combined and expanded."""
    mean = {source: float(np.mean(v)) for source, v in spread.variance.items()}
    whole = sum(mean.values())
    rows = [
        [*_SOURCES[source], measure(float(np.sqrt(v)), "mm"), f"{100 * v / whole:.0f} %" if whole else "-"]
        for source, v in mean.items()
    ]
    combined = float(np.sqrt(whole))
    rows.append(["combined standard uncertainty", "", measure(combined, "mm"), "100 %"])
    rows.append([f"expanded uncertainty, k = {COVERAGE:g}", "", measure(COVERAGE * combined, "mm"), ""])
    caption = (
        "Uncertainty of the tool's position in the sensor's frame, root of the mean over the recorded poses, after the GUM"
        " (JCGM 100:2008). Type A comes from the scatter of readings, type B from other knowledge. It is that of the model:"
        " a single reading has the instrument's noise beside it, and an error that the instrument makes in all readings is"
        " not in it."
    )
    head = ["source", "type", "standard uncertainty", "share of variance"]
    return Table(head, rows, caption, text_columns=2)


def _iso_9283(fit: Estimate, recording: Recording, before: Estimate | None) -> Block:
    """Return AP and RP of mean and worst pose, before and after; where poses were visited too rarely, what is needed."""
    now, was = pose_test(fit, recording), pose_test(before or fit, recording)
    if now is None or was is None:
        needs = (
            "ISO 9283 (pose accuracy and repeatability) needs poses that are visited three times and more under one number"
            " in the column `pose`. This recording has none."
        )
        return Text(needs, "muted")
    figures = {
        "pose accuracy AP, before": was.accuracy if before else None,
        "pose accuracy AP, with this model": now.accuracy,
        "pose repeatability RP": now.repeatability,
    }
    rows = [
        [name, measure(float(np.mean(values)), "mm"), measure(float(np.max(values)), "mm")]
        for name, values in figures.items()
        if values is not None
    ]
    visits = f"{int(now.visits.min())} to {int(now.visits.max())}"
    caption = (
        f"After ISO 9283, of {len(now.visits)} poses with {visits} visits each; the standard asks for 30 visits of five poses."
        " AP: from the model's position to the mean of the readings. RP: mean distance from that mean plus three standard"
        " deviations; no calibration improves it."
    )
    return Table(["", "mean pose", "worst pose"], rows, caption)
